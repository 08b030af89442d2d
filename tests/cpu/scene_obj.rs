//! OBJ and MTL files as other programs write them.

use glam::{Vec2, Vec3};
use lightsum::light::emitters::Emitters;
use lightsum::scene::{self, Alpha, Material, Scene};
use tempfile::TempDir;

fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

fn load(files: &[(&str, &[u8])]) -> Scene {
    scene::load(&folder(files).path().join("a.obj")).unwrap()
}

fn refusal(files: &[(&str, &[u8])]) -> String {
    scene::load(&folder(files).path().join("a.obj")).unwrap_err().to_string()
}

/// A square of two triangles with all of its texture.
const SQUARE: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                      usemtl m\nf 1/1 2/2 3/3 4/4\n";

/// The material of the square.
fn square(statements: &str, images: &[(&str, &[u8])]) -> (Scene, Material) {
    let mtl = format!("newmtl m\n{statements}\n");
    let files = [&[("a.obj", SQUARE.as_bytes()), ("a.mtl", mtl.as_bytes())][..], images].concat();
    let scene = load(&files);
    let material = scene.materials[scene.triangles[0].material as usize].clone();
    (scene, material)
}

fn png(width: u32, height: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let image = image::RgbaImage::from_raw(width, height, texels.concat()).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Corners of all triangles, with their texture coordinates.
fn corners(scene: &Scene) -> Vec<[(Vec3, Vec2); 3]> {
    let corner = |v: u32| (scene.positions[v as usize], scene.uvs[v as usize]);
    scene.triangles.iter().map(|t| t.vertices.map(corner)).collect()
}

#[test]
fn spelling_does_not_matter() {
    let plain = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\no thing\nusemtl m\nf 1/1 2/2 3/3\n";
    let mtl = b"newmtl m\nKd 0.25 0.5 0.75\n";
    let expected = load(&[("a.obj", plain.as_bytes()), ("a.mtl", mtl)]);
    assert_eq!((expected.triangles.len(), expected.materials[0].base_color), (1, Vec3::new(0.25, 0.5, 0.75)));
    let spellings = [
        format!("\u{feff}{plain}"),
        plain.replace('\n', "\r\n"),
        plain.replace(' ', "\t"),
        plain.replace(' ', "  ").replace('\n', " \n  "),
        plain
            .replace('\n', " # comment / 1\n")
            .replace("a.mtl #", "a.mtl\n#")
            .replace("thing #", "thing\n#")
            .replace("m #", "m\n#"),
        plain.replace("1/1 2/2 3/3", "1/1 \\\n2/2 \\\n3/3"),
        plain.replace("1/1 2/2 3/3", "-3/-3 -2/-2 -1/-1"),
        plain.replace("1/1 2/2 3/3", "1/1/ 2/2/ 3/3/"),
        plain.replace("vt 0 1", "vt 0 1 0.5").replace("v 1 0 0", "v 1 0 0 2.0"),
        plain.replace("f ", "s off\nl 1 2 3\np 1\n# f 3 2 1\n#f 3 2 1\nf 1 2\ncall x y\nf "),
    ];
    for text in spellings {
        let found = load(&[("a.obj", text.as_bytes()), ("a.mtl", mtl)]);
        assert_eq!(corners(&found), corners(&expected), "{text:?}");
        assert_eq!((&found.objects, &found.materials), (&expected.objects, &expected.materials), "{text:?}");
    }
}

#[test]
fn names_in_latin_1_stay_different() {
    let obj = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\no T\xfcr\nusemtl T\xf6r\nf 1 2 3\nusemtl T\xfcr\nf 1 3 2\n";
    let mtl = b"newmtl T\xfcr\nKd 0.1 0.1 0.1\nnewmtl T\xf6r\nKd 0.2 0.2 0.2\n";
    let scene = load(&[("a.obj", obj), ("a.mtl", mtl)]);
    assert_eq!(scene.objects, ["Tür"]);
    let of = |i: usize| &scene.materials[scene.triangles[i].material as usize];
    assert_eq!((of(0).name.as_str(), of(0).base_color), ("Tör", Vec3::splat(0.2)));
    assert_eq!((of(1).name.as_str(), of(1).base_color), ("Tür", Vec3::splat(0.1)));
}

#[test]
fn kinds_of_faces_may_be_mixed() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0.5 0.25\nvn 0 0 1\nvn 1 0 0\no one\n\
                f 1 2 3\nf 1/1 2/1 3/1\nf 1//1 2//1 3//2\nf 1/1/2 2/1/1 3/1/1\nf 1/1/1 2 3//2\nf 1//2 2//2 3//2 4//2\n";
    let scene = load(&[("a.obj", text.as_bytes())]);
    assert_eq!(scene.objects, ["one"]);
    let smooth: Vec<bool> = scene.triangles.iter().map(|t| t.smooth).collect();
    assert_eq!(smooth, [false, false, true, true, false, true, true]);
    let (without, with) = (Vec2::ZERO, Vec2::new(0.5, 0.75));
    let uvs: Vec<Vec2> = corners(&scene).iter().map(|c| c[0].1).collect();
    assert_eq!(uvs, [without, with, without, with, without, without, without]);
    let normal = |triangle: usize, corner: usize| scene.normals[scene.triangles[triangle].vertices[corner] as usize];
    assert_eq!([normal(2, 0), normal(2, 2), normal(3, 0), normal(5, 1)], [Vec3::Z, Vec3::X, Vec3::X, Vec3::X]);
}

#[test]
fn materials_keep_their_names() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl later\nf 1 2 3\nusemtl Material #25\nf 1 2 3\nusemtl\nf 1 2 3\n\
                g\nusemtl later\nf 1 2 3\nmtllib a.mtl\n";
    let scene = load(&[("a.obj", text.as_bytes()), ("a.mtl", b"newmtl later\nKd 0.5 0 0\nnewmtl later\nKd 0 1 0\n")]);
    let names: Vec<&str> = scene.triangles.iter().map(|t| scene.materials[t.material as usize].name.as_str()).collect();
    assert_eq!(names, ["default", "later", "Material #25", "unnamed", "later"]);
    assert_eq!(scene.materials[scene.triangles[1].material as usize].base_color, Vec3::new(0.5, 0.0, 0.0));
    assert_eq!(scene.materials.len(), 4);
    assert_eq!(scene.objects, ["unnamed"]);
}

#[test]
fn polygons_keep_their_shape() {
    // An arrow head whose first corner sees a fan leave it.
    let text = "v 0 0 0\nv 2 1 0\nv 0 2 0\nv 1 1 0\nv 5 5 0\nf 1 2 3 4\n";
    let area = |text: &str| {
        let scene = load(&[("a.obj", text.as_bytes())]);
        let up = |c: &[(Vec3, Vec2); 3]| (c[1].0 - c[0].0).cross(c[2].0 - c[0].0).z;
        assert!(corners(&scene).iter().all(|c| up(c) > 0.0), "{text}: {:?}", corners(&scene));
        0.5 * corners(&scene).iter().map(up).sum::<f32>()
    };
    for order in ["1 2 3 4", "2 3 4 1", "3 4 1 2", "4 1 2 3"] {
        assert!((area(&text.replace("1 2 3 4", order)) - 1.0).abs() < 1e-6, "{order}");
    }
    // Repeated corners, and polygons without area beside a good one.
    assert!((area(&text.replace("f 1 2 3 4", "f 1 1 2 3 3 4 4")) - 1.0).abs() < 1e-6);
    assert!((area(&format!("{text}f 1 5 1 5\nf 1 1 1 1 1\nf 1 2 1 4 1\n")) - 1.0).abs() < 1e-6);
    assert!(refusal(&[("a.obj", b"v 0 0 0\nv 1 1 1\nf 1 2 1 2 1\n")]).contains("no triangle"));
}

#[test]
fn faces_of_many_corners_are_cut() {
    let face = |points: &[[usize; 2]]| {
        let lines: String = points.iter().map(|[x, y]| format!("v {x} {y} 0\n")).collect();
        let corners: String = (1..=points.len()).map(|i| format!(" {i}")).collect();
        format!("o plate\n{lines}f{corners}\n")
    };
    let n = 50_001;
    // A comb, whose last corner is far below its teeth.
    let mut comb: Vec<[usize; 2]> = (0..n).map(|i| [n - i, 9 + i % 2]).collect();
    comb.push([n / 2, 0]);
    let scene = load(&[("a.obj", face(&comb).as_bytes())]);
    assert_eq!(scene.triangles.len(), n - 1);
    let up = |c: &[(Vec3, Vec2); 3]| (c[1].0 - c[0].0).cross(c[2].0 - c[0].0).z;
    assert!(corners(&scene).iter().all(|c| up(c) > 0.0));
    // Its last corner pulled up through the teeth.
    comb[n] = [n / 2, 20];
    let message = refusal(&[("a.obj", face(&comb).as_bytes())]);
    assert!(message.contains("object \"plate\": a face of 50002 corners crosses or touches itself"), "{message}");
}

#[test]
fn bad_statements_are_refused_at_their_line() {
    let refused = |obj: &str, mtl: &str, parts: &[&str]| {
        let error = refusal(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes())]);
        for part in parts {
            assert!(error.contains(part), "{error:?} lacks {part:?}");
        }
    };
    let good = "newmtl m\n";
    for index in ["9223372036854775807", "-9223372036854775808", "4611686018427387905", "-5", "0", "5"] {
        for face in [format!("f {index} 2 3"), format!("f 1/{index} 2/2 3/3")] {
            refused(&format!("{SQUARE}{face}\n"), good, &["a.obj:12:", index, "4 are defined"]);
        }
        refused(&format!("{SQUARE}f 1//{index} 2 3\n"), good, &["a.obj:12:", "normal", index, "0 are defined"]);
    }
    refused(&format!("{SQUARE}o head\nv 1 2 1e39\n"), good, &["a.obj:13:", "head", "1e39"]);
    refused(&format!("{SQUARE}v 1 2 # 3\n"), good, &["a.obj:12:", "3 numbers"]);
    refused(&format!("{SQUARE}vt\n"), good, &["a.obj:12:", "texture coordinate"]);
    for (statement, part) in [
        ("Kd", "three numbers"),
        ("Ks 1 2", "three numbers"),
        ("Ke x", "\"x\""),
        ("Tf -1 0 0", "negative"),
        ("d -1", "below 0"),
        ("Tr", "a number"),
        ("Pr nan", "nan"),
        ("illum 2.5", "whole number"),
        ("map_d", "no file"),
        ("norm -bm 1", "no file"),
    ] {
        let word = statement.split(' ').next().unwrap();
        refused(SQUARE, &format!("{good}\n{statement}\n"), &["a.mtl:3:", "\"m\"", word, part]);
    }
}

#[test]
fn opacity_is_read() {
    let alpha = |statements: &str| square(statements, &[]).1.alpha;
    assert_eq!(alpha("Kd 1 1 1"), Alpha::Opaque);
    assert_eq!(alpha("d 1"), Alpha::Opaque);
    assert_eq!(alpha("d 0.25"), Alpha::Blend { opacity: 0.25 });
    assert_eq!(alpha("d -halo 0.25"), Alpha::Blend { opacity: 0.25 });
    assert_eq!(alpha("Tr 0.25"), Alpha::Blend { opacity: 0.75 });
    assert_eq!(alpha("Tr 0.25\nd 1"), Alpha::Opaque);
    assert_eq!(alpha("d 0.5\nillum 7"), Alpha::Opaque);
    let (scene, lamp) = square("Ke 1\nd 0.5", &[]);
    assert_eq!(lamp.emission, Vec3::ONE);
    assert!(scene.ignored.iter().any(|what| what.contains("opacity")), "{:?}", scene.ignored);

    let mask = png(2, 1, &[[0, 0, 0, 255], [255, 255, 255, 255]]);
    let wood = png(2, 1, &[[10, 20, 30, 255], [40, 50, 60, 255]]);
    let images: [(&str, &[u8]); 2] = [("mask.png", &mask), ("wood.png", &wood)];
    let (scene, leaf) = square("map_Kd wood.png\nmap_d mask.png\nd 0.5", &images);
    assert_eq!(leaf.alpha, Alpha::Blend { opacity: 0.5 });
    assert_eq!(scene.textures[leaf.base_texture.unwrap() as usize].texels, [[10, 20, 30, 0], [40, 50, 60, 255]]);
    // Without a colour map, and with a map that is all there.
    let (scene, leaf) = square("Kd 0.5 0.5 0.5\nmap_d mask.png", &images);
    assert_eq!((leaf.alpha, leaf.base_color), (Alpha::Blend { opacity: 1.0 }, Vec3::splat(0.5)));
    assert_eq!(scene.textures[leaf.base_texture.unwrap() as usize].texels, [[255, 255, 255, 0], [255; 4]]);
    let white = png(1, 1, &[[255; 4]]);
    assert_eq!(square("map_d white.png", &[("white.png", &white)]).1.alpha, Alpha::Opaque);
}

#[test]
fn normal_maps_are_used_and_other_maps_named() {
    let bumps = png(1, 1, &[[128, 128, 255, 255]]);
    let images: [(&str, &[u8]); 1] = [("n.png", &bumps)];
    let (scene, material) = square("norm -bm 0.5 n.png\nbump n.png\nmap_Bump n.png\nmap_Ks n.png", &images);
    let texture = &scene.textures[material.normal_texture.unwrap() as usize];
    assert_eq!((texture.srgb, texture.texels[0], material.normal_scale), (false, [128, 128, 255, 255], 0.5));
    assert_eq!(material.base_texture, None);
    assert_eq!(scene.ignored, ["bump", "map_Bump", "map_Ks"]);
    // One image, as colour and as normals.
    let (scene, material) = square("norm n.png\nmap_Kd n.png", &images);
    assert_eq!(scene.textures.len(), 2);
    assert_ne!(material.base_texture, material.normal_texture);
    // A map of opacity or normals that is missing is no reason to show nothing.
    let (scene, material) = square("norm none.png\nmap_d none.png", &[]);
    assert_eq!((material.normal_texture, material.base_texture, material.alpha), (None, None, Alpha::Opaque));
    assert_eq!(scene.ignored.len(), 2);
    assert!(scene.ignored.iter().all(|what| what.contains("none.png")), "{:?}", scene.ignored);
}

#[test]
fn a_lamp_with_a_texture_is_that_of_gltf() {
    let half = png(2, 1, &[[0, 0, 0, 255], [255, 128, 0, 255]]);
    let images: [(&str, &[u8]); 1] = [("half.png", &half)];
    let (scene, lamp) = square("Ke 4 2 1\nmap_Ke -clamp on half.png", &images);
    // The same square: texture coordinates of glTF run downwards.
    let numbers =
        [[0.0f32, 0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0, 1.0], [1.0, 1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0]];
    let bytes: Vec<u8> = numbers.concat().iter().flat_map(|x| x.to_le_bytes()).chain([0, 1, 2, 0, 2, 3]).collect();
    let gltf = serde_json::json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_materials_emissive_strength"],
        "buffers": [{ "uri": "a.bin", "byteLength": 86 }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 80, "byteStride": 20 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 6 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR" },
        ],
        "images": [{ "uri": "half.png" }],
        "samplers": [{ "wrapS": 33071, "wrapT": 33071 }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "materials": [{
            "emissiveFactor": [1, 0.5, 0.25],
            "emissiveTexture": { "index": 0 },
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4 } },
        }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0,
        }] }],
        "nodes": [{ "mesh": 0 }],
        "scenes": [{ "nodes": [0] }],
        "scene": 0,
    });
    let gltf = gltf.to_string();
    let twin = folder(&[("a.gltf", gltf.as_bytes()), ("a.bin", &bytes), images[0]]);
    let twin = scene::load(&twin.path().join("a.gltf")).unwrap();
    assert_eq!(lamp.emission, Vec3::new(4.0, 2.0, 1.0));
    for scene in [&scene, &twin] {
        assert!(!scene.emission_is_relative && scene.environment.is_none() && scene.ignored.is_empty());
        let [red, green, black] = [0.9, 0.5, 0.1].map(|x| {
            // The first triangle spans (0, 0), (1, 0) and (1, 1).
            scene.emission_at(&scene.triangles[0], [1.0 - x, x - 0.05, 0.05])
        });
        assert_eq!((red.x, black), (4.0, Vec3::ZERO));
        assert!(red.y > 0.0 && red.z == 0.0 && green.x > 1.9 && green.x < 2.1, "{red} {green}");
    }
    let powers = [&scene, &twin].map(|scene| Emitters::of(scene, true).unwrap().power);
    assert_eq!(powers[0], powers[1]);
    // A square of area 1, half of it black.
    assert!((powers[0].x / (0.5 * 4.0 * std::f32::consts::PI) - 1.0).abs() < 1e-3, "{}", powers[0]);
}

#[test]
fn emission_textures_are_read() {
    let half = png(2, 1, &[[0, 0, 0, 255], [255; 4]]);
    let black = png(1, 1, &[[0, 0, 0, 255]]);
    let images: [(&str, &[u8]); 2] = [("half.png", &half), ("black.png", &black)];
    // Exporters leave `Ke` out, or black: such a lamp glows for a screen.
    for statements in ["map_Ke half.png", "Ke 0 0 0\nmap_Ke half.png"] {
        let (scene, lamp) = square(statements, &images);
        assert_eq!((lamp.emission, lamp.emission_texture), (Vec3::ONE, Some(0)), "{statements}");
        assert!(scene.textures[0].srgb && scene.emission_is_relative && scene.environment.is_some());
    }
    // One image, as colour and as emission, and placed with the other maps.
    let (scene, lamp) = square("map_Kd -s 2 2 half.png\nKe 3 3 3\nmap_Ke -s 2 2 half.png", &images);
    assert_eq!((lamp.base_texture, lamp.emission_texture, scene.textures.len()), (Some(0), Some(0), 1));
    assert!(scene.ignored.is_empty() && scene.uvs.contains(&Vec2::new(2.0, -1.0)), "{:?}", scene.uvs);
    // Black, and missing: only the latter keeps `Ke`.
    let (scene, lamp) = square("Ke 3 3 3\nmap_Ke black.png", &images);
    assert_eq!((lamp.emission, lamp.emission_texture), (Vec3::ZERO, None));
    assert!(scene.environment.is_some());
    let (scene, lamp) = square("Ke 3 3 3\nmap_Ke none.png", &images);
    assert_eq!((lamp.emission, lamp.emission_texture), (Vec3::splat(3.0), None));
    assert_eq!(scene.ignored, ["map_Ke none.png (cannot be read)"]);
    assert_eq!(square("map_Ke none.png", &images).1.emission, Vec3::ZERO);
    // A colour map that is missing is an error, also where the same file should be emission.
    let mtl = "newmtl l\nmap_Ke none.png\nnewmtl m\nmap_Kd none.png\n";
    let model = format!("{SQUARE}usemtl l\nf 1/1 2/2 3/3\n");
    for model in [model.as_str(), &model.replace(" m\n", " x\n").replace(" l\n", " m\n").replace(" x\n", " l\n")] {
        let message = refusal(&[("a.obj", model.as_bytes()), ("a.mtl", mtl.as_bytes())]);
        assert!(message.contains("a.mtl:4:") && message.contains("none.png"), "{message}");
    }
}

#[test]
fn emission_of_floats_keeps_its_range() {
    let pixels = image::Rgb32FImage::from_raw(2, 1, vec![0.5, 0.25, 0.125, 40.0, 20.0, 0.0]).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    pixels.write_to(&mut bytes, image::ImageFormat::OpenExr).unwrap();
    let bytes = bytes.into_inner();
    let images: [(&str, &[u8]); 1] = [("glow.exr", &bytes)];
    let (scene, lamp) = square("Ke 2 2 2\nmap_Ke -clamp on glow.exr\nmap_Kd glow.exr", &images);
    assert_eq!((lamp.emission, scene.textures.len()), (Vec3::splat(80.0), 2), "one is scaled, one cut off at 1");
    let [color, glow] = [lamp.base_texture, lamp.emission_texture].map(|t| &scene.textures[t.unwrap() as usize]);
    for (x, wanted) in [Vec3::new(1.0, 0.5, 0.25), Vec3::new(80.0, 40.0, 0.0)].into_iter().enumerate() {
        let got = lamp.emission * glow.linear_texel(x as u32, 0).truncate();
        // Eight bits of sRGB.
        assert!(((got - wanted) / wanted.max(Vec3::ONE)).abs().max_element() < 0.02, "{got} of {wanted}");
    }
    assert!((color.linear_texel(0, 0).truncate() - Vec3::new(0.5, 0.25, 0.125)).abs().max_element() < 0.005);
    assert_eq!(color.linear_texel(1, 0).truncate(), Vec3::new(1.0, 1.0, 0.0));
}

#[test]
fn maps_are_placed_by_their_options() {
    let wood = png(1, 1, &[[9; 4]]);
    let images: [(&str, &[u8]); 1] = [("my wood.png", &wood)];
    let (scene, _) = square("map_Kd -s 2 3 1 -o 0.5 -0.25 my wood.png", &images);
    for triangle in corners(&scene) {
        for (position, uv) in triangle {
            // v runs upwards in the file.
            let expected = Vec2::new(0.5 + 2.0 * position.x, 1.0 - (3.0 * position.y - 0.25));
            assert!((uv - expected).length() < 1e-6, "{position} {uv}");
        }
    }
    let (scene, _) = square("map_Kd my wood.png\nnorm -s 2 2 my wood.png\nmap_Kd -mm 0 2 my wood.png", &images);
    assert_eq!(scene.ignored.len(), 2, "{:?}", scene.ignored);
    assert!(scene.ignored.iter().any(|what| what.starts_with("norm -s")));
}

#[test]
fn far_unused_vertices_do_not_move_the_origin() {
    let near = load(&[("a.obj", b"v 1e6 1e6 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 2 3 4\n")]);
    assert_eq!((near.origin, near.positions.len()), (glam::DVec3::ZERO, 3));
}
