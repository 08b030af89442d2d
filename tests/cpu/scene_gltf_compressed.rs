//! glTF files with compressed geometry and textures, against the same files without compression.
//!
//! The files in `data/compressed` are made from one generated model: by glTF-Transform 4 (meshopt at level "high" with its filters,
//! draco by edge breaker) and by gltfpack 1 (`-cc -kn`), and the textures by ktx2-encoder 1. `vase.glb` is what they were made of.

use std::path::{Path, PathBuf};

use glam::Vec3;
use lightsum::scene::{self, Scene};
use serde_json::{Value, json};
use tempfile::TempDir;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cpu/data/compressed").join(name)
}

/// Greatest distances of positions, normals and texture coordinates of a scene's vertices from the nearest ones of another.
fn distances(of: &Scene, to: &Scene) -> [f32; 3] {
    let mut worst = [0.0f32; 3];
    for v in 0..of.positions.len() {
        let apart = |w: usize| {
            [
                (of.positions[v] - to.positions[w]).length(),
                (of.normals[v] - to.normals[w]).length(),
                (of.uvs[v] - to.uvs[w]).length(),
            ]
        };
        let sum = |d: &[f32; 3]| d.iter().sum::<f32>();
        let nearest = (0..to.positions.len()).map(apart).min_by(|a, b| sum(a).total_cmp(&sum(b))).unwrap();
        worst.iter_mut().zip(nearest).for_each(|(worst, d)| *worst = worst.max(d));
    }
    worst
}

fn area(scene: &Scene) -> f32 {
    (0..scene.triangles.len()).map(|i| scene.triangle_area(i)).sum()
}

/// Mean of the triangles' normals that point away from the vase's axis, by their areas: the winding.
fn outwards(scene: &Scene) -> f32 {
    let flux = |i: usize| {
        let [a, b, c] = scene.triangle_positions(i);
        let middle = (a + b + c) / 3.0;
        0.5 * (b - a).cross(c - a).dot(Vec3::new(middle.x, 0.0, middle.z).normalize_or_zero())
    };
    (0..scene.triangles.len()).map(flux).sum::<f32>() / area(scene)
}

#[test]
fn compressed_geometry_is_that_of_the_plain_file() {
    let plain = scene::load(&data("vase.glb")).unwrap();
    assert_eq!((plain.triangles.len(), plain.positions.len()), (240, 144));
    // The steps of positions within a box of 4, of octahedral normals, and of texture coordinates; and of a rotation's 12 bits, by an arm
    // of 4.
    let mut failed = Vec::new();
    for (name, keeps_uvs, bounds, rotation) in [
        ("vase meshopt.glb", true, [3e-4, 0.008, 2e-4], 1e-3),
        ("vase gltfpack.glb", false, [3e-4, 0.008, 0.0], 1e-3),
        ("vase draco.glb", true, [3e-4, 0.002, 2e-4], 0.0),
    ] {
        let mut plain = plain.clone();
        let mut packed = scene::load(&data(name)).unwrap();
        assert!(packed.ignored.is_empty(), "{name}: {:?}", packed.ignored);
        assert_eq!(packed.triangles.len(), plain.triangles.len(), "{name}");
        if !keeps_uvs {
            [&mut plain, &mut packed].into_iter().for_each(|scene| scene.uvs.fill(glam::Vec2::ZERO));
        }
        // At rest, and bent by its skin.
        for time in [None, Some(0.0), Some(0.8), Some(2.0)] {
            if let Some(time) = time {
                [&mut plain, &mut packed].into_iter().for_each(|scene| scene.set_pose(&[0], time));
            }
            let found = [distances(&packed, &plain), distances(&plain, &packed)];
            let areas = [area(&packed) / area(&plain) - 1.0, outwards(&packed) - outwards(&plain)];
            let mut bounds = bounds;
            if time.is_some() {
                bounds[0] += rotation;
            }
            println!("{name} at {time:?}: {found:?}, areas {areas:?}");
            let within = |worst: [f32; 3]| worst.iter().zip(bounds).all(|(d, bound)| *d <= bound);
            if !found.into_iter().all(within) || areas.iter().any(|x| x.abs() > 1e-3) {
                failed.push(format!("{name} at {time:?}: {found:?}, areas {areas:?}"));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

/// The JSON and the binary chunk of a GLB file.
fn parts(name: &str) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(data(name)).unwrap();
    let length = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let json = length(12);
    (serde_json::from_slice(&bytes[20..20 + json]).unwrap(), bytes[28 + json..28 + json + length(20 + json)].to_vec())
}

fn load(folder: &TempDir, (mut document, bin): (Value, Vec<u8>)) -> lightsum::Result<Scene> {
    document["buffers"][0]["uri"] = json!("a.bin");
    std::fs::write(folder.path().join("a.bin"), bin).unwrap();
    std::fs::write(folder.path().join("a.gltf"), document.to_string()).unwrap();
    scene::load(&folder.path().join("a.gltf"))
}

#[test]
fn damaged_compressed_files_are_errors() {
    let folder = TempDir::new().unwrap();
    let mut state = 7u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut refused = 0;
    for name in ["vase meshopt.glb", "vase gltfpack.glb", "vase draco.glb"] {
        let whole = parts(name);
        load(&folder, whole.clone()).unwrap();
        for _ in 0..150 {
            let (document, mut bin) = whole.clone();
            for _ in 0..=random(3) {
                let at = random(bin.len());
                bin[at] = random(256) as u8;
            }
            // A scene or an error: no panic, no hang.
            refused += usize::from(load(&folder, (document, bin)).is_err());
        }
    }
    assert!(refused > 100, "{refused}");
}

#[test]
fn both_names_of_meshopt_are_read() {
    const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
    let folder = TempDir::new().unwrap();
    let (document, bin) = parts("vase gltfpack.glb");
    let expected = load(&folder, (document.clone(), bin.clone())).unwrap();
    let renamed: Value = serde_json::from_str(&document.to_string().replace(NAMES[0], NAMES[1])).unwrap();
    assert!(renamed.to_string().contains(NAMES[1]) && renamed["extensionsRequired"] != document["extensionsRequired"]);
    let found = load(&folder, (renamed.clone(), bin.clone())).unwrap();
    assert_eq!(
        (found.positions, found.normals, found.triangles),
        (expected.positions, expected.normals, expected.triangles)
    );
    assert!(found.ignored.is_empty(), "{:?}", found.ignored);

    // The other form of attributes, and the filter that is new.
    let view = renamed["bufferViews"]
        .as_array()
        .unwrap()
        .iter()
        .position(|view| view["extensions"][NAMES[1]]["mode"] == "ATTRIBUTES");
    let view = view.unwrap();
    let at = renamed["bufferViews"][view]["extensions"][NAMES[1]]["byteOffset"].as_u64().unwrap_or(0) as usize;
    let mut newer = bin.clone();
    assert_eq!(newer[at], 0xa0);
    newer[at] = 0xa1;
    let error = load(&folder, (renamed.clone(), newer)).unwrap_err().to_string();
    let name = format!("bufferView {view}: {}", NAMES[1]);
    assert!(error.contains(&name) && error.contains("version 1"), "{error}");
    let mut filtered = renamed;
    filtered["bufferViews"][view]["extensions"][NAMES[1]]["filter"] = json!("COLOR");
    let error = load(&folder, (filtered, bin)).unwrap_err().to_string();
    assert!(error.contains(&name) && error.contains("COLOR"), "{error}");
}

#[test]
fn false_promises_are_refused_by_view_and_extension() {
    let folder = TempDir::new().unwrap();
    let refused = |name: &str, change: &dyn Fn(&mut Value), words: &[&str]| {
        let (mut document, bin) = parts(name);
        change(&mut document);
        let error = load(&folder, (document, bin)).expect_err(&format!("{words:?} should be refused")).to_string();
        assert!(error.contains("a.gltf") && words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    };
    let meshopt = |words: &[&str], change: &dyn Fn(&mut Value)| {
        let change = |document: &mut Value| change(&mut document["bufferViews"][0]);
        refused("vase gltfpack.glb", &change, &[&["bufferView 0"][..], words].concat());
    };
    const NAME: &str = "EXT_meshopt_compression";
    meshopt(&["cannot be in"], &|view| {
        view["extensions"][NAME]["count"] = json!(1u64 << 40);
        view["byteLength"] = json!(8 * (1u64 << 40));
    });
    meshopt(&["are not the"], &|view| view["extensions"][NAME]["count"] = json!(143));
    meshopt(&["are not the"], &|view| view["extensions"][NAME]["count"] = json!(u64::MAX));
    meshopt(&["byteStride"], &|view| view["extensions"][NAME]["byteStride"] = json!("8"));
    meshopt(&["beyond buffer 0"], &|view| view["extensions"][NAME]["byteLength"] = json!(1u64 << 40));
    meshopt(&["beyond buffer 9"], &|view| view["extensions"][NAME]["buffer"] = json!(9));
    meshopt(&["mode \"POINTS\""], &|view| view["extensions"][NAME]["mode"] = json!("POINTS"));
    meshopt(&["filter \"COLOR\""], &|view| view["extensions"][NAME]["filter"] = json!("COLOR"));
    meshopt(&["damaged"], &|view| view["extensions"][NAME]["mode"] = json!("INDICES"));
    // Without the extension there is nothing in the buffer that stands for the data.
    refused(
        "vase gltfpack.glb",
        &|d| drop(d["bufferViews"][0].as_object_mut().unwrap().remove("extensions")),
        &["bufferView 0"],
    );

    const DRACO: &str = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression";
    let draco = |words: &[&str], change: &dyn Fn(&mut Value)| {
        refused(
            "vase draco.glb",
            change,
            &[&["mesh 0, primitive 0", "KHR_draco_mesh_compression"][..], words].concat(),
        );
    };
    draco(&["bufferView"], &|d| *d.pointer_mut(DRACO).unwrap() = json!({ "bufferView": 77, "attributes": {} }));
    draco(&["attribute 55 for POSITION"], &|d| d.pointer_mut(DRACO).unwrap()["attributes"]["POSITION"] = json!(55));
    let accessor = |d: &mut Value, name: &str| {
        let index = d["meshes"][0]["primitives"][0]["attributes"][name].as_u64().unwrap() as usize;
        d["accessors"][index].take()
    };
    draco(&["promises 9"], &|d| {
        let index = d["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64().unwrap() as usize;
        let mut changed = accessor(d, "POSITION");
        changed["count"] = json!(9);
        d["accessors"][index] = changed;
    });
    draco(&["NORMAL differs"], &|d| {
        let index = d["meshes"][0]["primitives"][0]["attributes"]["NORMAL"].as_u64().unwrap() as usize;
        d["accessors"][index]["componentType"] = json!(5122);
    });
}

#[test]
fn basis_universal_textures_are_near_their_source() {
    // Red and green change across one another, which no line of colours in a block can follow: the best grey line in each leaves 12.97,
    // so much as ETC1S can reach, and the best of any direction 7.40, which UASTC halves by several lines in a block.
    let mut failed = Vec::new();
    for (name, bound) in [("uastc.ktx2", 4.2), ("uastc zstd.ktx2", 4.2), ("etc1s.ktx2", 13.3)] {
        let folder = TempDir::new().unwrap();
        let (mut document, bin) = parts("vase.glb");
        std::fs::copy(data(name), folder.path().join("a.ktx2")).unwrap();
        document["images"] = json!([{ "uri": "a.ktx2", "mimeType": "image/ktx2" }]);
        document["textures"] = json!([{ "extensions": { "KHR_texture_basisu": { "source": 0 } } }]);
        document["materials"][0]["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": 0 } });
        (document["extensionsUsed"], document["extensionsRequired"]) =
            (json!(["KHR_texture_basisu"]), json!(["KHR_texture_basisu"]));
        let scene = load(&folder, (document.clone(), bin.clone())).unwrap();
        assert!(scene.ignored.is_empty(), "{:?}", scene.ignored);
        let texture = &scene.textures[0];
        assert_eq!((texture.width, texture.height, texture.srgb), (20, 12, true));
        let mut square = 0.0;
        for (i, texel) in texture.texels.iter().enumerate() {
            let (x, y) = ((i % 20) as u8, (i / 20) as u8);
            let expected = [x * 12, y * 20, 255 - x * 6 - y * 6, if x < 10 { 255 } else { 128 }];
            square += texel.iter().zip(expected).map(|(a, b)| f64::from(a.abs_diff(b)).powi(2)).sum::<f64>();
        }
        let rmse = (square / (4.0 * 240.0)).sqrt();
        println!("{name}: RMSE {rmse} of 255");
        if rmse > bound {
            failed.push(format!("{name}: RMSE {rmse} of 255"));
        }

        // Damaged ones are errors, or other texels.
        let whole = std::fs::read(data(name)).unwrap();
        // Not the upper bytes of its size: a large image of few bytes may be a sound one.
        for at in (0..whole.len()).filter(|at| ![22, 23, 26, 27].contains(at)) {
            let mut damaged = whole.clone();
            damaged[at] ^= 0xff;
            std::fs::write(folder.path().join("a.ktx2"), &damaged).unwrap();
            let _ = load(&folder, (document.clone(), bin.clone()));
            if at % 16 == 0 {
                std::fs::write(folder.path().join("a.ktx2"), &whole[..at]).unwrap();
                let error = load(&folder, (document.clone(), bin.clone())).unwrap_err().to_string();
                assert!(error.contains("a.ktx2"), "{error}");
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}
