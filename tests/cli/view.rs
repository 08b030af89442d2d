//! `lightsum view` under Xvfb, driven by a script: what it shows is what `render` and `animate` make of the same state.
//!
//! Needs Xvfb and the X libraries that scripts/setup.sh --tests installs. LIGHTSUM_DEVICE names the device, as for all tests with a device.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::examples::example;
#[cfg(target_os = "linux")]
use crate::faults::{DEVICE_LOST, run_command};
use crate::render::{channels, command, succeeds, text};

/// A room without a front, with a box in the middle of the view and a lamp that shines down.
const MODEL: &str = "mtllib room.mtl
o room
v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1
v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5
v -1 1 -1\nv 1 1 -1
usemtl floor\nf 1 2 3 4
usemtl wall\nf 1 4 10 9
o lamp
usemtl lamp\nf 5 6 7 8
o box
v -0.2 0.1 0\nv 0.2 0.1 0\nv 0.2 0.6 0\nv -0.2 0.6 0
v -0.2 0.1 -0.4\nv 0.2 0.1 -0.4\nv 0.2 0.6 -0.4\nv -0.2 0.6 -0.4
usemtl wall
f 11 12 13 14\nf 16 15 18 17\nf 12 16 17 13\nf 15 11 14 18\nf 14 13 17 18\nf 15 16 12 11
";
const MATERIALS: &str =
    "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl wall\nKd 0.2 0.6 0.3\nnewmtl lamp\nKd 0 0 0\nKe 10 10 10\n";
const SCENE: &str = "model = \"room.obj\"
[camera]
eye = [0.0, 0.5, 4.0]
target = [0.0, 0.4, 0.0]
fov_y = 30.0
";
/// Flags for quick passes.
const QUICK: &str = "--particles 4 --max-depth 3 --traversal single";

/// An X server without a screen, which goes with the test.
pub struct Display {
    server: Child,
    pub name: String,
}

impl Display {
    pub fn open() -> Display {
        // Without -noreset the server starts anew when its last client leaves, and refuses the next one meanwhile.
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts; scripts/setup.sh --tests installs it");
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        assert!(!number.trim().is_empty(), "Xvfb has no display");
        Display { server, name: format!(":{}", number.trim()) }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (other, glossy) = (
        SCENE.replace("30.0", "24.0"),
        format!("{SCENE}[materials.floor]\nspecular = [0.4, 0.4, 0.4]\nroughness = 0.2\n"),
    );
    let scenes = [("scene.toml", SCENE), ("other.toml", &other), ("glossy.toml", &glossy)];
    for (name, text) in [("room.obj", MODEL), ("room.mtl", MATERIALS)].into_iter().chain(scenes) {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// An attribute of an EXR file that is JSON.
fn attribute(path: &Path, name: &str) -> serde_json::Value {
    let meta = exr::meta::MetaData::read_from_file(path, false).unwrap();
    let found = meta.headers[0].own_attributes.other.iter().find(|entry| *entry.0 == *name);
    let Some((_, exr::meta::attribute::AttributeValue::Text(text))) = found else { panic!("{name} is missing") };
    serde_json::from_str(&text.to_string()).unwrap()
}

#[track_caller]
fn assert_close(a: &Path, b: &Path, tolerance: f32) {
    let (a, b) = (channels(a), channels(b));
    for name in ["R", "G", "B"] {
        let mean = b[name].iter().sum::<f32>() / b[name].len() as f32;
        assert!(mean > 0.01 && a[name].len() == b[name].len(), "{name}: {mean}");
        let worst = a[name].iter().zip(&b[name]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= tolerance * mean, "{name}: {worst} of {mean}");
    }
}

/// Coarse frames of a view that turns, and the red of the image when it stands still.
fn turned(flags: &str) -> (u64, Vec<f32>) {
    let (display, folder) = (Display::open(), folder());
    let script = "window 96x72\npanel off\npasses 1\ndrag right 20,20 32,26\npasses 2\nscreenshot still.exr\nquit\n";
    fs::write(folder.path().join("script.txt"), script).unwrap();
    let line = format!("view scene.toml --script script.txt --validation {QUICK} {flags}");
    let mut view = command(folder.path(), &line);
    view.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY");
    let output = view.output().unwrap();
    let (told, said) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{told}{said}");
    let file = folder.path().join("still.exr");
    assert_eq!(attribute(&file, "settings")["shading_rate"], 1, "{said}");
    let summary: serde_json::Value = serde_json::from_str(told.lines().last().unwrap()).unwrap();
    (summary["coarse_frames"].as_u64().unwrap(), channels(&file).remove("R").unwrap())
}

#[test]
fn a_view_in_motion_lights_fewer_points_and_the_still_image_all() {
    let (coarse, still) = turned("");
    let (none, same) = turned("--shading-rate 1");
    assert!(coarse > 0 && none == 0, "{coarse} and {none} coarse frames");
    assert!(still == same && still.iter().sum::<f32>() > 0.0);
}

#[test]
fn a_script_walks_through_a_scene() {
    let (display, folder) = (Display::open(), folder());
    let script = "
window 96x72
panel off
passes 2
key M                           # coarser in motion
drag right 20,20 32,26          # the view turns
key O
wheel 0.5                       # and goes on a little
set --particles 8 --max-depth 3 --seed 3
window 80x60
passes 4
screenshot turned.exr
key Home
key H                           # the help is drawn over the image
key H
click 40,32                     # the box is chosen
drag left 40,32 52,26           # moved across the view
drag left 52,26 60,26 ctrl      # and turned
key K
passes 4
screenshot moved.exr
path moved.toml
lights on
look normal
passes 4
look classes
look clusters
look specular                   # needs sums of its own
passes 2
look image
drop missing.obj                # is refused, and the scene stays
drop other.toml
passes 3
screenshot other.exr
screenshot other.png
set --particles 4 --max-depth 3 --ring images --ring-length 3
passes 5
drag right 20,20 32,26          # the ring goes on
passes 6
screenshot ring.exr
set --particles 4 --max-depth 3 --ring lights --ring-length 3
look emission                   # no ring has such sums
look image
passes 2
screenshot lights.exr
drop glossy.toml
set --particles 4 --max-depth 3 --superposition variant
kernels on                      # of the floor's mirror image
passes 2
quit
";
    fs::write(folder.path().join("script.txt"), script).unwrap();
    let line = format!("view scene.toml --script script.txt --validation {QUICK}");
    let mut view = command(folder.path(), &line);
    view.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY");
    // Sizes of a script are in pixels, whatever the scale of the display.
    let output = view.env("WINIT_X11_SCALE_FACTOR", "1.5").output().unwrap();
    let (told, said) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{told}{said}");
    assert!(said.contains("missing.obj") && !said.contains("panicked"), "{said}");
    let summary: serde_json::Value = serde_json::from_str(told.lines().last().unwrap()).unwrap();
    assert_eq!((&summary["validation_messages"], &summary["bytes_not_given_back"]), (&0.into(), &0.into()));
    assert!(summary["kernels"].as_u64() > Some(0), "{summary}");
    assert!(summary["coarse_frames"].as_u64() > Some(0), "{summary}");
    assert!(summary["moving_frame_ms"]["count"].as_u64() > Some(3), "{summary}");
    assert!(summary["input_to_image_ms"]["median"].as_f64() > Some(0.0), "{summary}");

    // The camera that the mouse left.
    let camera = attribute(&folder.path().join("turned.exr"), "camera");
    let point = |name: &str| {
        let numbers = camera[name].as_array().unwrap().iter().map(|x| x.as_f64().unwrap().to_string());
        numbers.collect::<Vec<_>>().join(",")
    };
    assert_ne!(point("eye"), "0,0.5,4");
    let size = "--resolution 80x60 --max-depth 3 --traversal single";
    let flags = format!("--eye {} --target {} --passes 4 --particles 8 --seed 3 {size}", point("eye"), point("target"));
    succeeds(folder.path(), &format!("render scene.toml -o expected.exr {flags}"));
    // A scene that may change has trees of its own, in which rays along edges may go either way.
    let file = |name: &str| folder.path().join(name);
    assert_close(&file("turned.exr"), &file("expected.exr"), 0.02);

    // The box that the mouse moved, played as a path: bit for bit.
    let moved = fs::read_to_string(file("moved.toml")).unwrap();
    assert!(moved.contains("name = \"box\"") && moved.contains("degrees = 4.0"), "{moved}");
    let flags = format!("--path moved.toml --moving-passes 4 --particles 8 --seed 3 {size}");
    succeeds(folder.path(), &format!("animate scene.toml -o frame-%d.exr {flags}"));
    let (shown, played) = (channels(&file("moved.exr")), channels(&file("frame-0.exr")));
    for name in ["R", "G", "B", "A"] {
        assert!(shown[name] == played[name], "{name} of the box that moved");
    }
    assert_ne!(shown["R"], channels(&file("turned.exr"))["R"]);

    succeeds(
        folder.path(),
        &format!("render other.toml -o expected.exr -o expected.png --passes 3 --resolution 80x60 {QUICK}"),
    );
    assert_close(&file("other.exr"), &file("expected.exr"), 0.02);
    assert_eq!(image::image_dimensions(file("other.png")).unwrap(), (80, 60));

    assert!(said.contains("--summands"), "{said}");
    assert!(attribute(&file("ring.exr"), "passes").as_u64() > Some(10), "a drag does not empty a ring");
    for (name, form) in [("ring.exr", "images"), ("lights.exr", "lights")] {
        assert_eq!(attribute(&file(name), "settings")["ring"]["form"], form);
        let green = &channels(&file(name))["G"];
        assert!(green.iter().sum::<f32>() / green.len() as f32 > 0.01, "{name}");
    }
}

#[test]
fn a_window_shows_light_that_was_baked() {
    let (display, folder) = (Display::open(), folder());
    succeeds(folder.path(), "bake scene.toml -o room.glb --density 16 --passes 8");
    let script = "
window 80x60
panel off
passes 4
screenshot kept.exr
click 40,32                     # no object can be chosen
drag left 40,32 52,26           # so that this turns the view
wheel 0.5
key K
passes 4
screenshot turned.exr
path walk.toml
set --lookup bicubic
passes 2
quit
";
    fs::write(folder.path().join("script.txt"), script).unwrap();
    let mut view = command(folder.path(), "view scene.toml --script script.txt --validation --light-from room.glb");
    view.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY").env("WINIT_X11_SCALE_FACTOR", "1");
    let output = view.output().unwrap();
    let (told, said) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{told}{said}");
    let summary: serde_json::Value = serde_json::from_str(told.lines().last().unwrap()).unwrap();
    assert_eq!((&summary["validation_messages"], &summary["bytes_not_given_back"]), (&0.into(), &0.into()));
    let file = |name: &str| folder.path().join(name);
    let flags = "--light-from room.glb --passes 4 --resolution 80x60";
    succeeds(folder.path(), &format!("render scene.toml -o expected.exr {flags}"));
    assert_close(&file("kept.exr"), &file("expected.exr"), 0.02);
    // The path that was recorded leads to the same view.
    succeeds(folder.path(), &format!("render scene.toml -o expected.exr --path walk.toml {flags}"));
    assert_close(&file("turned.exr"), &file("expected.exr"), 0.02);
    assert_ne!(channels(&file("turned.exr"))["R"], channels(&file("kept.exr"))["R"]);
}

#[test]
#[cfg(target_os = "linux")]
fn a_window_whose_device_is_lost_ends_in_order() {
    let (display, folder) = (Display::open(), folder());
    fs::write(folder.path().join("script.txt"), "window 32x24\npanel off\npasses 30\nquit\n").unwrap();
    let view = || {
        let mut view = command(folder.path(), &format!("view scene.toml --script script.txt {QUICK}"));
        view.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY");
        view
    };
    let whole = run_command(view(), &[]);
    assert!(whole.output.status.success(), "{}", text(&whole.output.stderr));
    // The first submissions are uploads and the first frames.
    let submissions = whole.submissions();
    assert!(submissions.len() > 20, "{submissions:?}");
    let lost = run_command(view(), &[(submissions[12], DEVICE_LOST)]);
    let (told, said) = (text(&lost.output.stdout), text(&lost.output.stderr));
    assert_eq!(lost.output.status.code(), Some(1), "{said}");
    assert!(said.contains("the device was lost") && !said.contains("panicked"), "{said}");
    let summary: serde_json::Value = serde_json::from_str(told.lines().last().unwrap()).unwrap();
    assert_eq!(summary["bytes_not_given_back"], 0, "{summary}");
    assert!(summary["frames"].as_u64() > Some(0), "{summary}");
}

#[test]
fn without_a_display_it_says_what_to_do() {
    let folder = folder();
    let mut view = command(folder.path(), "view scene.toml");
    let output =
        view.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET").output().unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("DISPLAY") && said.contains("lightsum render") && !said.contains("panicked"), "{said}");
    assert!(!said.contains(".rs:"), "no place in sources: {said}");
}

#[test]
fn the_example_of_a_window_shows_frames_and_closes() {
    let (folder, display) = (folder(), Display::open());
    let run = |arguments: &[&str]| {
        example("window", folder.path(), arguments)
            .env("DISPLAY", &display.name)
            .env_remove("WAYLAND_DISPLAY")
            .output()
            .unwrap()
    };
    let shown = run(&["scene.toml", "6"]);
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    // The camera turns for the first half: the image of the last frame has the passes since.
    let line = text(&shown.stdout);
    let numbers: Vec<u32> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert_eq!(numbers[0], 6, "{line}");
    assert!((2..=3).contains(&numbers[1]), "{line}");
    let missing = run(&["missing.toml", "1"]);
    assert!(!missing.status.success() && text(&missing.stderr).contains("missing.toml"), "{}", text(&missing.stderr));
}
