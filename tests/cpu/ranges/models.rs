//! Numbers of models: of materials in MTL, of glTF, of PLY and of Mitsuba's XML. Each message names its file and the range, or says what
//! is no number.

use std::fs;
use std::path::Path;

use lightsum::scene;

use super::{ANY, FRACTIONS, LENGTHS, NO_NUMBERS, Number, check, folder};

/// JSON has no words for what is no number; these are too large for single precision.
const TOO_LARGE: [&str; 2] = ["1e39", "-1e39"];

/// Reads a file of a folder; the message must name the file or that beside it.
fn load(folder: &Path, name: &str, beside: &str) -> Result<(), String> {
    scene::load(&folder.join(name)).map(drop).map_err(|error| {
        let message = error.to_string();
        assert!(message.contains(name) || message.contains(beside), "{message}");
        message
    })
}

/// Of a quantity without an upper limit.
const FROM_0: (&[&str], &[&str]) = (&["0", "-0", "1e-45", "3.4e38"], &["-1e-45", "-1", "1e39"]);

#[test]
fn numbers_of_mtl() {
    let folder = folder();
    let path = folder.path();
    let obj =
        "mtllib a.mtl\nusemtl m\nv 0 0 0 1 1 1\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\nusemtl lamp\nf 3/1 2/1 1/1\n";
    fs::write(path.join("a.obj"), obj).unwrap();
    let read = |text: &str| {
        fs::write(path.join("a.mtl"), format!("newmtl m\n{text}\nnewmtl lamp\nKe 1 1 1\n")).unwrap();
        load(path, "a.obj", "a.mtl:")
    };
    let numbers: &[Number] = &[
        // Above 1 counts as 1, as programs write it.
        ("Kd @ 0.5 0.5", FROM_0.0, FROM_0.1),
        ("Kd @", FROM_0.0, FROM_0.1),
        ("Ks 0 @ 0", FROM_0.0, FROM_0.1),
        ("illum 7\nTf 1 1 @", FROM_0.0, FROM_0.1),
        ("d @", FROM_0.0, FROM_0.1),
        ("d -halo @", FROM_0.0, FROM_0.1),
        ("Tr @", FROM_0.0, FROM_0.1),
        ("Pr @", FROM_0.0, FROM_0.1),
        ("Pm @", FROM_0.0, FROM_0.1),
        ("Ns @", FROM_0.0, FROM_0.1),
        ("Ke 1 @ 1", FROM_0.0, FROM_0.1),
        ("Ni @", &["0.001", "1", "10"], &["0.0009", "0", "-0", "-1", "10.1", "1e39"]),
        ("illum @", &["0", "9", "10", "255", "-1"], &["1.5", "1e9", "99999999999999999999"]),
    ];
    check(numbers, &NO_NUMBERS, |text| {
        read(text).map_err(|message| match message.contains("a.mtl:") || message.contains("material \"m\"") {
            true => message,
            false => panic!("no line: {message}"),
        })
    });
}

#[test]
fn numbers_of_obj() {
    let folder = folder();
    let path = folder.path();
    fs::write(path.join("a.mtl"), "newmtl lamp\nKe 1 1 1\n").unwrap();
    let places: (&[&str], &[&str]) = (&["0", "-0", "1e-30", "9e8", "-9e8"], &["4e38", "-4e38", "1e300"]);
    let numbers: &[Number] = &[
        ("v 0 @ 0 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3", places.0, places.1),
        // The weight of a curve's point counts for nothing.
        ("v 0 0 0 @\nv 1 0 0\nv 0 1 1\nf 1 2 3", &["0", "-1", "1e30", "1e39", "nan"], &[]),
        // Colours beyond 1 count as 1, as some programs write 255.
        ("v 0 0 0 0 @ 0\nv 1 0 0\nv 0 1 1\nf 1 2 3", &["0", "-0", "-1", "1", "255", "1e30"], &["1e39"]),
        ("v 0 0 0\nv 1 0 0\nv 0 1 1\nvn 0 @ 0\nf 1//1 2//1 3//1", &["0", "-0", "1", "-1e15", "1e30"], &["1e39"]),
        ("v 0 0 0\nv 1 0 0\nv 0 1 1\nvt 0 @\nf 1/1 2/1 3/1", &["0", "-0", "1e9", "-1e9", "3e38"], &["4e38"]),
        ("v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 @", &["3", "-1"], &["0", "-0", "4", "-4", "1.5", "4294967296", "1e39"]),
    ];
    let weights = |text: &str| text.starts_with("v 0 0 0 nan") || text.starts_with("v 0 0 0 inf");
    check(numbers, &[], |text| {
        fs::write(path.join("a.obj"), format!("mtllib a.mtl\nusemtl lamp\n{text}\n")).unwrap();
        load(path, "a.obj", "a.mtl")
    });
    let others: Vec<Number> =
        numbers.iter().filter(|(text, ..)| !weights(&text.replace('@', "nan"))).copied().collect();
    check(&others, &NO_NUMBERS, |text| {
        fs::write(path.join("a.obj"), format!("mtllib a.mtl\nusemtl lamp\n{text}\n")).unwrap();
        load(path, "a.obj", "a.mtl")
    });
}

/// A triangle that shines, in glTF: members of its material, of its node, and of the document.
fn gltf([material, node, document]: [&str; 3]) -> String {
    // Three points of three numbers: 0 0 0, 1 0 0, 0 1 0.
    let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let members = |text: &str| if text.is_empty() { String::new() } else { format!(", {text}") };
    let (material, node, document) = (members(material), members(node), members(document));
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0, 1]}}],
        "nodes": [{{"mesh": 0, "name": "lamp"}}, {{"mesh": 1, "name": "thing"{node}}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "material": 0}}]}},
                   {{"primitives": [{{"attributes": {{"POSITION": 0}}, "material": 1}}]}}],
        "materials": [{{"name": "lamp", "emissiveFactor": [1, 1, 1]}}, {{"name": "m"{material}}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}],
        "buffers": [{{"uri": "data:application/octet-stream;base64,{data}", "byteLength": 36}}]{document}}}"#
    )
}

#[test]
fn numbers_of_gltf() {
    let folder = folder();
    let path = folder.path();
    let read = |text: &str| {
        let parts: Vec<&str> = text.split('|').collect();
        fs::write(path.join("a.gltf"), gltf([parts[0], parts[1], parts[2]])).unwrap();
        load(path, "a.gltf", "a.gltf")
    };
    let share = (&["0.0", "-0.0", "1e-45", "1"][..], &["-1e-45", "-1", "1.0000002"][..]);
    let from_0 = (&["0.0", "-0.0", "1e-45", "3.4e38"][..], &["-1e-45", "-1"][..]);
    let places = (&["0.0", "-0.0", "9e8", "-9e8"][..], &["1e300"][..]);
    let turn: &[&str] = &["0.0", "-0.0", "1e9", "-3.4e38"];
    let light = |members: &str| {
        format!(
            r#"|"extensions": {{"KHR_lights_punctual": {{"light": 0}}}}|"extensionsUsed": ["KHR_lights_punctual"],
            "extensions": {{"KHR_lights_punctual": {{"lights": [{{{members}}}]}}}}"#
        )
    };
    let extension = |name: &str, members: &str| {
        format!(r#""extensions": {{"{name}": {{{members}}}}}||"extensionsUsed": ["{name}"]"#)
    };
    let camera = |members: &str| format!(r#"|"camera": 0|"cameras": [{{{members}}}]"#);
    let lights = [
        (light(r#""type": "point", "intensity": @"#), from_0),
        (light(r#""type": "point", "color": [1, @, 1]"#), from_0),
        (light(r#""type": "directional", "intensity": @"#), from_0),
        (
            light(r#""type": "spot", "spot": {"outerConeAngle": 0.5, "innerConeAngle": @}"#),
            (&["0.0", "-0.0", "0.49"][..], &["-0.1", "0.5", "2"][..]),
        ),
        (
            light(r#""type": "spot", "spot": {"outerConeAngle": @}"#),
            (&["0.001", "1.5707963"][..], &["0.0", "-0.0", "-1"][..]),
        ),
        (extension("KHR_materials_emissive_strength", r#""emissiveStrength": @"#), from_0),
        (
            extension("KHR_materials_ior", r#""ior": @"#),
            (&["0.001", "1", "10", "0.0", "-0.0"][..], &["0.0009", "-1", "10.1"][..]),
        ),
        (extension("KHR_materials_transmission", r#""transmissionFactor": @"#), share),
        (extension("KHR_materials_specular", r#""specularFactor": @"#), share),
        (extension("KHR_materials_specular", r#""specularColorFactor": [1, @, 1]"#), from_0),
        (extension("KHR_materials_volume", r#""thicknessFactor": @"#), from_0),
        (extension("KHR_materials_volume", r#""attenuationColor": [1, @, 1]"#), share),
        (
            camera(r#""type": "perspective", "perspective": {"znear": 0.1, "yfov": @}"#),
            (&["0.001", "3.14"][..], &["0.0", "-0.0", "-1", "3.1416"][..]),
        ),
        (
            camera(r#""type": "orthographic", "orthographic": {"znear": 0, "zfar": 9, "xmag": 1, "ymag": @}"#),
            (&["0.001", "-1", "4.9e8"][..], &["0.0", "-0.0", "1e9"][..]),
        ),
    ];
    let mut numbers: Vec<Number> = vec![
        // Colours and opacities above 1 count as 1.
        (r#""pbrMetallicRoughness": {"baseColorFactor": [1, @, 1, 1]}||"#, from_0.0, from_0.1),
        (r#""alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, @]}||"#, from_0.0, from_0.1),
        (r#""pbrMetallicRoughness": {"metallicFactor": @}||"#, share.0, share.1),
        (r#""pbrMetallicRoughness": {"roughnessFactor": @}||"#, share.0, share.1),
        (r#""emissiveFactor": [1, @, 1]||"#, from_0.0, from_0.1),
        (
            r#""alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}, "alphaCutoff": @||"#,
            from_0.0,
            from_0.1,
        ),
        (r#"|"translation": [@, 0, 0]|"#, places.0, places.1),
        (r#"|"scale": [1, @, 1]|"#, &["1e-3", "-1", "9e8"], &["1e300"]),
        (r#"|"rotation": [0, @, 0, 1]|"#, &["0.0", "-0.0", "1", "-1"], &["1e300"]),
        (r#"|"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, @, 0, 0, 1]|"#, places.0, places.1),
    ];
    numbers.extend(lights.iter().map(|(text, (good, bad))| (text.as_str(), *good, *bad)));
    check(&numbers, &TOO_LARGE, read);
    // Infinite is the default: a body that absorbs nothing.
    let distance = extension("KHR_materials_volume", r#""attenuationDistance": @"#);
    check(&[(distance.as_str(), &["0.0", "-0.0", "1e-45", "3.4e38", "1e39"], &["-1e-45", "-1", "-1e39"])], &[], read);
    // Transforms of texture coordinates count only with a texture; every finite number is allowed.
    let moved = extension("KHR_materials_anisotropy", r#""anisotropyStrength": 0.5, "anisotropyRotation": @"#);
    check(&[(moved.as_str(), turn, &[])], &TOO_LARGE, read);
}

#[test]
fn numbers_of_ply() {
    let folder = folder();
    let path = folder.path();
    let names = ["x", "y", "z", "nx", "ny", "nz", "u", "v", "red", "green", "blue"];
    let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let read = |text: &str| {
        let header = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\n{properties}element face 1\nproperty list uchar int vertex_indices\n"
        );
        let rest = "1 0 0 0 0 1 0 0 1 1 1\n0 1 0 0 0 1 0 0 1 1 1\n3 0 1 2\n";
        fs::write(path.join("a.ply"), format!("{header}end_header\n{text}\n{rest}")).unwrap();
        fs::write(path.join("a.toml"), "model = \"a.ply\"\n[environment]\nradiance = [1, 1, 1]\n").unwrap();
        load(path, "a.toml", "a.ply")
    };
    let coordinate = "0 @ 0 0 0 1 0 0 1 1 1";
    check(&[(coordinate, &["0", "-0", "1e-30", "9e8", "-9e8"], &["1e39", "-1e39", "1e300"])], &NO_NUMBERS, read);
    // A normal, place on a texture or colour that is no number counts as none: scanners write them where they saw nothing.
    let any: &[&str] = &["0", "-0", "-1", "1", "255", "1e30", "1e39", "nan", "inf", "-inf"];
    let others = ["0 0 0 0 0 @ 0 0 1 1 1", "0 0 0 0 0 1 @ 0 1 1 1", "0 0 0 0 0 1 0 0 1 @ 1"];
    check(&others.map(|text| (text, any, &[][..])), &[], read);
}

#[test]
fn numbers_of_mitsuba() {
    let folder = folder();
    let path = folder.path();
    let read = |text: &str| {
        let sky =
            if text.contains("constant") || text.contains("sunsky") { "" } else { "<emitter type=\"constant\"/>" };
        let all = format!("<scene version=\"3.0.0\">\n{text}\n<shape type=\"rectangle\"/>{sky}</scene>\n");
        fs::write(path.join("a.xml"), all).unwrap();
        load(path, "a.xml", "a.xml")
    };
    let bsdf = |kind: &str, property: &str| {
        format!(
            "<shape type=\"rectangle\"><bsdf type=\"{kind}\"><float name=\"{property}\" value=\"@\"/></bsdf></shape>"
        )
    };
    let emitter = |kind: &str, more: &str| format!("<emitter type=\"{kind}\">{more}</emitter>");
    let shape = |kind: &str, more: &str| format!("<shape type=\"{kind}\">{more}</shape>");
    let sensor = |kind: &str, more: &str| format!("<sensor type=\"{kind}\">{more}</sensor>");
    let float = |name: &str| format!("<float name=\"{name}\" value=\"@\"/>");
    let rgb = |name: &str| format!("<rgb name=\"{name}\" value=\"1 @ 1\"/>");
    // Reflectances count as 0 or 1 beyond these.
    let clamped = (&["0", "-0", "-1", "1", "2", "3.4e38"][..], &["1e39", "-1e39"][..]);
    let index = (&["0.001", "1", "3.4e38"][..], &["0", "-0", "-1", "1e39"][..]);
    let places = (&["0", "-0", "9e8", "-9e8"][..], &["1e39", "-1e39"][..]);
    let radius = (&["1e-6", "9e8"][..], &["0", "-0", "-1", "1e39"][..]);
    let fields = [
        (bsdf("diffuse", "reflectance"), clamped),
        (bsdf("roughconductor", "alpha"), clamped),
        (bsdf("phong", "exponent"), clamped),
        (bsdf("mask", "opacity").replace("</bsdf>", "<bsdf type=\"diffuse\"/></bsdf>"), clamped),
        (bsdf("principled", "roughness"), clamped),
        (bsdf("principled", "metallic"), clamped),
        (bsdf("dielectric", "int_ior"), index),
        (bsdf("dielectric", "ext_ior"), index),
        (bsdf("plastic", "int_ior"), index),
        (emitter("point", &rgb("intensity")), FROM_0),
        (emitter("directional", &rgb("irradiance")), FROM_0),
        (emitter("constant", &rgb("radiance")), FROM_0),
        (shape("rectangle", &emitter("area", &rgb("radiance"))), FROM_0),
        (emitter("point", "<point name=\"position\" x=\"@\" y=\"0\" z=\"1\"/>"), places),
        (
            emitter("directional", "<vector name=\"direction\" x=\"0\" y=\"@\" z=\"0\"/>"),
            (&["1", "-1e-30", "3e38"][..], &["0", "-0", "1e39"][..]),
        ),
        (emitter("spot", &float("cutoff_angle")), (&["0.01", "90"][..], &["0", "-0", "-1", "90.1", "1e39"][..])),
        (emitter("spot", &float("beam_width")), (&["0", "-0", "20"][..], &["-0.1", "20.1", "1e39"][..])),
        (
            emitter(
                "sunsky",
                &format!("<vector name=\"sun_direction\" x=\"0\" y=\"0\" z=\"1\"/>{}", float("turbidity")),
            ),
            (&["1", "10"][..], &["0.99", "0", "-0", "10.1", "1e39"][..]),
        ),
        (
            emitter(
                "sunsky",
                &format!("<vector name=\"sun_direction\" x=\"0\" y=\"0\" z=\"1\"/>{}", float("sky_scale")),
            ),
            (&["1e-3", "1e9"][..], &["-1", "3.4e38", "1e39"][..]),
        ),
        (shape("sphere", &float("radius")), radius),
        (shape("cylinder", &float("radius")), radius),
        (shape("sphere", "<point name=\"center\" x=\"0\" y=\"@\" z=\"0\"/>"), places),
        (shape("rectangle", "<transform name=\"to_world\"><translate x=\"@\"/></transform>"), places),
        (
            shape("rectangle", "<transform name=\"to_world\"><scale x=\"@\"/></transform>"),
            (&["1e-3", "-1", "9e8"][..], &["0", "-0", "1e39"][..]),
        ),
        (shape("rectangle", "<transform name=\"to_world\"><rotate x=\"1\" angle=\"@\"/></transform>"), (ANY.0, ANY.1)),
        (
            shape("rectangle", "<transform name=\"to_world\"><rotate x=\"@\" angle=\"1\"/></transform>"),
            (&["1", "-1e-30"][..], &["0", "-0", "1e39"][..]),
        ),
        (sensor("perspective", &float("fov")), (&["1e-3", "179.9"][..], &["0", "-0", "-1", "180", "1e39"][..])),
        (
            sensor("thinlens", &format!("{}<float name=\"aperture_radius\" value=\"0.1\"/>", float("focus_distance"))),
            (&["1e-3", "1e9"][..], LENGTHS.1),
        ),
        (
            sensor("thinlens", &format!("{}<float name=\"focus_distance\" value=\"1\"/>", float("aperture_radius"))),
            (&["0", "-0", "5e8"][..], &["-1e-45", "5.01e8", "1e39"][..]),
        ),
        (
            sensor("perspective", "<film type=\"hdrfilm\"><integer name=\"width\" value=\"@\"/></film>"),
            (&["1", "65536"][..], &["0", "-0", "-1", "65537", "1.5", "1e39"][..]),
        ),
    ];
    let numbers: Vec<Number> = fields.iter().map(|(text, (good, bad))| (text.as_str(), *good, *bad)).collect();
    check(&numbers, &NO_NUMBERS, read);
    // A share of light, as in a scene file.
    assert!(FRACTIONS.0.iter().all(|value| read(&bsdf("diffuse", "reflectance").replace('@', value)).is_ok()));
}
