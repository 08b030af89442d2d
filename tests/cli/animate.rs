//! `lightsum animate`: frames, timings, and messages for wrong path files.
//!
//! LIGHTSUM_DEVICE names the device, as for all tests with a device.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml");
const TURN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/turn.toml");

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    command.arg("animate").args(arguments).current_dir(folder).env_remove("RUST_LOG");
    if let Ok(device) = std::env::var("LIGHTSUM_DEVICE") {
        command.args(["--device", &device]);
    }
    command.env("XDG_CACHE_HOME", folder.join("cache")).output().expect("the program starts")
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
    let output = command.env("XDG_CACHE_HOME", folder.path().join("cache")).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let [a, b] = ["2.png", "r.png"].map(|name| image::open(folder.path().join(name)).unwrap().into_rgb8().into_raw());
    // The tree differs, so rays within rounding of an edge may hit another triangle.
    let worst = a.iter().zip(&b).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(worst <= 2, "differs by {worst} of 255");
}

#[test]
fn wrong_paths_are_refused_by_file_line_and_key() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&str, &[&str]); 14] = [
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
