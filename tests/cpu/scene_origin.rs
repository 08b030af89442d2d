//! Scenes far from the origin of their files: the loaders move the origin, and keep the digits of the file.

use std::fmt::Write as _;
use std::path::Path;

use glam::{DVec3, Vec3};
use lightsum::scene::{self, Camera, Light, Scene, VirtualLight, export_lights};
use tempfile::TempDir;

/// The Cornell box with a spot and a sphere light, moved by whole millimetres. All its coordinates have few decimals.
fn moved_box(by: DVec3) -> Scene {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
    let folder = TempDir::new().unwrap();
    let obj = std::fs::read_to_string(source.join("cornell.obj")).unwrap();
    let mut moved = String::new();
    for line in obj.lines() {
        match line.strip_prefix("v ") {
            Some(rest) => {
                let p: Vec<f64> = rest.split_whitespace().map(|x| x.parse().unwrap()).collect();
                let [x, y, z] = (DVec3::from_slice(&p) + by).to_array();
                writeln!(moved, "v {x:.3} {y:.3} {z:.3}").unwrap();
            }
            None => writeln!(moved, "{line}").unwrap(),
        }
    }
    std::fs::write(folder.path().join("cornell.obj"), moved).unwrap();
    std::fs::copy(source.join("cornell.mtl"), folder.path().join("cornell.mtl")).unwrap();
    let place = |x: f64, y: f64, z: f64| format!("{:?}", (DVec3::new(x, y, z) + by).to_array());
    let toml = format!(
        "model = \"cornell.obj\"\n[camera]\neye = {}\ntarget = {}\nfov_y = 39.3\n\
         [lights.spot]\ntype = \"spot\"\nposition = {}\ndirection = [0, -1, 0]\nintensity = [1, 1, 1]\nouter = 30\n\
         [lights.ball]\ntype = \"sphere\"\ncenter = {}\nradius = 20.0\nradiance = [1, 1, 1]\n",
        place(278.0, 273.0, -800.0),
        place(278.0, 273.0, -799.0),
        place(100.0, 500.0, 100.0),
        place(400.0, 300.0, 50.0),
    );
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, toml).unwrap();
    scene::load(&path).unwrap()
}

/// 10^k times the size of the box, in an oblique direction.
fn far(exponent: i32) -> DVec3 {
    (DVec3::new(559.0, -391.0, 173.0) * 10.0f64.powi(exponent)).round()
}

fn places(scene: &Scene) -> Vec<Vec3> {
    let lights = scene.lights.iter().map(|light| match *light {
        Light::Spot { position, .. } | Light::Imported { position, .. } => position,
        Light::Sphere { center, .. } => center,
        _ => unreachable!("the box has a spot and a sphere, and virtual lights once exported"),
    });
    let camera = scene.camera.unwrap();
    scene.positions.iter().copied().chain([camera.eye, camera.target]).chain(lights).collect()
}

#[test]
fn a_near_scene_keeps_its_coordinates() {
    let plain = moved_box(DVec3::ZERO);
    assert_eq!(plain.origin, DVec3::ZERO);
    assert_eq!(plain.positions[0], Vec3::new(343.0, 548.3, 227.0));
    assert_eq!(moved_box(DVec3::new(0.0, 1500.0, -900.0)).origin, DVec3::ZERO);
}

#[test]
fn everything_in_a_far_scene_keeps_its_place() {
    let plain = moved_box(DVec3::ZERO);
    for exponent in [1, 2, 3, 4, 6] {
        let by = far(exponent);
        let moved = moved_box(by);
        assert!((moved.origin - by).abs().max_element() < 559.0);
        for (p, q) in places(&moved).into_iter().zip(places(&plain)) {
            let off = (moved.to_world(p) - by - q.as_dvec3()).length();
            // The rounding of the local coordinates, and that of the file's decimals in double precision.
            assert!(off < 1e-4 + by.length() * 1e-15, "{p} is {off} from {q} at 10^{exponent}");
            assert!(moved.from_world(moved.to_world(p)) == p);
        }
        assert_eq!(moved.triangles, plain.triangles);
    }
}

#[test]
fn a_far_scene_comes_back_from_gltf_bit_for_bit() {
    let scene = moved_box(far(4));
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("far.gltf");
    let light = VirtualLight { position: Vec3::new(1.5, -2.25, 0.1), normal: Vec3::Y, power: Vec3::ONE, exponent: 1.0 };
    export_lights(&path, &scene, &[light]).unwrap();
    let back = scene::load(&path).unwrap();
    assert_eq!((back.origin, back.camera), (scene.origin, scene.camera));
    // The sphere light is among the virtual lights of a real export.
    assert!(back.lights.iter().any(|l| matches!(l, Light::Imported { position, .. } if *position == light.position)));
    let spot = |s: &Scene| {
        s.lights.iter().find_map(|l| if let Light::Spot { position, .. } = l { Some(*position) } else { None })
    };
    assert!(spot(&back) == spot(&scene) && spot(&scene).is_some());
    let corners = |s: &Scene| {
        let mut all: Vec<[[u32; 3]; 3]> =
            (0..s.triangles.len()).map(|i| s.triangle_positions(i).map(|p| p.to_array().map(f32::to_bits))).collect();
        all.sort_unstable();
        all
    };
    assert_eq!(corners(&back), corners(&scene));
}

#[test]
fn a_far_node_keeps_the_vertices_below_it() {
    let scene = moved_box(DVec3::ZERO);
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("near.gltf");
    export_lights(&path, &scene, &[]).unwrap();
    let mut document: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let nodes = document["nodes"].as_array_mut().unwrap();
    let children: Vec<usize> = (0..nodes.len()).collect();
    nodes.push(serde_json::json!({ "translation": [5.59e6, -3.91e6, 0.0], "children": children }));
    document["scenes"][0]["nodes"] = serde_json::json!([nodes.len() - 1]);
    // The camera of another program has no exact values.
    document["cameras"][0].as_object_mut().unwrap().remove("extras");
    std::fs::write(&path, document.to_string()).unwrap();
    let far = scene::load(&path).unwrap();
    let by = DVec3::new(5.59e6, -3.91e6, 0.0);
    let (low, high) = far.bounds();
    let (expected_low, expected_high) = scene.bounds();
    for (found, expected) in [(low, expected_low), (high, expected_high)] {
        assert!((far.to_world(found) - by - expected.as_dvec3()).length() < 1e-4, "{found} {expected}");
    }
    let off = far.to_world(far.camera.unwrap().eye) - by - scene.camera.unwrap().eye.as_dvec3();
    assert!(off.length() < 1e-3, "{off}");
}

#[test]
fn metadata_has_the_camera_in_world_coordinates() {
    let eye = |scene: &Scene| -> [f64; 3] {
        let text = scene.camera.unwrap().world_json(scene.origin);
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        serde_json::from_value(value["eye"].clone()).unwrap()
    };
    let by = far(4);
    let off = DVec3::from_array(eye(&moved_box(by))) - by - DVec3::new(278.0, 273.0, -800.0);
    assert!(off.length() < 1e-3, "{off}");
    let plain = moved_box(DVec3::ZERO);
    assert_eq!(eye(&plain), [278.0, 273.0, -800.0]);
    let text = plain.camera.unwrap().world_json(plain.origin);
    assert_eq!(serde_json::from_str::<Camera>(&text).unwrap(), plain.camera.unwrap());
}
