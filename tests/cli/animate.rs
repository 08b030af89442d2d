//! `lightsum animate`: frames, timings, and messages for wrong path files.
//!
//! LIGHTSUM_DEVICE names the device, as for all tests with a device.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::json;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml");
const TURN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/turn.toml");

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    command.arg("animate").args(arguments).current_dir(folder).env_remove("RUST_LOG");
    if let Ok(device) = std::env::var("LIGHTSUM_DEVICE") {
        command.args(["--device", &device]);
    }
    command.env("XDG_CACHE_HOME", crate::render::cache()).output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[track_caller]
fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Flags for small images.
const SMALL: [&str; 8] = ["--resolution", "24x18", "--particles", "4", "--max-depth", "3", "--traversal", "single"];

fn arguments<'a>(more: &[&'a str]) -> Vec<&'a str> {
    SMALL.iter().chain(more).copied().collect()
}

#[test]
fn images_with_depth_need_a_scene_that_stands_still() {
    let folder = tempfile::tempdir().unwrap();
    let flags = ["--superposition", "mirror", "--mirror-source", "images", "-o", "f-%02d.png"];
    let output = run(folder.path(), &arguments(&[&[SCENE, "--path", TURN], &flags[..]].concat()));
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("--mirror-source") && message.contains("objects move"), "{message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().filter(|f| f.as_ref().unwrap().path().is_file()).count(), 0);

    // The camera alone may move.
    fs::write(
        folder.path().join("walk.toml"),
        "frames = 2\n[[camera]]\ntime = 0.0\neye = [1.5, 0.4, 2.5]\ntarget = [1.5, 0.04, 0.0]\n\
         [[camera]]\ntime = 1.0\neye = [1.9, 0.5, 2.5]\ntarget = [1.5, 0.04, 0.0]\n",
    )
    .unwrap();
    let floor = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/glossy-floor/scene.toml");
    let small = ["--mirror-hemispheres", "1", "--mirror-images", "2", "--mirror-side", "16", "--mirror-passes", "1"];
    let path = [floor, "--path", "walk.toml", "--timings", "t.json", "--moving-passes", "1"];
    succeeds(folder.path(), &arguments(&[&path[..], &flags, &small].concat()));
    let times: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("t.json")).unwrap()).unwrap();
    for frame in times["frames"].as_array().unwrap() {
        assert!(frame["mirror_pixels"]["shown"].as_u64().is_some_and(|shown| shown > 50), "{frame}");
    }
}

#[test]
fn frames_and_times_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let more =
        [SCENE, "--path", TURN, "-o", "f-%02d.png", "--timings", "t.json", "--moving-passes", "2", "--validation"];
    let said = succeeds(folder.path(), &arguments(&more));
    assert!(said.contains("13 frames of 2 passes") && said.trim_end().ends_with("-> f-%02d.png, t.json"), "{said}");
    let frame = |i: usize| image::open(folder.path().join(format!("f-{i:02}.png"))).unwrap().into_rgb8();
    assert_eq!(frame(0).dimensions(), (24, 18));
    assert!(!folder.path().join("f-13.png").exists());
    assert!((1..13).all(|i| frame(i) != frame(i - 1)), "something moves in every frame");

    let times: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("t.json")).unwrap()).unwrap();
    let frames = times["frames"].as_array().unwrap();
    assert_eq!((frames.len(), &times["moving_passes"]), (13, &2.into()));
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!((frame["frame"].as_u64(), frame["time"].as_f64()), (Some(i as u64), Some(0.25 * i as f64)));
        assert_eq!(frame["passes"], 2);
        for key in ["edit", "record", "render", "write"] {
            assert!(frame[key].as_f64().is_some_and(|s| s > 0.0), "{key}: {frame}");
        }
        assert!(frame["record"].as_f64() < frame["render"].as_f64());
        assert!(i == 0 || frame["edit_parts"]["bytes"].as_u64() > Some(0), "{frame}");
        assert!(frame["gpu_passes"]["shade"].as_f64().is_some_and(|s| s > 0.0), "{frame}");
    }
}

#[test]
fn still_frames_accumulate_and_equal_a_rendering() {
    let folder = tempfile::tempdir().unwrap();
    let path = "times = [0.0, 1.0, 2.0]\n[[object]]\nname = \"tall_block\"\nkeys = [{ time = 0, degrees = 0 }, { time = 1, translation = [0, 0, 0] }]\n";
    fs::write(folder.path().join("still.toml"), path).unwrap();
    succeeds(
        folder.path(),
        &arguments(&[SCENE, "--path", "still.toml", "-o", "%d.png", "--timings", "t.json", "--moving-passes", "1"]),
    );
    let times: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("t.json")).unwrap()).unwrap();
    let passes: Vec<_> = times["frames"].as_array().unwrap().iter().map(|f| f["passes"].as_u64().unwrap()).collect();
    assert_eq!(passes, [1, 2, 3]);
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    command.args(["render", SCENE, "-o", "r.png", "--passes", "3"]).args(SMALL).current_dir(folder.path());
    let output = command.env("XDG_CACHE_HOME", crate::render::cache()).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let [a, b] = ["2.png", "r.png"].map(|name| image::open(folder.path().join(name)).unwrap().into_rgb8().into_raw());
    // The tree differs, so rays within rounding of an edge may hit another triangle.
    let worst = a.iter().zip(&b).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(worst <= 2, "differs by {worst} of 255");
}

#[test]
fn a_ring_goes_on_from_frame_to_frame() {
    let folder = tempfile::tempdir().unwrap();
    // The block moves once, and stands still again.
    let path = "times = [0, 1, 2, 3, 4]\n[[object]]\nname = \"tall_block\"\nkeys = [{ time = 0 }, { time = 1, translation = [-60, 0, 0] }]\n";
    fs::write(folder.path().join("p.toml"), path).unwrap();
    let more =
        [SCENE, "--path", "p.toml", "-o", "f-%d.png", "--moving-passes", "2", "--ring", "images", "--ring-length", "4"];
    let output = run(folder.path(), &arguments(&more));
    let told = text(&output.stderr);
    assert!(output.status.success() && told.contains("a ring of 4 images takes 0.0 MiB of 1024"), "{told}");
    let frame = |i: usize| image::open(folder.path().join(format!("f-{i}.png"))).unwrap().into_rgb8();
    assert!((1..5).all(|i| frame(i) != frame(i - 1)), "paths come and go");

    let more = [SCENE, "--path", "p.toml", "-o", "no-%d.png", "--ring", "images", "--ring-length", "1024"];
    let all = [&more[..], &["--resolution", "640x480", "--ring-memory", "100"]].concat();
    let output = run(folder.path(), &all);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("--ring-length") && said.contains("takes 2401 MiB") && said.contains("42 would fit"),
        "{said}"
    );
    assert!(!folder.path().join("no-0.png").exists());
    assert_eq!(run(folder.path(), &[SCENE, "--ring-length", "8"]).status.code(), Some(2), "a length without a ring");
}

#[test]
fn wrong_paths_are_refused_by_file_line_and_key() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&str, &[&str]); 15] = [
        (
            "frames = 2\n[[object]]\nname = \"tal_block\"\nkeys = [{ time = 0 }]",
            &["p.toml:3", "tal_block", "\"tall_block\""],
        ),
        (
            "frames = 2\n\n[[object]]\nname = \"floor\"\nkeys = [\n{ time = 1 },\n{ time = 1 },\n]",
            &["p.toml:7", "time", "floor"],
        ),
        ("frames = 2\n[[object]]\nname = \"floor\"\nkeys = [{ time = 0, scale = 0 }]", &["p.toml:4", "scale", "floor"]),
        (
            "frames = 2\n[[object]]\nname = \"floor\"\nkeys = [{ time = 0, scale = [1, nan, 1] }]",
            &["p.toml:4", "scale"],
        ),
        ("frames = 2\n[[object]]\nname = \"floor\"\nkeys = [{ time = 0, degrees = inf }]", &["p.toml:4", "degrees"]),
        ("frames = 2\n[[object]]\nname = \"floor\"\naxis = [0, 0, 0]\nkeys = [{ time = 0 }]", &["p.toml:4", "axis"]),
        ("frames = 2\n[[object]]\nname = \"floor\"\nkeys = []", &["p.toml:3", "keys"]),
        ("frames = 0\n[[camera]]\ntime = 0", &["p.toml:1", "frames"]),
        ("frames = 3", &["p.toml:1", "no [[camera]]"]),
        ("[[camera]]\ntime = 0", &["p.toml", "no `frames`"]),
        ("times = [0, inf]\n[[camera]]\ntime = 0", &["p.toml:1", "times"]),
        ("frames = 1\n[[camera]]\ntime = 0\nfov = 200", &["p.toml:2", "camera", "fov"]),
        ("frames = 1\n[[camera]]\ntime = 0\nheight = 2", &["p.toml:2", "camera", "orthographic"]),
        ("frames = 1\n[[camera]]\ntime = 0\neyes = [0, 0, 0]", &["p.toml:4", "eyes"]),
        // Valid by itself, but impossible in the scene.
        (
            "frames = 2\n[[object]]\nname = \"floor\"\nkeys = [{ time = 0, scale = [1e-20, 1, 1] }]",
            &["p.toml:3", "\"floor\""],
        ),
    ];
    for (path, words) in cases {
        fs::write(folder.path().join("p.toml"), path).unwrap();
        let output = run(folder.path(), &arguments(&[SCENE, "--path", "p.toml", "-o", "f-%d.png"]));
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{path}: {message}");
        assert!(words.iter().all(|word| message.contains(word)), "{path}: {message}");
        assert!(!message.contains("panicked"), "{message}");
        assert!(!folder.path().join("f-0.png").exists());
    }
    let wrong_use = run(folder.path(), &[SCENE, "--path", TURN, "-o", "frame.png"]);
    assert_eq!(wrong_use.status.code(), Some(2), "{}", text(&wrong_use.stderr));
    let missing = run(folder.path(), &[SCENE, "--path", "none.toml"]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(text(&missing.stderr).contains("none.toml"));
}

/// A lamp over a floor, and a leaf that a joint turns between 0 and 2 s; the second animation moves the camera.
fn animated(folder: &Path) {
    let mut bin: Vec<u8> = Vec::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut add = |bytes: Vec<u8>, component: u32, kind: &str, count: usize| {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        accessors
            .push(json!({ "bufferView": views.len() - 1, "componentType": component, "count": count, "type": kind,
            "min": [-3, -3, -3], "max": [3, 3, 3] }));
        if kind != "VEC3" {
            let accessor = accessors.last_mut().unwrap().as_object_mut().unwrap();
            accessor.remove("min");
            accessor.remove("max");
        }
        bin.extend(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
    };
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let square = |half: f32, y: f32| floats(&[-half, y, half, half, y, half, half, y, -half, -half, y, -half]);
    add([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect(), 5123, "SCALAR", 6);
    add(square(3.0, 0.0), 5126, "VEC3", 4);
    // The lamp looks down: seen from above its corners run clockwise.
    add(floats(&[-0.5, 3.0, -0.5, 0.5, 3.0, -0.5, 0.5, 3.0, 0.5, -0.5, 3.0, 0.5]), 5126, "VEC3", 4);
    add(square(0.7, 0.8), 5126, "VEC3", 4);
    add(vec![0; 16], 5121, "VEC4", 4);
    add(floats(&[[1.0, 0.0, 0.0, 0.0]; 4].concat()), 5126, "VEC4", 4);
    add(floats(&[0.0, 2.0]), 5126, "SCALAR", 2);
    // A quarter of a turn: the leaf ends below the floor, so that the scene grows, and with it the disc of the default sky.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    add(floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half]), 5126, "VEC4", 2);
    add(floats(&[0.0, 2.0, 5.0, 0.0, 2.0, 4.0]), 5126, "VEC3", 2);
    let mesh = |positions: u32, material: u32| json!({ "primitives": [{ "attributes": { "POSITION": positions }, "indices": 0, "material": material }] });
    let mut leaf = mesh(3, 0);
    leaf["primitives"][0]["attributes"] = json!({ "POSITION": 3, "JOINTS_0": 4, "WEIGHTS_0": 5 });
    let animation = |name: &str, node: u32, path: &str, output: u32| {
        json!({ "name": name, "channels": [{ "sampler": 0, "target": { "node": node, "path": path } }],
            "samplers": [{ "input": 6, "output": output }] })
    };
    let document = json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0, 1, 2, 3, 4] }],
        "nodes": [{ "mesh": 0, "name": "floor" }, { "mesh": 1, "name": "lamp" }, { "mesh": 2, "skin": 0, "name": "leaf" },
            { "name": "stalk" }, { "camera": 0, "name": "eye", "translation": [0, 2, 5] }],
        "meshes": [mesh(1, 0), mesh(2, 1), leaf], "skins": [{ "joints": [3] }],
        "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0 } }, { "emissiveFactor": [1, 1, 1] }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.9, "znear": 0.1 } }],
        "animations": [animation("turn", 3, "rotation", 7), animation("ride", 4, "translation", 8)],
        "accessors": accessors, "bufferViews": views, "buffers": [{ "uri": "leaf.bin", "byteLength": bin.len() }],
    });
    fs::write(folder.join("leaf.bin"), bin).unwrap();
    fs::write(folder.join("leaf.gltf"), document.to_string()).unwrap();
}

fn pixels(folder: &Path, name: &str) -> Vec<u8> {
    image::open(folder.join(name)).unwrap().into_rgb8().into_raw()
}

#[test]
fn a_model_plays_its_animations_and_stands_in_its_poses() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    animated(folder);
    let more =
        ["leaf.gltf", "--frames", "3", "-o", "f-%d.png", "--moving-passes", "2", "--timings", "t.json", "--validation"];
    let said = succeeds(folder, &arguments(&more));
    assert!(said.contains("3 frames of 2 passes"), "{said}");
    let times: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("t.json")).unwrap()).unwrap();
    let at: Vec<f64> = times["frames"].as_array().unwrap().iter().map(|f| f["time"].as_f64().unwrap()).collect();
    assert_eq!(at, [0.0, 1.0, 2.0]);
    assert!(pixels(folder, "f-0.png") != pixels(folder, "f-1.png"));

    // A frame is the still image of its time.
    let still = |more: &[&str], name: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
        command.args(["render", "leaf.gltf", "--passes", "2", "-o", name]).args(SMALL).args(more).current_dir(folder);
        if let Ok(device) = std::env::var("LIGHTSUM_DEVICE") {
            command.args(["--device", &device]);
        }
        let output = command.env("XDG_CACHE_HOME", crate::render::cache()).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        pixels(folder, name)
    };
    let differ =
        |a: &[u8], b: &[u8]| a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64;
    let rest = still(&[], "rest.png");
    for (frame, time) in [("f-0.png", "0"), ("f-1.png", "1"), ("f-2.png", "2")] {
        let (played, posed) = (pixels(folder, frame), still(&["--at", time], "posed.png"));
        let (same, other) = (differ(&played, &posed), differ(&rest, &posed));
        println!("{frame}: {same} from its pose, which is {other} from the pose at rest");
        // The trees differ, so rays within rounding of an edge may hit another triangle.
        assert!(same < 0.1, "{frame} differs by {same} from its pose");
        assert!(time == "0" || other > 0.5, "the pose at {time} s is that at rest");
    }
    // The camera rides forward, by the other animation, or by both.
    let near = still(&["--animation", "ride", "--at", "2"], "near.png");
    assert!(differ(&near, &rest) > 1.0);
    succeeds(
        folder,
        &arguments(&["leaf.gltf", "--animation", "all", "--fps", "0.5", "-o", "b-%d.png", "--moving-passes", "2"]),
    );
    let both = still(&["--animation", "all", "--at", "2"], "both.png");
    assert!(differ(&pixels(folder, "b-1.png"), &both) < 0.1 && !folder.join("b-2.png").exists());
    // Flags hold the camera. With --frames and --fps the animation starts again: the third frame is the first.
    let line =
        ["leaf.gltf", "--animation", "turn", "--frames", "3", "--fps", "1", "--orbit", "10,20", "-o", "h-%d.png"];
    succeeds(folder, &arguments(&line));
    assert_eq!(pixels(folder, "h-0.png"), pixels(folder, "h-2.png"));
    assert!(pixels(folder, "h-0.png") != pixels(folder, "h-1.png"));

    let info =
        Command::new(env!("CARGO_BIN_EXE_lightsum")).args(["info", "leaf.gltf"]).current_dir(folder).output().unwrap();
    let said = text(&info.stdout);
    assert!(said.contains("animation: \"turn\", 2.000 s from 0.000 s") && !said.contains("left out"), "{said}");
}

#[test]
fn animations_that_are_not_there_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    animated(folder);
    for (line, words) in [
        (&["leaf.gltf", "--animation", "jump"][..], &["--animation", "\"jump\"", "\"turn\", \"ride\""][..]),
        (&[SCENE], &["--path", "no animation"]),
        (&[SCENE, "--animation", "turn"], &["--animation", "no animation"]),
        (&["leaf.gltf", "--path", TURN, "--frames", "3"], &["--frames", "--path"]),
        (&["leaf.gltf", "--fps", "0"], &["--fps"]),
        (&["leaf.gltf", "--fps", "1000000"], &["--frames", "1000000"]),
    ] {
        let output = run(folder, &arguments(line));
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line:?}: {message}");
        assert!(words.iter().all(|word| message.contains(word)), "{line:?}: {message}");
    }
}

/// A frame of a path with an open shutter; the same as a still image, and by the path tracer.
#[test]
fn an_open_shutter_blurs_what_moves() {
    let folder = tempfile::tempdir().unwrap();
    let slide = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/slide.toml")).unwrap();
    fs::write(folder.path().join("slide.toml"), slide.replace("frames = 9", "times = [1.0]")).unwrap();
    let frame = |name: &str| image::open(folder.path().join(name)).unwrap().into_rgb8().into_raw();
    let path = arguments(&[SCENE, "--path", "slide.toml", "--shutter"]);
    for flags in [&["0", "-o", "sharp-%d.png"][..], &["1", "-o", "blurred-%d.png", "--validation"]] {
        succeeds(folder.path(), &[&path[..], flags, &["--moving-passes", "1"]].concat());
    }
    let render = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
        command.arg("render").args(&SMALL[..2]).args([SCENE, "--path", "slide.toml", "--at", "1"]).args(more);
        let output = command.current_dir(folder.path()).env("XDG_CACHE_HOME", crate::render::cache()).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
    };
    render(
        &[&SMALL[2..], &["--passes", "1", "--shutter", "1", "-o", "still.png", "-o", "still.exr", "--surfaces"]]
            .concat(),
    );
    let motion = |name: &str| {
        let image = exr::prelude::read_first_flat_layer_from_file(folder.path().join("still.exr")).unwrap();
        let channel = image.layer_data.channel_data.list.iter().find(|channel| channel.name.to_string() == name);
        channel.unwrap_or_else(|| panic!("no {name}")).sample_data.values_as_f32().map(f32::abs).collect::<Vec<_>>()
    };
    for name in ["motion.X", "motion.Y"] {
        let pixels = motion(name);
        assert!(pixels.iter().all(|moved| moved.is_finite()) && pixels.iter().any(|&moved| moved < 0.1), "{name}");
    }
    // Pixels whose surface moves by more than a pixel while the shutter is open.
    let (x, y) = (motion("motion.X"), motion("motion.Y"));
    let moving = x.iter().zip(&y).filter(|(x, y)| x.hypot(**y) > 1.0).count();
    assert!(moving > 10 && moving < x.len(), "{moving} of {}", x.len());
    let traced = ["--reference", "--spp", "64", "--max-depth", "2"];
    render(&[&traced[..], &["--shutter", "1", "-o", "traced.png"]].concat());
    render(&[&traced[..], &["-o", "instant.png"]].concat());
    let differ = |a: &str, b: &str| frame(a).iter().zip(&frame(b)).filter(|(a, b)| a.abs_diff(**b) > 10).count();
    let [blurs, stands, traces] =
        [["blurred-0.png", "sharp-0.png"], ["blurred-0.png", "still.png"], ["traced.png", "instant.png"]]
            .map(|[a, b]| differ(a, b));
    assert!(blurs > 40 && traces > 60, "{blurs} {traces}");
    // The still image begins in that pose, so places are rounded otherwise.
    assert!(stands < 30, "{stands}");
}

#[test]
fn parts_of_an_animation_have_the_frames_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    animated(folder);
    // The leaf turns for two seconds and stands still for two; frames at rest accumulate.
    let path = "times = [0, 1, 2, 3, 4]\n[[camera]]\ntime = 0\n";
    fs::write(folder.join("p.toml"), path).unwrap();
    let more = |output: &str, part: &str| {
        let line = format!(
            "leaf.gltf --path p.toml --animation turn -o {output}-%d.png --moving-passes 2 --exposure auto {part}"
        );
        succeeds(folder, &arguments(&line.split_whitespace().collect::<Vec<_>>()))
    };
    more("a", "");
    let said = more("b", "--frames 3..5");
    assert!(said.contains("2 frames of 2 passes"), "{said}");
    more("b", "--frames 0..2");
    more("b", "--frames 2..3");
    for frame in 0..5 {
        let [a, b] = ["a", "b"].map(|name| fs::read(folder.join(format!("{name}-{frame}.png"))).unwrap());
        assert!(a == b, "frame {frame} differs");
    }
    for (line, words) in [
        ("leaf.gltf --path p.toml --frames 3..6 -o c-%d.png", ["--frames", "5 frames"]),
        ("leaf.gltf --path p.toml --frames 3..5/9 -o c-%d.png", ["--frames", "--path"]),
        ("leaf.gltf --path p.toml --frames 1..2 --ring images -o c-%d.png", ["--frames", "ring"]),
    ] {
        let output = run(folder, &arguments(&line.split_whitespace().collect::<Vec<_>>()));
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {message}");
        assert!(words.iter().all(|word| message.contains(word)), "{line}: {message}");
    }
}
