//! glTF models that move: skins, morph targets and animations.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat4, Quat, Vec3};
use lightsum::scene::{self, Light, Scene};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A document with one buffer, which grows with each accessor.
struct Model {
    document: Value,
    bin: Vec<u8>,
}

impl Model {
    /// Accessors 0 and 1: positions of a strip of four vertices at heights 0, 0, 2, 2, and its indices.
    fn new() -> Model {
        let document = json!({
            "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0, "name": "strip" }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 2 }, "indices": 1 }] }],
            "accessors": [], "bufferViews": [], "buffers": [{}],
        });
        let mut model = Model { document, bin: Vec::new() };
        let strip = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 2.0, 0.0]];
        model.floats("VEC3", &strip.concat());
        model.document["accessors"][0]["min"] = json!([0, 0, 0]);
        model.document["accessors"][0]["max"] = json!([1, 2, 0]);
        let indices: Vec<u8> = [0u16, 1, 2, 2, 1, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
        model.accessor(&indices, "SCALAR", 5123, 6);
        model.floats("VEC3", &[Vec3::Z.to_array(); 4].concat());
        model
    }

    fn accessor(&mut self, bytes: &[u8], kind: &str, component: u32, count: usize) -> usize {
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let views = self.document["bufferViews"].as_array_mut().unwrap();
        views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }));
        let view = views.len() - 1;
        let accessors = self.document["accessors"].as_array_mut().unwrap();
        accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
        accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, kind, 5126, values.len() / width)
    }

    /// Adds an animation with one channel.
    fn animate(&mut self, name: &str, node: usize, path: &str, times: &[f32], values: (&str, &[f32]), how: &str) {
        let (input, output) = (self.floats("SCALAR", times), self.floats(values.0, values.1));
        let animations = self.document.as_object_mut().unwrap().entry("animations").or_insert(json!([]));
        animations.as_array_mut().unwrap().push(json!({
            "name": name,
            "channels": [{ "sampler": 0, "target": { "node": node, "path": path } }],
            "samplers": [{ "input": input, "output": output, "interpolation": how }],
        }));
    }

    /// Joints 1, at the bottom, and 2, its child at height 1: the lower vertices follow the first, the upper ones the second, and
    /// vertex 3 both by halves.
    fn skin(&mut self) {
        let joints: Vec<u8> = [[0u8, 1, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]].concat();
        let joints = self.accessor(&joints, "VEC4", 5121, 4);
        // The first adds up to 2, as some exporters leave it.
        let weights = [[2.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0]];
        let weights = self.floats("VEC4", &weights.concat());
        let bind = [Mat4::IDENTITY, Mat4::from_translation(Vec3::NEG_Y)].map(|m| m.to_cols_array()).concat();
        let bind = self.floats("MAT4", &bind);
        let attributes = &mut self.document["meshes"][0]["primitives"][0]["attributes"];
        (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (json!(joints), json!(weights));
        self.document["skins"] = json!([{ "joints": [1, 2], "inverseBindMatrices": bind }]);
        self.document["nodes"] = json!([
            // The transform of a node with a skin does not count.
            { "mesh": 0, "skin": 0, "name": "strip", "translation": [7, 8, 9], "scale": [-2, 1, 1] },
            { "children": [2] },
            { "translation": [0, 1, 0] },
        ]);
        self.document["scenes"][0]["nodes"] = json!([0, 1]);
    }

    fn load(&self) -> lightsum::Result<Scene> {
        let folder = TempDir::new().unwrap();
        let mut document = self.document.clone();
        document["buffers"][0] = json!({ "uri": "a.bin", "byteLength": self.bin.len() });
        std::fs::write(folder.path().join("a.bin"), &self.bin).unwrap();
        std::fs::write(folder.path().join("a.gltf"), document.to_string()).unwrap();
        scene::load(&folder.path().join("a.gltf"))
    }

    fn refused(&self, parts: &[&str]) {
        let error = self.load().expect_err(&format!("{parts:?} should be refused")).to_string();
        assert!(error.contains("a.gltf") && parts.iter().all(|part| error.contains(part)), "{parts:?}: {error}");
    }
}

fn assert_near(found: &[Vec3], expected: &[Vec3]) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((*a - *b).length() < 1e-5, "{i}: {a} in place of {b}");
    }
}

#[test]
fn a_skin_of_two_bones_bends_as_its_closed_form() {
    let mut model = Model::new();
    model.skin();
    let still = model.load().unwrap();
    assert!(still.animations.is_none() && still.ignored.is_empty(), "{:?}", still.ignored);
    // Bound as it rests, whatever its node says. Vertex 3 is the mean of what the joints make of it: weights name joint 1 and 0.
    assert_near(&still.positions, &[Vec3::ZERO, Vec3::X, Vec3::Y * 2.0, Vec3::new(1.0, 2.0, 0.0)]);

    // The upper bone turns about (0, 1, 0) to `angle`.
    let quarter = Quat::from_rotation_z(FRAC_PI_2).to_array();
    let keys = [Quat::IDENTITY.to_array(), quarter].concat();
    model.animate("bend", 2, "rotation", &[0.5, 1.5], ("VEC4", &keys), "LINEAR");
    let mut scene = model.load().unwrap();
    assert_near(&scene.positions, &still.positions);
    let animations = scene.animations.clone().unwrap();
    assert_eq!((animations.list[0].name.as_str(), animations.span(&[0])), ("bend", (0.5, 1.5)));
    for (time, share) in [(0.0, 0.0), (0.75, 0.25), (1.0, 0.5), (1.5, 1.0), (0.5, 0.0), (8.0, 1.0)] {
        scene.set_pose(&[0], time);
        let turn = |p: Vec3| Quat::from_rotation_z(share * FRAC_PI_2) * (p - Vec3::Y) + Vec3::Y;
        let corner = Vec3::new(1.0, 2.0, 0.0);
        let expected = [Vec3::ZERO, Vec3::X, turn(Vec3::Y * 2.0), 0.5 * (turn(corner) + corner)];
        assert_near(&scene.positions, &expected);
        assert_near(&scene.normals, &[Vec3::Z; 4]);
    }
    // About x the normals turn along. The mean of two rotations is shorter, but turns by half of the angle.
    let keys = [Quat::IDENTITY.to_array(), Quat::from_rotation_x(FRAC_PI_2).to_array()].concat();
    model.animate("nod", 2, "rotation", &[0.0, 1.0], ("VEC4", &keys), "LINEAR");
    let mut scene = model.load().unwrap();
    scene.set_pose(&scene.animations.clone().unwrap().choose(Some("nod")).unwrap(), 1.0);
    let half = Quat::from_rotation_x(0.5 * FRAC_PI_2) * Vec3::Z;
    assert_near(&scene.normals, &[Vec3::Z, Vec3::Z, Vec3::NEG_Y, half]);
}

#[test]
fn further_sets_of_joints_count() {
    let mut model = Model::new();
    model.skin();
    let second: Vec<u8> = [[1u8, 0, 0, 0]; 4].concat();
    let joints = model.accessor(&second, "VEC4", 5121, 4);
    let weights = model.floats("VEC4", &[[1.0, 0.0, 0.0, 0.0], [0.0; 4], [0.0; 4], [0.0; 4]].concat());
    let attributes = &mut model.document["meshes"][0]["primitives"][0]["attributes"];
    (attributes["JOINTS_1"], attributes["WEIGHTS_1"]) = (json!(joints), json!(weights));
    // The upper bone is moved by 3 after binding: vertex 0 follows it by a third.
    model.document["nodes"][2]["translation"] = json!([3, 1, 0]);
    let scene = model.load().unwrap();
    assert_near(&scene.positions[..3], &[Vec3::X, Vec3::X, Vec3::new(3.0, 2.0, 0.0)]);
}

#[test]
fn morph_targets_are_added_by_their_weights() {
    let mut model = Model::new();
    // The first lifts the upper edge towards z, with normals; the second, sparse, moves vertex 1 alone.
    let lifted = model.floats("VEC3", &[[0.0; 3], [0.0; 3], [0.0, 0.0, 4.0], [0.0, 0.0, 4.0]].concat());
    let tilted = model.floats("VEC3", &[[0.0, -1.0, 0.0]; 4].concat());
    let index = model.accessor(&[1], "SCALAR", 5121, 1);
    let by = model.floats("VEC3", &[-8.0, 0.0, 0.0]);
    let view = |accessor: usize| model.document["accessors"][accessor]["bufferView"].clone();
    let sparse = json!({ "componentType": 5126, "count": 4, "type": "VEC3", "min": [-8, 0, 0], "max": [0, 0, 0], "sparse": {
        "count": 1, "indices": { "bufferView": view(index), "componentType": 5121 }, "values": { "bufferView": view(by) },
    } });
    let accessors = model.document["accessors"].as_array_mut().unwrap();
    accessors.push(sparse);
    let sparse = accessors.len() - 1;
    model.document["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": lifted, "NORMAL": tilted }, { "POSITION": sparse }]);
    model.document["accessors"][lifted]["min"] = json!([0, 0, 0]);
    model.document["accessors"][lifted]["max"] = json!([0, 0, 4]);
    let morphed = |first: f32, second: f32| {
        let (top, z) = (Vec3::new(0.0, 2.0, 4.0 * first), Vec3::new(0.0, -first, 1.0).normalize());
        ([Vec3::ZERO, Vec3::X * (1.0 - 8.0 * second), top, top + Vec3::X], [z; 4])
    };
    let assert_morphed = |scene: &Scene, first: f32, second: f32| {
        let (positions, normals) = morphed(first, second);
        assert_near(&scene.positions, &positions);
        assert_near(&scene.normals, &normals);
    };
    assert_morphed(&model.load().unwrap(), 0.0, 0.0);
    model.document["meshes"][0]["weights"] = json!([0.5, 0.0625]);
    assert_morphed(&model.load().unwrap(), 0.5, 0.0625);
    // Those of the node come first.
    model.document["nodes"][0]["weights"] = json!([0.25, 0.0]);
    let scene = model.load().unwrap();
    assert_morphed(&scene, 0.25, 0.0);
    assert!(scene.ignored.is_empty(), "{:?}", scene.ignored);
    model.animate("grow", 0, "weights", &[0.0, 2.0], ("SCALAR", &[0.0, 0.0, 1.0, 0.5]), "LINEAR");
    let mut scene = model.load().unwrap();
    assert_morphed(&scene, 0.25, 0.0);
    scene.set_pose(&[0], 0.5);
    assert_morphed(&scene, 0.25, 0.125);
    scene.set_pose(&[0], 9.0);
    assert_morphed(&scene, 1.0, 0.5);
}

#[test]
fn nodes_carry_objects_lights_and_cameras() {
    let mut model = Model::new();
    model.document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    model.document["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot", "intensity": 3.0,
        "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.5 } }] } });
    model.document["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } }]);
    model.document["nodes"] = json!([
        { "children": [1, 2, 3], "translation": [0, 0, 1] },
        { "mesh": 0, "name": "strip", "scale": [2, 2, 2] },
        { "extensions": { "KHR_lights_punctual": { "light": 0 } }, "translation": [0, 5, 0] },
        { "camera": 0, "translation": [0, 0, 9] },
        { "mesh": 0, "name": "still" },
    ]);
    model.document["scenes"][0]["nodes"] = json!([0, 4]);
    model.animate("slide", 0, "translation", &[0.0, 1.0], ("VEC3", &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0]), "STEP");
    let turn = [Quat::IDENTITY.to_array(), Quat::from_rotation_y(FRAC_PI_2).to_array()].concat();
    model.animate("turn", 0, "rotation", &[0.0, 1.0], ("VEC4", &turn), "LINEAR");
    let mut scene = model.load().unwrap();
    let rest = scene.clone();
    let animations = scene.animations.clone().unwrap();
    assert_eq!(animations.vertices(), vec![0..4], "the still one is left alone");
    assert!(animations.choose(Some("jump")).unwrap_err().contains("\"slide\", \"turn\""));
    assert_eq!((animations.choose(None), animations.choose(Some("all"))), (Ok(vec![0]), Ok(vec![0, 1])));

    // Until the next key a step stays, and the file's own place does not count.
    scene.set_pose(&[0], 0.999);
    assert_near(&scene.positions[..1], &[Vec3::ZERO]);
    scene.set_pose(&[0], 1.0);
    let moved = [[4.0, 0.0, 0.0], [6.0, 0.0, 0.0], [4.0, 4.0, 0.0], [6.0, 4.0, 0.0]].map(Vec3::from_array);
    assert_near(&scene.positions[..4], &moved);
    assert_eq!(scene.positions[4..], rest.positions[4..]);
    let Light::Spot { position, direction, .. } = scene.lights[0] else { panic!("{:?}", scene.lights) };
    assert_near(&[position, direction], &[Vec3::new(4.0, 5.0, 0.0), Vec3::NEG_Z]);
    let camera = scene.camera.unwrap();
    assert_near(&[camera.eye, camera.target], &[Vec3::new(4.0, 0.0, 9.0), Vec3::new(4.0, 0.0, 8.0)]);
    assert_eq!(scene.cameras[0].camera, camera);

    // Another animation starts from the file's values: the parent is at z = 1 again, and turns z into x.
    scene.set_pose(&[1], 1.0);
    let Light::Spot { position, direction, .. } = scene.lights[0] else { panic!("{:?}", scene.lights) };
    assert_near(&[position, direction], &[Vec3::new(0.0, 5.0, 1.0), Vec3::NEG_X]);
    let camera = scene.camera.unwrap();
    assert_near(&[camera.eye, camera.target], &[Vec3::new(9.0, 0.0, 1.0), Vec3::new(8.0, 0.0, 1.0)]);
    assert_near(&scene.normals[..4], &[Vec3::X; 4]);
    // Both at once.
    scene.set_pose(&[0, 1], 1.0);
    assert_near(&[scene.camera.unwrap().eye], &[Vec3::new(13.0, 0.0, 0.0)]);
}

#[test]
fn bad_skins_and_animations_are_refused() {
    let skinned = |change: &dyn Fn(&mut Model), parts: &[&str]| {
        let mut model = Model::new();
        model.skin();
        let keys = [Quat::IDENTITY.to_array(); 2].concat();
        model.animate("bend", 2, "rotation", &[0.0, 1.0], ("VEC4", &keys), "LINEAR");
        model.load().unwrap();
        change(&mut model);
        model.refused(parts);
    };
    // Accessors: 3 joints, 4 weights, 5 matrices, 6 times, 7 rotations.
    let at = |m: &Model, accessor: usize| m.document["bufferViews"][accessor]["byteOffset"].as_u64().unwrap() as usize;
    let put = |m: &mut Model, accessor: usize, element: usize, value: f32| {
        let start = at(m, accessor) + 4 * element;
        m.bin[start..start + 4].copy_from_slice(&value.to_le_bytes());
    };
    skinned(&|m| m.document["skins"][0]["joints"] = json!([1, 9]), &["skins[0].joints"]);
    skinned(&|m| m.document["skins"][0]["joints"] = json!([1]), &["strip", "joint 1 of vertex 2", "skin 0 has 1"]);
    skinned(&|m| m.document["skins"][0]["joints"] = json!([1, 2, 2]), &["skin 0", "3 joints and 2"]);
    skinned(&|m| m.document["accessors"][5]["type"] = json!("VEC4"), &["accessor 5", "16 numbers"]);
    skinned(&|m| m.document["accessors"][3]["componentType"] = json!(5126), &["accessor 3", "JOINTS"]);
    skinned(&|m| m.document["accessors"][4]["count"] = json!(3), &["strip", "differ"]);
    skinned(&|m| put(m, 4, 1, -0.5), &["strip", "weights", "vertex 0"]);
    skinned(&|m| put(m, 4, 1, f32::NAN), &["accessor 4", "not finite"]);
    skinned(&|m| put(m, 5, 3, f32::INFINITY), &["accessor 5", "not finite"]);
    skinned(&|m| put(m, 6, 1, 0.0), &["\"bend\", channel 0", "rise", "key 1"]);
    skinned(&|m| put(m, 6, 1, f32::NAN), &["accessor 6", "not finite"]);
    skinned(&|m| put(m, 7, 3, 0.0), &["\"bend\", channel 0", "key 0", "no length"]);
    skinned(&|m| m.document["accessors"][6]["count"] = json!(1), &["\"bend\"", "1 keys need 1 times 4 numbers", "8"]);
    skinned(&|m| m.document["accessors"][6]["count"] = json!(0), &["\"bend\"", "0 keys need 1 times 4 numbers"]);
    skinned(&|m| m.document["accessors"][6]["count"] = json!(u64::MAX), &["accessor 6"]);
    skinned(&|m| m.document["animations"][0]["samplers"][0]["interpolation"] = json!("CUBICSPLINE"), &["3 times 4"]);
    skinned(&|m| m.document["animations"][0]["samplers"][0]["output"] = json!(99), &["output"]);
    skinned(&|m| m.document["animations"][0]["channels"][0]["sampler"] = json!(1), &["sampler"]);
    skinned(&|m| m.document["animations"][0]["channels"][0]["target"]["node"] = json!(9), &["node"]);
    skinned(&|m| m.document["nodes"][2]["children"] = json!([1]), &["node 1", "ancestor"]);

    let mut model = Model::new();
    let short = model.floats("VEC3", &[0.0; 9]);
    model.document["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": short }]);
    model.document["accessors"][short]["min"] = json!([0, 0, 0]);
    model.document["accessors"][short]["max"] = json!([0, 0, 0]);
    model.refused(&["strip", "morph target has 3 vertices", "4"]);
}
