//! Scenes and lights exported and read back.

use std::path::Path;

use glam::{Vec2, Vec3};
use lightsum::scene::{self, Light, Scene, Surface, Texture, VirtualLight, Wrap, builtin, export_lights};
use serde_json::Value;
use tempfile::TempDir;

use super::*;

/// A scene with every feature that an export must keep.
fn rich_scene() -> Scene {
    let mut scene = builtin::room(500);
    let texel = |i: u8| [i.wrapping_mul(37), i.wrapping_mul(91), i.wrapping_mul(53), 255];
    scene.textures.push(Texture {
        name: String::from("noise"),
        width: 4,
        height: 3,
        texels: (0..12).map(texel).collect(),
        srgb: true,
        wrap: [Wrap::Mirror, Wrap::Clamp],
    });
    scene.materials[0].base_texture = Some(0);
    scene.materials[1].specular = Vec3::new(0.1, 0.2, 0.3);
    scene.materials[1].roughness = 0.37;
    scene.materials[2].surface = Surface::Mirror;
    scene.materials[3].surface = Surface::Glass;
    scene.materials[3].ior = 1.7;
    (scene.materials[3].thin, scene.materials[3].frost) = (true, 0.3);
    scene.materials[4].two_sided = true;
    scene.materials[4].emission_exponent = 12.5;
    scene.materials[1].phong_exponent = Some(33.0);
    (scene.materials[0].anisotropy, scene.materials[0].anisotropy_rotation) = (0.6, -0.7);
    scene.triangles[0].smooth = true;
    for (i, uv) in scene.uvs.iter_mut().enumerate() {
        *uv = Vec2::new(i as f32 * 0.1, 1.0 / (1.0 + i as f32));
    }
    scene.lights.push(Light::Point { position: Vec3::ONE, intensity: Vec3::new(1.0, 2.0, 4.0) });
    scene.lights.push(Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::ONE });
    scene.validate(Path::new("rich")).unwrap();
    scene
}

#[test]
fn exported_lights_come_back() {
    let scene = rich_scene();
    let virtual_light = |i: u32| {
        let x = i as f32;
        VirtualLight {
            position: Vec3::new(0.1 + x / 7.0, x / 3.0, 0.3),
            normal: Vec3::new(x.sin(), x.cos(), 0.3 * x - 1.0).normalize(),
            power: Vec3::new(0.1 * x, 1.0 / 3.0, 1e-7 * x),
            exponent: 1.0 + 7.3 * (i / 5) as f32,
        }
    };
    let lights: Vec<VirtualLight> = (0..20).map(virtual_light).collect();
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("virtual lights.gltf");
    export_lights(&path, &scene, &lights).unwrap();
    let back = scene::load(&path).unwrap();

    assert!(!back.emitters_are_lights && back.emitters().is_empty());
    let virtual_lights = |scene: &Scene| -> Vec<Light> {
        scene.lights.iter().filter(|l| matches!(l, Light::Imported { .. })).copied().collect()
    };
    let expected: Vec<Light> = lights
        .iter()
        .map(|&VirtualLight { position, normal, power, exponent }| Light::Imported {
            position,
            normal,
            power,
            exponent,
        })
        .collect();
    assert_eq!(virtual_lights(&back), expected);
    assert_eq!(back.lights[0], scene.lights[0]);
    let Light::Directional { direction, .. } = back.lights[1] else { panic!("{:?}", back.lights[1]) };
    assert!(near(direction, Vec3::NEG_Y));
    assert_eq!(back.lights.len(), 22);
    assert_eq!(back.camera, scene.camera);
    assert_eq!(back.textures[0].texels, scene.textures[0].texels);
    assert_eq!((back.textures[0].wrap, back.textures[0].srgb), (scene.textures[0].wrap, true));

    // The order of triangles within an object may differ, nothing else.
    let corners = |scene: &Scene| {
        let mut list: Vec<String> = (0..scene.triangles.len())
            .map(|i| {
                let t = &scene.triangles[i];
                let m = &scene.materials[t.material as usize];
                let uvs = t.vertices.map(|v| if m.base_texture.is_some() { scene.uvs[v as usize] } else { Vec2::ZERO });
                let normals = t.vertices.map(|v| if t.smooth { scene.normals[v as usize] } else { Vec3::ZERO });
                let object = &scene.objects[t.object as usize];
                format!("{object} {m:?} {:?} {uvs:?} {normals:?}", scene.triangle_positions(i))
            })
            .collect();
        list.sort();
        list
    };
    assert_eq!(corners(&back), corners(&scene));
    let albedos = |scene: &Scene| {
        let mut albedos = scene.mean_albedos();
        albedos.sort_by(f32::total_cmp);
        albedos
    };
    assert_eq!(albedos(&back), albedos(&scene));

    // Exporting the imported scene gives the same lights again.
    let again = folder.path().join("again.gltf");
    export_lights(&again, &back, &[]).unwrap();
    assert_eq!(virtual_lights(&scene::load(&again).unwrap()), expected);
}

#[test]
fn orthographic_cameras_are_written_as_such() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("plan.gltf");
    let mut furnace = builtin::furnace(0.5, 3.0);
    furnace.camera = furnace.camera.map(|camera| lightsum::Camera { height: Some(0.5), ..camera });
    let light = VirtualLight { position: Vec3::ZERO, normal: Vec3::X, power: Vec3::ONE, exponent: 1.0 };
    export_lights(&path, &furnace, &[light]).unwrap();
    assert_eq!(scene::load(&path).unwrap().camera, furnace.camera);
    let mut document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    document["cameras"][0].as_object_mut().unwrap().remove("extras");
    std::fs::write(&path, document.to_string()).unwrap();
    let camera = scene::load(&path).unwrap().camera.unwrap();
    assert!((camera.height.unwrap() - 0.5).abs() < 1e-6, "{camera:?}");
}

#[test]
fn exported_files_mean_the_same_to_others() {
    let light = VirtualLight { position: Vec3::ONE, normal: Vec3::X, power: Vec3::new(1.0, 2.0, 0.5), exponent: 1.0 };
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("lights.gltf");
    export_lights(&path, &builtin::furnace(0.5, 3.0), &[light]).unwrap();
    // Without our extras, the emission remains and the light is a spot over the hemisphere.
    let mut document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let power = document["nodes"][2]["extras"]["lightsum"]["power"].to_string();
    assert_eq!(power, "[1.0,2.0,0.5]");
    for part in ["nodes", "materials", "cameras"] {
        for item in document[part].as_array_mut().unwrap() {
            item.as_object_mut().unwrap().remove("extras");
        }
    }
    document["asset"].as_object_mut().unwrap().remove("extras");
    std::fs::write(&path, document.to_string()).unwrap();
    let scene = scene::load(&path).unwrap();
    assert!(scene.emitters_are_lights);
    assert!(near(scene.materials[0].emission, Vec3::splat(3.0)));
    let Light::Spot { position, direction, intensity, outer, .. } = scene.lights[0] else {
        panic!("{:?}", scene.lights)
    };
    assert!(near(direction, Vec3::X) && (position, outer) == (Vec3::ONE, FRAC_PI_2));
    assert!(near(intensity, light.power / PI));

    let names: Vec<String> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    assert!(names.iter().all(|n| !n.ends_with(".tmp")), "{names:?}");
    let error = export_lights(&folder.path().join("lights.obj"), &scene, &[]).unwrap_err().to_string();
    assert!(error.contains(".gltf"), "{error}");
    let error = export_lights(&folder.path().join("none/lights.gltf"), &scene, &[]).unwrap_err().to_string();
    assert!(error.contains("none/lights"), "{error}");
}
