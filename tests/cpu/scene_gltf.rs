//! glTF models: valid ones and invalid ones.

use std::f32::consts::{FRAC_PI_2, PI};
use std::path::PathBuf;

use glam::{Vec2, Vec3};
use lightsum::scene::{self, Light, Scene, Surface, TextureUse, VirtualLight, Wrap, export_lights};
use serde_json::{Value, json};
use tempfile::TempDir;

mod damaged;
mod export;
mod external;
mod materials;

/// A folder with one glTF document.
struct Case {
    folder: TempDir,
    document: Value,
    bin: Vec<u8>,
}

impl Case {
    /// A right triangle in the plane z = 0 with normals, texture coordinates and 16-bit indices; its material emits.
    fn new() -> Case {
        let mut bin = Vec::new();
        let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let normals = [0.0f32, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.8];
        let uvs = [0.0f32, 0.0, 1.0, 0.0, 0.0, 1.0];
        for x in positions.iter().chain(&normals).chain(&uvs) {
            bin.extend(x.to_le_bytes());
        }
        for i in [0u16, 1, 2] {
            bin.extend(i.to_le_bytes());
        }
        bin.extend([0, 0]);
        let document = json!({
            "asset": { "version": "2.0" },
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0, "name": "thing" }],
            "meshes": [{ "primitives": [{
                "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3, "material": 0,
            }] }],
            "materials": [{ "name": "lamp", "emissiveFactor": [1.0, 0.5, 0.0] }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
                { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3" },
                { "bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2" },
                { "bufferView": 3, "componentType": 5123, "count": 3, "type": "SCALAR" },
            ],
            "bufferViews": [
                { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
                { "buffer": 0, "byteOffset": 36, "byteLength": 36 },
                { "buffer": 0, "byteOffset": 72, "byteLength": 24 },
                { "buffer": 0, "byteOffset": 96, "byteLength": 6 },
            ],
            "buffers": [{ "uri": "a.bin", "byteLength": 104 }],
        });
        Case { folder: TempDir::new().unwrap(), document, bin }
    }

    fn with(change: impl FnOnce(&mut Case)) -> Case {
        let mut case = Case::new();
        change(&mut case);
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn load(&self) -> lightsum::Result<Scene> {
        std::fs::write(self.path("a.bin"), &self.bin).unwrap();
        std::fs::write(self.path("a.gltf"), self.document.to_string()).unwrap();
        scene::load(&self.path("a.gltf"))
    }

    fn glb(&self) -> Vec<u8> {
        let mut document = self.document.clone();
        document["buffers"][0].as_object_mut().unwrap().remove("uri");
        let mut json = document.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut glb = b"glTF\x02\0\0\0".to_vec();
        glb.extend((28 + json.len() as u32 + self.bin.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &self.bin)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(chunk);
        }
        glb
    }
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let value = chunk.iter().fold(0usize, |v, &b| v << 8 | usize::from(b)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let digit = char::from(DIGITS[value >> (18 - 6 * i) & 63]);
            text.push(if i > chunk.len() { '=' } else { digit });
        }
    }
    text
}

fn png(texels: &[[u8; 4]], width: u32) -> Vec<u8> {
    let raw = texels.iter().flatten().copied().collect();
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_raw(width, texels.len() as u32 / width, raw).unwrap();
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn normal(scene: &Scene, i: usize) -> Vec3 {
    let [a, b, c] = scene.triangle_positions(i);
    (b - a).cross(c - a).normalize()
}

fn near(a: Vec3, b: Vec3) -> bool {
    (a - b).abs().max_element() < 1e-5
}

#[test]
fn gltf_is_read_from_each_container() {
    let case = Case::new();
    let expected = case.load().unwrap();
    assert_eq!(expected.triangles.len(), 1);
    assert!(expected.triangles[0].smooth && expected.emitters_are_lights);
    assert_eq!(expected.objects, ["thing"]);
    assert_eq!(expected.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(expected.normals[2], Vec3::new(0.0, 0.6, 0.8));
    assert_eq!(expected.uvs, [Vec2::ZERO, Vec2::X, Vec2::Y]);
    let m = &expected.materials[0];
    assert_eq!((m.name.as_str(), m.emission, m.metallic), ("lamp", Vec3::new(1.0, 0.5, 0.0), 1.0));
    assert!(near(m.specular, Vec3::splat(0.04)) && !m.two_sided);

    std::fs::write(case.path("a.glb"), case.glb()).unwrap();
    let binary = scene::load(&case.path("a.glb")).unwrap();
    assert_eq!((&binary.positions, &binary.triangles), (&expected.positions, &expected.triangles));
    let embedded = Case::with(|c| {
        c.document["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{}", base64(&c.bin)));
    });
    let embedded = embedded.load().unwrap();
    assert_eq!((&embedded.positions, &embedded.triangles), (&expected.positions, &expected.triangles));
}

#[test]
fn nodes_are_flattened() {
    let case = Case::with(|c| {
        c.document["scenes"][0]["nodes"] = json!([0]);
        c.document["nodes"] = json!([
            { "children": [1, 2], "translation": [0, 0, 5], "scale": [2, 2, 2] },
            { "mesh": 0, "translation": [1, 0, 0] },
            // Mirrored in x: the winding is reversed, so that the front stays at +z.
            { "mesh": 0, "scale": [-1, 1, 1] },
        ]);
    });
    let scene = case.load().unwrap();
    assert_eq!(scene.triangles.len(), 2);
    assert!(near(scene.triangle_positions(0)[1], Vec3::new(4.0, 0.0, 5.0)));
    assert!(near(normal(&scene, 0), Vec3::Z) && near(normal(&scene, 1), Vec3::Z));
    assert!(near(scene.normals[3], Vec3::Z) && near(scene.normals[5], Vec3::new(0.0, 0.6, 0.8)));
    assert!(near(scene.bounds().0, Vec3::new(-2.0, 0.0, 5.0)));
}

#[test]
fn materials_and_textures_are_read() {
    let case = Case::with(|c| {
        let image = png(&[[255, 0, 0, 255], [0, 0, 255, 255]], 1);
        std::fs::write(c.path("my image.png"), &image).unwrap();
        c.document["images"] = json!([
            { "uri": "my%20image.png" },
            { "uri": format!("data:image/png;base64,{}", base64(&image)) },
        ]);
        c.document["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33648 }]);
        c.document["textures"] = json!([{ "source": 0, "sampler": 0 }, { "source": 1 }]);
        c.document["materials"][0] = json!({
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 1.0, 1.0], "metallicFactor": 0.25, "roughnessFactor": 0.5,
                "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 1 },
            },
            "emissiveFactor": [1.0, 0.5, 1.0], "emissiveTexture": { "index": 0 }, "doubleSided": true,
            "extensions": {
                "KHR_materials_emissive_strength": { "emissiveStrength": 8.0 },
                "KHR_materials_ior": { "ior": 2.0 },
                "KHR_materials_transmission": { "transmissionFactor": 0.75 },
            },
        });
    });
    let scene = case.load().unwrap();
    let m = &scene.materials[0];
    assert_eq!(m.base_color, Vec3::new(0.5, 0.25, 1.0));
    assert_eq!((m.metallic, m.roughness, m.two_sided), (0.25, 0.5, true));
    // Glass without a volume is a pane.
    assert_eq!((m.surface, m.ior, m.thin, m.frost), (Surface::Glass, 2.0, true, 0.5));
    assert!(near(m.specular, Vec3::splat(1.0 / 9.0)));
    assert_eq!((m.emission, m.emission_texture), (Vec3::new(8.0, 4.0, 8.0), m.base_texture));
    let base = &scene.textures[m.base_texture.unwrap() as usize];
    assert_eq!((base.width, base.height, base.srgb), (1, 2, true));
    assert_eq!(base.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert_eq!(base.texels, [[255, 0, 0, 255], [0, 0, 255, 255]]);
    let packed = &scene.textures[m.metallic_roughness_texture.unwrap() as usize];
    assert_eq!((packed.srgb, packed.wrap), (false, [Wrap::Repeat; 2]));
}

#[test]
fn texture_coordinates_are_transformed() {
    let case = Case::with(|c| {
        let image = png(&[[255, 0, 0, 255]], 1);
        c.document["images"] = json!([{ "uri": format!("data:image/png;base64,{}", base64(&image)) }]);
        c.document["textures"] = json!([{ "source": 0 }]);
        c.document["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0, "NORMAL": 1, "TEXCOORD_1": 2 });
        let transform = json!({ "offset": [0.25, 0.5], "rotation": FRAC_PI_2, "scale": [2.0, 3.0], "texCoord": 1 });
        c.document["materials"][0] = json!({
            "emissiveFactor": [1.0, 1.0, 1.0],
            "pbrMetallicRoughness": { "baseColorTexture": {
                "index": 0, "extensions": { "KHR_texture_transform": transform },
            } },
        });
        c.document["extensionsUsed"] = json!(["KHR_texture_transform"]);
        c.document["extensionsRequired"] = json!(["KHR_texture_transform"]);
    });
    let scene = case.load().unwrap();
    // The unit vectors are scaled, turned by [[cos, sin], [-sin, cos]], and moved, as the extension's text has it.
    let expected = [Vec2::new(0.25, 0.5), Vec2::new(0.25, -1.5), Vec2::new(3.25, 0.5)];
    for (uv, expected) in scene.uvs.iter().zip(expected) {
        assert!((*uv - expected).abs().max_element() < 1e-5, "{uv} {expected}");
    }
}

/// Adds bytes to the buffer, with a view of them; the view's index.
fn view(c: &mut Case, bytes: &[u8], stride: Option<u32>) -> usize {
    let offset = c.bin.len();
    c.bin.extend(bytes);
    c.bin.resize(c.bin.len().next_multiple_of(4), 0);
    c.document["buffers"][0]["byteLength"] = json!(c.bin.len());
    let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
    if let Some(stride) = stride {
        view["byteStride"] = json!(stride);
    }
    let views = c.document["bufferViews"].as_array_mut().unwrap();
    views.push(view);
    views.len() - 1
}

#[test]
fn quantized_attributes_are_read_if_the_file_says_so() {
    let change = |c: &mut Case| {
        let corners = [[0i16, 0, 0, 0], [100, 0, 0, 0], [0, -50, 0, 0]];
        let bytes: Vec<u8> = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = view(c, &bytes, Some(8));
        c.document["accessors"][0] = json!({
            "bufferView": view, "componentType": 5122, "count": 3, "type": "VEC3", "min": [0, -50, 0], "max": [100, 0, 0],
        });
        c.document["nodes"][0]["scale"] = json!([0.01, 0.02, 1.0]);
    };
    let refused = Case::with(change).load().unwrap_err().to_string();
    assert!(refused.contains("accessor 0"), "{refused}");
    let quantized = Case::with(|c| {
        change(c);
        c.document["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
        c.document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    });
    let scene = quantized.load().unwrap();
    assert!(near(scene.positions[1], Vec3::X) && near(scene.positions[2], Vec3::NEG_Y), "{:?}", scene.positions);
}

#[test]
fn instances_are_placed() {
    let case = |turns: usize| {
        Case::with(|c| {
            let places: Vec<u8> = [1.0f32, 2.0, 3.0, -1.0, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
            // None, and a quarter about z.
            let half = (32767.0 * 0.5f32.sqrt()).round() as i16;
            let quarters: Vec<u8> =
                [0, 0, 0, 32767, 0, 0, half, half].iter().flat_map(|x: &i16| x.to_le_bytes()).collect();
            let views = [view(c, &places, None), view(c, &quarters, None)];
            let accessors = c.document["accessors"].as_array_mut().unwrap();
            accessors.push(json!({ "bufferView": views[0], "componentType": 5126, "count": 2, "type": "VEC3" }));
            accessors.push(json!({
                "bufferView": views[1], "componentType": 5122, "normalized": true, "count": turns, "type": "VEC4",
            }));
            c.document["nodes"][0]["extensions"] =
                json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 4, "ROTATION": 5 } } });
            c.document["nodes"][0]["scale"] = json!([2.0, 2.0, 2.0]);
            c.document["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
            c.document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
        })
    };
    let scene = case(2).load().unwrap();
    assert_eq!((scene.triangles.len(), scene.objects.len()), (2, 1));
    let expected =
        [[2.0, 4.0, 6.0], [4.0, 4.0, 6.0], [2.0, 6.0, 6.0], [-2.0, 0.0, 0.0], [-2.0, 2.0, 0.0], [-4.0, 0.0, 0.0]];
    for (p, expected) in scene.positions.iter().zip(expected) {
        assert!((*p - Vec3::from_array(expected)).abs().max_element() < 1e-4, "{p} {expected:?}");
    }
    assert!(case(1).load().unwrap_err().to_string().contains("differ"));
}

#[test]
fn extensions_that_are_not_read_are_named() {
    let case = Case::with(|c| {
        c.document["extensionsUsed"] = json!(["KHR_materials_sheen", "ACME_notes", "KHR_texture_transform"]);
        c.document["extensionsRequired"] = json!(["KHR_materials_sheen"]);
    });
    assert_eq!(case.load().unwrap().ignored, ["ACME_notes", "KHR_materials_sheen"]);
}

#[test]
fn webp_images_and_the_specular_extension_are_read() {
    let case = Case::with(|c| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 0, 0, 255, 255]).unwrap();
        image.write_to(&mut bytes, image::ImageFormat::WebP).unwrap();
        let uri = format!("data:image/webp;base64,{}", base64(&bytes.into_inner()));
        c.document["images"] = json!([{ "uri": uri }]);
        c.document["textures"] = json!([{ "extensions": { "EXT_texture_webp": { "source": 0 } } }]);
        c.document["materials"][0] = json!({
            "emissiveFactor": [1.0, 1.0, 1.0],
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
            "extensions": { "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [1.0, 2.0, 100.0] } },
        });
        c.document["extensionsUsed"] = json!(["EXT_texture_webp", "KHR_materials_specular"]);
        c.document["extensionsRequired"] = json!(["EXT_texture_webp"]);
    });
    let scene = case.load().unwrap();
    assert_eq!(scene.textures[0].texels, [[255, 0, 0, 255], [0, 0, 255, 255]]);
    // The product is at most 1 before the factor.
    assert!(near(scene.materials[0].specular, Vec3::new(0.02, 0.04, 0.5)), "{}", scene.materials[0].specular);
    assert!(scene.ignored.is_empty(), "{:?}", scene.ignored);
}

#[test]
fn lights_from_blender_are_photometric_and_all_cameras_are_there() {
    let case = |generator: &str, intensity: f32| {
        let case = Case::with(|c| {
            c.document["asset"]["generator"] = json!(generator);
            c.document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
            c.document["extensions"] =
                json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": intensity }] } });
            c.document["cameras"] = json!([
                { "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } },
                { "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } },
                { "type": "orthographic", "orthographic": { "xmag": 3.0, "ymag": 2.0, "znear": 0.0, "zfar": 9.0 } },
            ]);
            c.document["nodes"] = json!([
                { "mesh": 0, "children": [1, 2, 3, 4] },
                { "extensions": { "KHR_lights_punctual": { "light": 0 } } },
                { "name": "near", "camera": 0, "translation": [0, 0, 1] },
                { "name": "far", "camera": 1, "translation": [0, 0, 9] },
                { "name": "plan", "camera": 2, "translation": [0, 0, 7], "scale": [5, 5, 5] },
            ]);
        });
        let scene = case.load().unwrap();
        let Light::Point { intensity, .. } = scene.lights[0] else { panic!("{:?}", scene.lights) };
        (intensity.x, scene)
    };
    let (in_watts, scene) = case("Khronos glTF Blender I/O v4.2.57", 6830.0);
    assert!((in_watts - 10.0).abs() < 1e-4);
    let cameras: Vec<(&str, f32)> = scene.cameras.iter().map(|c| (c.name.as_str(), c.camera.eye.z)).collect();
    assert_eq!(cameras, [("near", 1.0), ("far", 9.0), ("plan", 7.0)]);
    let plan = scene.cameras[2].camera;
    assert_eq!((plan.height, plan.resolution, scene.ignored.len()), (Some(4.0), [720, 480], 0));
    assert!(near(plan.world_from_camera().2, Vec3::NEG_Z) && !scene.cameras[0].camera.is_orthographic());
    assert_eq!(scene.camera, Some(scene.cameras[0].camera));
    assert_eq!(case("Khronos glTF Blender I/O v4.2.57", 10.0).0, 10.0);
    assert_eq!(case("another", 6830.0).0, 6830.0);
}

#[test]
fn normal_maps_and_vertex_colors_are_read() {
    let case = Case::with(|c| {
        let image = png(&[[255, 128, 128, 255]], 1);
        c.document["images"] = json!([{ "uri": format!("data:image/png;base64,{}", base64(&image)) }]);
        c.document["textures"] = json!([{ "source": 0 }]);
        c.document["materials"][0] =
            json!({ "emissiveFactor": [1.0, 1.0, 1.0], "normalTexture": { "index": 0, "scale": 0.5 } });
        let colors = view(c, &[255, 0, 51, 9, 0, 255, 0, 9, 0, 0, 255, 9], None);
        c.document["accessors"].as_array_mut().unwrap().push(json!({
            "bufferView": colors, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC4",
        }));
        // The first of two primitives has no colours.
        let plain = c.document["meshes"][0]["primitives"][0].clone();
        c.document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(4);
        c.document["meshes"][0]["primitives"].as_array_mut().unwrap().insert(0, plain);
    });
    let scene = case.load().unwrap();
    assert!(scene.ignored.is_empty(), "{:?}", scene.ignored);
    assert_eq!(scene.colors[..3], [Vec3::ONE; 3]);
    assert_eq!(scene.colors[3..], [Vec3::new(1.0, 0.0, 0.2), Vec3::Y, Vec3::Z]);
    assert_eq!(scene.color_at(&scene.triangles[1], [0.5, 0.5, 0.0]), Vec3::new(0.5, 0.5, 0.1));
    let m = &scene.materials[0];
    assert_eq!((m.normal_texture, m.normal_scale), (Some(0), 0.5));
    assert!(!scene.textures[0].srgb);
    // u runs along x: the normal leans there; v runs along y, against the map's y axis, which is 0 here.
    let n = scene.mapped_normal(&scene.triangles[0], [1.0, 0.0, 0.0], Vec3::Z);
    let expected = Vec3::new(0.5, -0.5 / 255.0, 1.0 / 255.0).normalize();
    assert!(near(n, expected), "{n} {expected}");
}

#[test]
fn volumes_and_the_smoothest_lobes_are_read() {
    let material = |json: serde_json::Value| {
        let case = Case::with(|c| {
            c.document["extensionsUsed"] = json!(["KHR_materials_transmission", "KHR_materials_volume"]);
            c.document["materials"][0] = json;
        });
        let scene = case.load().unwrap();
        scene.materials[0].clone()
    };
    for (thickness, thin) in [(0.0, true), (0.01, false)] {
        let m = material(json!({ "emissiveFactor": [1, 1, 1], "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 1.0 },
            "KHR_materials_volume": { "thicknessFactor": thickness },
        } }));
        assert_eq!((m.surface, m.thin, m.frost), (Surface::Glass, thin, 0.0), "{thickness}");
    }
    for (roughness, surface) in [(0.0, Surface::Mirror), (0.1, Surface::Opaque)] {
        let m =
            material(json!({ "emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": { "roughnessFactor": roughness } }));
        assert_eq!((m.surface, m.metallic), (surface, 1.0));
    }
}

#[test]
fn lights_and_camera_are_read() {
    let turn = 0.5f32.sqrt();
    let case = Case::with(|c| {
        c.document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        c.document["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
            { "type": "point", "color": [1, 0.5, 0.25], "intensity": 1366.0 },
            { "type": "spot", "intensity": 2.0, "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } },
            { "type": "directional", "intensity": 3.0 },
        ] } });
        let light = |i: u32| json!({ "KHR_lights_punctual": { "light": i } });
        c.document["nodes"].as_array_mut().unwrap().extend([
            json!({ "translation": [1, 2, 3], "extensions": light(0) }),
            // A quarter turn about x: -z becomes -y.
            json!({ "rotation": [-turn, 0, 0, turn], "extensions": light(1) }),
            json!({ "extensions": light(2) }),
            json!({ "camera": 0, "translation": [0, 0, 5] }),
        ]);
        c.document["cameras"] =
            json!([{ "type": "perspective", "perspective": { "yfov": 0.5, "aspectRatio": 1.5, "znear": 0.1 } }]);
        c.document["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4]);
    });
    let scene = case.load().unwrap();
    let camera = scene.camera.unwrap();
    assert_eq!((camera.eye, camera.resolution), (Vec3::Z * 5.0, [720, 480]));
    assert!(near(camera.target, Vec3::Z * 4.0) && (camera.fov_y - 0.5f32.to_degrees()).abs() < 1e-4);
    let position = Vec3::new(1.0, 2.0, 3.0);
    assert_eq!(scene.lights[0], Light::Point { position, intensity: Vec3::new(1366.0, 683.0, 341.5) });
    let Light::Spot { direction, inner, outer, .. } = scene.lights[1] else { panic!("{:?}", scene.lights[1]) };
    assert!(near(direction, Vec3::NEG_Y) && (inner, outer) == (0.25, 0.5));
    assert_eq!(scene.lights[2], Light::Directional { direction: Vec3::NEG_Z, irradiance: Vec3::splat(3.0) });

    std::fs::write(case.path("scene.toml"), "model = \"a.gltf\"\nphotometric = true\n").unwrap();
    let photometric = scene::load(&case.path("scene.toml")).unwrap();
    let Light::Point { intensity, .. } = photometric.lights[0] else { panic!("{:?}", photometric.lights[0]) };
    assert!(near(intensity, Vec3::new(2.0, 1.0, 0.5)));
    // The model's camera is the default where the description has none.
    assert_eq!(photometric.camera, scene.camera);
}

#[test]
fn bad_gltf_is_refused() {
    let refused = |change: &dyn Fn(&mut Case), parts: &[&str]| {
        let error = Case::with(change).load().expect_err(&format!("{parts:?} should be refused")).to_string();
        assert!(error.contains("a.gltf") && parts.iter().all(|p| error.contains(p)), "{error}");
    };
    refused(&|c| c.document["bufferViews"][1]["byteLength"] = json!(200), &["bufferView 1", "beyond buffer 0"]);
    refused(&|c| c.document["bufferViews"][1]["byteOffset"] = json!(u64::MAX), &["bufferView 1"]);
    refused(&|c| c.document["accessors"][0]["count"] = json!(4), &["accessor 0", "beyond bufferView 0"]);
    refused(&|c| c.document["accessors"][0]["count"] = json!(u64::MAX), &["accessor 0"]);
    refused(&|c| c.document["accessors"][0]["byteOffset"] = json!(4), &["accessor 0"]);
    refused(&|c| c.document["accessors"][1]["count"] = json!(2), &["thing", "differ"]);
    refused(&|c| c.document["accessors"][0]["type"] = json!("VEC2"), &["accessor 0", "Vec2"]);
    refused(&|c| c.document["accessors"][3]["componentType"] = json!(5126), &["accessor 3", "F32"]);
    refused(&|c| c.document["accessors"][2]["componentType"] = json!(5123), &["accessor 2", "normalised"]);
    refused(&|c| c.document["bufferViews"][0]["byteStride"] = json!(4), &["stride 4"]);
    refused(&|c| c.document["buffers"][0]["byteLength"] = json!(1000), &["buffer 0", "1000"]);
    refused(&|c| c.document["buffers"][0]["uri"] = json!("none.bin"), &["buffer 0"]);
    refused(&|c| c.document["buffers"][0]["uri"] = json!("https://host/a.bin"), &["buffer 0", "https"]);
    refused(&|c| c.document["buffers"][0]["uri"] = json!("%ff.bin"), &["a.gltf", "buffer 0", "%ff.bin"]);
    refused(&|c| c.document["buffers"][0]["uri"] = json!("data:;base64,@@"), &["buffer 0"]);
    refused(&|c| c.bin[98] = 7, &["accessor 3", "vertex 7", "there are 3"]);
    refused(&|c| c.bin[0..4].copy_from_slice(&f32::NAN.to_le_bytes()), &["accessor 0", "not finite"]);
    refused(&|c| c.document["nodes"][0]["children"] = json!([0]), &["node 0", "ancestor"]);
    refused(&|c| c.document["nodes"][0]["mesh"] = json!(5), &["nodes[0].mesh"]);
    refused(&|c| c.document["nodes"][0]["scale"] = json!([1e38, 1e38, 1e38]), &["thing"]);
    refused(&|c| c.document["nodes"][0]["scale"] = json!([0, 0, 0]), &["thing", "area"]);
    refused(&|c| c.document["materials"][0]["emissiveFactor"] = json!([-1, 0, 0]), &["emissi"]);
    refused(&|c| c.document["extensionsRequired"] = json!(["ACME_packing"]), &["requires ACME_packing"]);
    refused(&|c| c.document = json!([1, 2]), &["a.gltf"]);
    refused(
        &|c| {
            c.document["images"] = json!([{ "uri": "none.png" }]);
            c.document["textures"] = json!([{ "source": 0 }]);
            c.document["materials"][0]["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": 0 } });
        },
        &["none.png"],
    );
    // A missing light, which the glTF crate does not detect.
    refused(
        &|c| {
            c.document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
            c.document["extensions"] = json!({ "KHR_lights_punctual": { "lights": [] } });
            c.document["nodes"][0]["extensions"] = json!({ "KHR_lights_punctual": { "light": 3 } });
        },
        &["a.gltf"],
    );
    let case = Case::new();
    let glb = case.glb();
    for length in [0, 3, 11, 19, 40, glb.len() - 1] {
        std::fs::write(case.path("a.glb"), &glb[..length]).unwrap();
        assert!(scene::load(&case.path("a.glb")).is_err(), "{length}");
    }
}

#[test]
fn accessors_without_a_view_are_zero() {
    let case = Case::with(|c| {
        c.document["accessors"][2].as_object_mut().unwrap().remove("bufferView");
    });
    assert_eq!(case.load().unwrap().uvs, [Vec2::ZERO; 3]);
}

#[test]
fn sparse_accessors_are_applied() {
    let case = Case::with(|c| {
        // Vertex 1 moves to (2, 0, 0).
        c.bin.extend([1, 0, 0, 0]);
        c.bin.extend([2.0f32, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()));
        c.document["buffers"][0]["byteLength"] = json!(120);
        let views = c.document["bufferViews"].as_array_mut().unwrap();
        views.push(json!({ "buffer": 0, "byteOffset": 104, "byteLength": 1 }));
        views.push(json!({ "buffer": 0, "byteOffset": 108, "byteLength": 12 }));
        c.document["accessors"][0]["sparse"] = json!({
            "count": 1, "indices": { "bufferView": 4, "componentType": 5121 }, "values": { "bufferView": 5 },
        });
    });
    assert_eq!(case.load().unwrap().positions, [Vec3::ZERO, Vec3::X * 2.0, Vec3::Y]);
    let beyond = Case::with(|c| {
        c.document = case.document.clone();
        c.bin = case.bin.clone();
        c.bin[104] = 3;
    });
    let error = beyond.load().unwrap_err().to_string();
    assert!(error.contains("sparse index 3"), "{error}");
}
