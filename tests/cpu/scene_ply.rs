//! PLY models.

use glam::{DVec3, Vec3};
use lightsum::scene::{self, Scene};

/// Loads a file of these bytes.
fn load(bytes: &[u8]) -> Result<Scene, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ply");
    std::fs::write(&path, bytes).unwrap();
    scene::load(&path).map_err(|e| e.to_string())
}

const HEADER: &str = "comment a square and a triangle\n\
    element other 1\nproperty list uchar short numbers\nproperty double last\n\
    element vertex 5\nproperty float x\nproperty double y\nproperty float z\n\
    property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nproperty short flag\n";

/// Position, normal, texture coordinates, colour.
type Corner = ([f32; 3], [f32; 3], [f32; 2], [u8; 3]);

const VERTICES: [Corner; 5] = [
    ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0], [255, 0, 0]),
    ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0], [255, 255, 255]),
    ([1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.25], [0, 0, 0]),
    ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0], [188, 188, 188]),
    ([0.5, 0.5, 2.0], [0.0, 0.6, 0.8], [0.5, 0.5], [255, 255, 255]),
];

const FACES: [&[i32]; 2] = [&[0, 1, 2, 3], &[0, 1, 4]];

/// The same model in every form: `little` is the byte order, or text.
fn encoded(little: Option<bool>, count: &str, index: &str) -> Vec<u8> {
    let format = match little {
        None => "ascii",
        Some(true) => "binary_little_endian",
        Some(false) => "binary_big_endian",
    };
    let faces =
        format!("element face 2\nproperty uchar skipped\nproperty list {count} {index} vertex_indices\nend_header\n");
    let mut file = format!("ply\nformat {format} 1.0\n{HEADER}{faces}").into_bytes();
    let mut put = |kind: &str, value: f64| {
        let mut bytes = match kind {
            _ if little.is_none() => return file.extend(format!("{value} ").into_bytes()),
            "char" => vec![value as i8 as u8],
            "uchar" => vec![value as u8],
            "short" => (value as i16).to_le_bytes().to_vec(),
            "ushort" => (value as u16).to_le_bytes().to_vec(),
            "int" => (value as i32).to_le_bytes().to_vec(),
            "uint" => (value as u32).to_le_bytes().to_vec(),
            "float" => (value as f32).to_le_bytes().to_vec(),
            _ => value.to_le_bytes().to_vec(),
        };
        if little == Some(false) {
            bytes.reverse();
        }
        file.extend(bytes);
    };
    [("uchar", 2.0), ("short", 7.0), ("short", -7.0), ("double", 0.5)].iter().for_each(|(k, v)| put(k, *v));
    for (p, n, uv, color) in VERTICES {
        put("float", f64::from(p[0]));
        put("double", f64::from(p[1]));
        put("float", f64::from(p[2]));
        n.iter().chain(&uv).for_each(|&x| put("float", f64::from(x)));
        color.iter().for_each(|&c| put("uchar", f64::from(c)));
        put("short", -1.0);
    }
    for face in FACES {
        put("uchar", 1.0);
        put(count, face.len() as f64);
        face.iter().for_each(|&v| put(index, f64::from(v)));
    }
    file
}

#[test]
fn all_forms_give_the_same_scene() {
    for little in [None, Some(true), Some(false)] {
        for count in ["uchar", "char", "ushort", "int"] {
            for index in ["int", "uint", "ushort", "short", "uchar", "char"] {
                let scene = load(&encoded(little, count, index)).unwrap();
                let corners: Vec<[u32; 3]> = scene.triangles.iter().map(|t| t.vertices).collect();
                assert_eq!(corners, [[0, 1, 2], [0, 2, 3], [0, 1, 4]], "{little:?} {count} {index}");
                for (i, (p, n, uv, color)) in VERTICES.iter().enumerate() {
                    assert_eq!(scene.positions[i], Vec3::from_array(*p));
                    assert!((scene.normals[i] - Vec3::from_array(*n)).length() < 1e-6);
                    assert_eq!(scene.uvs[i].to_array(), [uv[0], 1.0 - uv[1]]);
                    let linear = color.map(|c| lightsum::bsdf::srgb_to_linear(f32::from(c) / 255.0));
                    assert!((scene.colors[i] - Vec3::from_array(linear)).abs().max_element() < 1e-6);
                }
                assert!(scene.triangles.iter().all(|t| t.smooth));
                assert_eq!(scene.materials[0].base_color, Vec3::ONE, "the colours are the reflectance");
                assert!(scene.environment.is_some(), "a model without light gets a sky");
            }
        }
    }
}

#[test]
fn a_model_without_normals_and_colours_is_flat_and_grey() {
    let text = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_index\nend_header\n\
        0 0 0\n2 0 0\n2 1 0\n1 1 0\n1 2 0\n0 2 0\n6 0 1 2 3 4 5";
    let scene = load(text.as_bytes()).unwrap();
    assert_eq!(scene.triangles.len(), 4);
    let area: f32 = (0..4).map(|i| scene.triangle_area(i)).sum();
    assert!((area - 3.0).abs() < 1e-6, "an L of area 3 keeps it: {area}");
    assert!(scene.triangles.iter().all(|t| !t.smooth) && scene.colors.is_empty());
    assert_eq!(scene.materials[0].base_color, Vec3::splat(0.8));
}

#[test]
fn far_models_keep_their_precision() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        500000.125 4000000.5 10\n500000.25 4000000.5 10\n500000.125 4000000.625 10\n3 0 1 2\n";
    let scene = load(text.as_bytes()).unwrap();
    assert_eq!(scene.to_world(scene.positions[1]), DVec3::new(500_000.25, 4_000_000.5, 10.0));
}

#[test]
fn corners_may_have_texture_coordinates_of_their_own() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n\
        0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0.5 0.5 0.5 0.75 0.25 0.25\n";
    let scene = load(text.as_bytes()).unwrap();
    let uvs: Vec<[f32; 2]> = scene.triangles[1].vertices.iter().map(|&v| scene.uvs[v as usize].to_array()).collect();
    assert_eq!(uvs, [[0.5, 0.5], [0.5, 0.25], [0.25, 0.75]]);
}

#[test]
fn faces_of_many_corners_are_cut() {
    let n = 50_001;
    // A comb, whose last corner is below or above its teeth.
    let model = |last: usize| {
        let points: String = (0..n).map(|i| format!("{} {} 0\n", n - i, 9 + i % 2)).collect();
        let corners: String = (0..=n).map(|i| format!(" {i}")).collect();
        let (last, count) = (format!("{} {last} 0\n", n / 2), n + 1);
        let header = format!("element vertex {count}\nproperty float x\nproperty float y\nproperty float z\n");
        let list = "element face 1\nproperty list int int vertex_indices\n";
        format!("ply\nformat ascii 1.0\n{header}{list}end_header\n{points}{last}{count}{corners}\n")
    };
    assert_eq!(load(model(0).as_bytes()).unwrap().triangles.len(), n - 1);
    let message = load(model(20).as_bytes()).unwrap_err();
    assert!(message.contains("face 0: a face of 50002 corners crosses or touches itself"), "{message}");
}

#[test]
fn clouds_and_broken_files_are_refused_with_the_reason() {
    let vertex = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let face = "element face 1\nproperty list uchar int vertex_indices\n";
    let ascii = |middle: &str, data: &str| format!("ply\nformat ascii 1.0\n{middle}end_header\n{data}");
    let points = "0 0 0\n1 0 0\n0 1 0\n";
    let splats = "property float f_dc_0\nproperty float scale_0\nproperty float rot_0\n";
    for (text, reason) in [
        (ascii(vertex, points), "a cloud of 3 points"),
        (ascii(&format!("{vertex}{face}").replace("face 1", "face 0"), points), "a cloud of 3 points"),
        (ascii(&format!("{vertex}{splats}"), ""), "Gaussian splats"),
        (ascii(&format!("{vertex}{face}").replace(" y", " w"), points), "no property \"y\""),
        (
            ascii(&format!("{vertex}{face}").replace("vertex_indices", "corners"), points),
            "no property \"vertex_indices\"",
        ),
        (ascii(&format!("{vertex}element tristrips 1\nproperty list int int vertex_indices\n"), points), "strips"),
        (ascii(&format!("{vertex}{face}"), &format!("{points}3 0 1")), "ends too early"),
        (ascii(&format!("{vertex}{face}"), &format!("{points}3 0 1 3\n")), "vertex 3 does not exist, there are 3"),
        (ascii(&format!("{vertex}{face}"), &format!("{points}3 0 1 -1\n")), "vertex -1 does not exist"),
        (ascii(&format!("{vertex}{face}"), "0 0 0\n1 0 zero\n"), ".ply:11: element \"vertex\""),
        (ascii(&format!("{vertex}{face}"), "0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n"), "vertex 1 is at"),
        (ascii(&format!("{vertex}{face}").replace("vertex 3", "vertex 18446744073709551615"), points), "vertex"),
        (ascii(&format!("{vertex}{face}").replace("vertex 3", "vertex -3"), points), ".ply:3: Invalid element count"),
        (ascii(&format!("{vertex}{face}"), &format!("{points}2000000000 0 1 2\n")), "Failed to parse u8"),
        (ascii("element empty 18446744073709551615\n", ""), "no vertices"),
        (String::from("ply\nformat binary_middle_endian 1.0\nend_header\n"), ".ply:2: Unknown format"),
        (String::from("plyx\n"), "must start with 'ply'"),
        (String::new(), "must start with 'ply'"),
    ] {
        let message = load(text.as_bytes()).unwrap_err();
        assert!(message.contains(reason), "{message:?} does not say {reason:?}");
    }
    // An element without properties has rows that take no room: their number must not matter.
    let endless = format!("element empty 18446744073709551615\n{vertex}{face}");
    assert!(load(ascii(&endless, &format!("{points}3 0 1 2\n")).as_bytes()).is_ok());
}

#[test]
fn no_prefix_of_a_file_panics() {
    for little in [None, Some(true), Some(false)] {
        let whole = encoded(little, "uchar", "int");
        for length in 0..whole.len() - 1 {
            assert!(load(&whole[..length]).is_err(), "{length} bytes");
        }
        for at in (0..whole.len()).step_by(3) {
            let mut changed = whole.clone();
            changed[at] ^= 0x55;
            let _ = load(&changed);
        }
    }
}
