//! `lightsum bake` and `--light-from` as a user meets them.
//!
//! LIGHTSUM_DEVICE names the device, as for all tests with a device.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A room without a front: floor, back wall, and a lamp that shines down.
const MODEL: &str = "mtllib room.mtl
v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1
v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5
v -1 1 -1\nv 1 1 -1
usemtl floor\nf 1 2 3 4
usemtl wall\nf 1 4 10 9
usemtl lamp\nf 5 6 7 8
";
const MATERIALS: &str =
    "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl wall\nKd 0.2 0.6 0.3\nnewmtl lamp\nKd 0 0 0\nKe 10 10 10\n";
const SCENE: &str = "model = \"room.obj\"
[camera]
eye = [0.0, 0.5, 4.0]
target = [0.0, 0.4, 0.0]
fov_y = 30.0
resolution = [40, 32]
";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in [("room.obj", MODEL), ("room.mtl", MATERIALS), ("scene.toml", SCENE)] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn command(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    command.args(line.split_whitespace());
    if let Ok(device) = std::env::var("LIGHTSUM_DEVICE") {
        command.args(["--device", &device]);
    }
    command.current_dir(folder).env_remove("RUST_LOG").env("XDG_CACHE_HOME", crate::render::cache());
    command
}

fn lightsum(folder: &Path, line: &str) -> Output {
    command(folder, line).output().expect("the program starts")
}

#[track_caller]
fn works(folder: &Path, line: &str) -> String {
    let output = lightsum(folder, line);
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[track_caller]
fn fails(folder: &Path, line: &str) -> String {
    let output = lightsum(folder, line);
    assert!(!output.status.success(), "{line}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn mean(file: &Path) -> f32 {
    let image = image::open(file).unwrap().to_rgb32f();
    image.pixels().map(|p| p.0.iter().sum::<f32>()).sum::<f32>() / (3 * image.width() * image.height()) as f32
}

#[test]
fn what_is_baked_is_shown_again() {
    let folder = folder();
    let folder = folder.path();
    let bake = "bake scene.toml -o room.glb --density 16 --passes 8 --clip 0.1";
    let told = works(folder, bake);
    assert!(
        told.contains("texels") && told.contains("MiB") && told.contains("room.glb, room-irradiance-0.exr"),
        "{told}"
    );
    works(folder, "render scene.toml --float --no-layers --passes 8 -o full.exr");
    works(folder, "render scene.toml --float --no-layers --passes 8 -o kept.exr --light-from room.glb");
    let ratio = mean(&folder.join("kept.exr")) / mean(&folder.join("full.exr"));
    assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
    // Other forms.
    let told =
        works(folder, "bake scene.toml -o apart.glb --density 8 --passes 2 --parts apart --max-size 64 --padding 1");
    assert!(told.contains("apart-direct-0.exr") && told.contains("apart-indirect-0.exr"), "{told}");
    works(folder, "bake scene.toml -o unlit.glb --density 8 --passes 2 --unlit --exposure auto --tonemap agx");
    let message = fails(folder, "render scene.toml -o a.png --light-from scene.toml");
    assert!(message.contains("scene.toml") && !message.contains("panicked"), "{message}");
    let message = fails(folder, "render scene.toml -o a.png --light-from room.glb --soft-shadows splat");
    assert!(message.contains("--soft-shadows") && message.contains("leave out --light-from"), "{message}");
    works(folder, "bake scene.toml -o indirect.glb --density 8 --passes 2 --parts indirect");
    let message = fails(folder, "render scene.toml -o a.png --light-from indirect.glb");
    assert!(message.contains("--parts"), "{message}");
}

#[test]
fn a_walkthrough_shows_what_was_baked() {
    let folder = folder();
    let folder = folder.path();
    works(folder, "bake scene.toml -o room.glb --density 16 --passes 8");
    let keys = "frames = 3\n[[camera]]\ntime = 0.0\n[[camera]]\ntime = 1.0\neye = [0.6, 0.7, 3.5]\n";
    fs::write(folder.join("walk.toml"), keys).unwrap();
    let flags = "--path walk.toml --moving-passes 4 --layers --float --resolution 40x32";
    works(folder, &format!("animate scene.toml -o kept-%d.exr --timings t.json --light-from room.glb {flags}"));
    works(folder, &format!("animate scene.toml -o full-%d.exr {flags}"));
    for frame in 0..3 {
        let [kept, full] = ["kept", "full"].map(|name| mean(&folder.join(format!("{name}-{frame}.exr"))));
        assert!((kept / full - 1.0).abs() < 0.05, "{frame}: {kept} and {full}");
    }
    let timings: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("t.json")).unwrap()).unwrap();
    for frame in timings["frames"].as_array().unwrap() {
        assert!(frame["gpu_passes"]["kept_light"].as_f64() > Some(0.0), "{frame}");
    }
    // A frame is what `render` shows from there.
    works(
        folder,
        "render scene.toml -o still.exr --float --path walk.toml --at 0.5 --passes 4 --light-from room.glb --resolution 40x32",
    );
    let (still, frame) = (mean(&folder.join("still.exr")), mean(&folder.join("kept-1.exr")));
    assert!((still / frame - 1.0).abs() < 0.01, "{still} and {frame}");

    let objects = "frames = 2\n[[object]]\nname = \"unnamed\"\nkeys = [{ time = 0 }]\n";
    fs::write(folder.join("moves.toml"), objects).unwrap();
    let line = "animate scene.toml -o m-%d.png --path moves.toml --light-from room.glb";
    let message = fails(folder, line);
    assert!(message.contains("--light-from") && message.contains("objects move"), "{message}");
}

#[test]
fn a_bake_goes_on_where_it_stopped() {
    let folder = folder();
    let folder = folder.path();
    let bake = |passes: u32, rest: &str| {
        works(folder, &format!("bake scene.toml -o room.glb --density 16 --particles 8 --passes {passes} {rest}"));
        fs::read(folder.join("room-irradiance-0.exr")).unwrap()
    };
    let whole = bake(6, "");
    assert!(!folder.join("room.glb.state").exists());
    bake(2, "--resume");
    assert!(folder.join("room.glb.state").exists());
    assert_eq!(bake(6, "--resume"), whole, "the bits of an uninterrupted bake");
    let message = fails(folder, "bake scene.toml -o room.glb --density 12 --particles 8 --passes 6 --resume");
    assert!(message.contains("state"), "{message}");
}

#[test]
fn a_bake_with_several_parts_goes_on_where_it_stopped() {
    let folder = folder();
    let folder = folder.path();
    let bake = |passes: u32, rest: &str| {
        // More texels than a part holds.
        works(
            folder,
            &format!("bake scene.toml -o room.glb --density 250 --particles 2 --light-pool 0 --passes {passes} {rest}"),
        );
        fs::read(folder.join("room-irradiance-0.exr")).unwrap()
    };
    let whole = bake(2, "");
    assert!(!folder.join("room.glb.1.state").exists());
    bake(1, "--resume");
    assert!(folder.join("room.glb.1.state").exists());
    // As if it had been interrupted in the first pass of the second part.
    fs::remove_file(folder.join("room.glb.1.state")).unwrap();
    assert_eq!(bake(2, "--resume"), whole, "the bits of an uninterrupted bake");
}

#[test]
fn coordinates_of_light_maps_are_kept() {
    let folder = folder();
    let folder = folder.path();
    let bake = "--density 16 --passes 4 --clip 0.1 --seed 5";
    works(folder, &format!("bake scene.toml -o first.glb {bake}"));
    let charts = |told: &str| told.split(" charts").next().unwrap().rsplit([' ', '\n']).next().unwrap().to_owned();
    // The model holds the coordinates of its maps, on which its own light is baked again: by texels of the same places.
    let told = works(folder, &format!("bake first.glb -o second.glb {bake}"));
    assert!(charts(&told) == "2" && told.contains("on a map of") && !told.contains("new charts"), "{told}");
    let coordinates = |name: &str| {
        let (document, buffers, _) = gltf::import(folder.join(name)).unwrap();
        let mut all: Vec<[f32; 2]> = Vec::new();
        for primitive in document.meshes().flat_map(|m| m.primitives()) {
            let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
            all.extend(reader.read_tex_coords(1).into_iter().flat_map(|uvs| uvs.into_f32()));
        }
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        all
    };
    let (first, second) = (coordinates("first.glb"), coordinates("second.glb"));
    assert!(first.len() == second.len() && first.len() == 8, "{first:?} {second:?}");
    let near = |(a, b): (&[f32; 2], &[f32; 2])| (a[0] - b[0]).abs() < 1e-5 && (a[1] - b[1]).abs() < 1e-5;
    assert!(first.iter().zip(&second).all(near), "{first:?} {second:?}");
    let anew = works(folder, &format!("bake first.glb -o second.glb --new-charts {bake}"));
    assert!(anew.contains("charts"), "{anew}");
    // The light that is kept by them.
    works(folder, &format!("bake first.glb -o second.glb {bake}"));
    works(folder, "render first.glb --float --no-layers --passes 8 -o full.exr --resolution 40x32");
    works(
        folder,
        "render first.glb --float --no-layers --passes 8 -o kept.exr --resolution 40x32 --light-from second.glb",
    );
    let ratio = mean(&folder.join("kept.exr")) / mean(&folder.join("full.exr"));
    assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
}

#[test]
fn coordinates_that_do_not_do_are_told_by_object() {
    let folder = folder();
    let folder = folder.path();
    works(folder, "bake scene.toml -o first.glb --density 8 --passes 1");
    // The second number of the first coordinate, moved far outside.
    let mut bytes = fs::read(folder.join("first.glb")).unwrap();
    let document = gltf::Gltf::from_slice(&bytes).unwrap().document;
    let primitive =
        document.meshes().flat_map(|m| m.primitives()).find(|p| p.get(&gltf::Semantic::TexCoords(1)).is_some());
    let accessor = primitive.unwrap().get(&gltf::Semantic::TexCoords(1)).unwrap();
    let text = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let at = 20 + text + 8 + accessor.view().unwrap().offset() + accessor.offset();
    bytes[at..at + 4].copy_from_slice(&7.5f32.to_le_bytes());
    fs::write(folder.join("wrong.glb"), &bytes).unwrap();
    let told = works(folder, "bake wrong.glb -o second.glb --density 8 --passes 1");
    let object = document.nodes().next().unwrap().name().unwrap().to_owned();
    assert!(told.contains(&format!("{object:?} gets new charts")) && told.contains("outside"), "{told}");
}

#[test]
fn a_target_error_and_a_time_end_a_bake() {
    let folder = folder();
    let folder = folder.path();
    let told = works(folder, "bake scene.toml -o room.glb --density 8 --target-error 0.2 --time 60");
    assert!(told.contains("estimated error"), "{told}");
}

#[test]
fn an_adaptive_bake_goes_on_where_it_stopped() {
    let folder = folder();
    let folder = folder.path();
    let bake = |passes: u32, rest: &str| {
        let line = "bake scene.toml -o room.glb --adaptive 0.1 --height 4 --particles 8";
        let told = works(folder, &format!("{line} --passes {passes} {rest}"));
        (told, fs::read(folder.join("room-irradiance-0.exr")).unwrap())
    };
    let (_, whole) = bake(24, "");
    let states = ["room.glb.state", "room.glb.0.state"].map(|name| folder.join(name));
    assert!(states.iter().all(|state| !state.exists()));
    bake(18, "--resume");
    assert!(states.iter().all(|state| state.exists()));
    let (_, resumed) = bake(24, "--resume");
    assert!(resumed == whole, "the bits of an uninterrupted bake");
    // The rounds are done again if their state is lost.
    fs::remove_file(&states[0]).unwrap();
    assert!(bake(24, "--resume").1 == whole);
    let other =
        fails(folder, "bake scene.toml -o room.glb --adaptive 0.2 --height 4 --particles 8 --passes 24 --resume");
    assert!(other.contains("room.glb.state") && other.contains("remove the state"), "{other}");
    let (told, _) = bake(100_000, "--target-error 0.5 --seed 4");
    assert!(told.contains("estimated error 0."), "{told}");
    let told = fails(folder, "bake scene.toml -o room.glb --time 0.001");
    assert!(told.contains("seconds were over before the first pass"), "{told}");
    // How far two seconds reach depends on the machine: the layout, the rounds, or the passes after them.
    let line = "bake scene.toml -o timed.glb --adaptive 0.1 --height 4 --time 2 --target-error 0.00001";
    let timed = lightsum(folder, line);
    let told = [timed.stdout, timed.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    assert_eq!(timed.status.success(), folder.join("timed.glb").exists(), "{told}");
    assert!(told.contains("baked in") || told.contains("the 2 seconds were over before the first pass"), "{told}");
}

#[cfg(unix)]
mod signals {
    use super::*;
    use std::io::{BufRead, BufReader, Read};
    use std::process::{Child, ChildStderr, Stdio};

    /// A bake that was begun, after its first line of progress.
    fn begun(folder: &Path, line: &str) -> (Child, BufReader<ChildStderr>) {
        let mut run = command(folder, line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut stderr = BufReader::new(run.stderr.take().unwrap());
        let mut told = String::new();
        while !(told.contains(" left") || told.starts_with("round")) {
            told.clear();
            assert!(stderr.read_line(&mut told).unwrap() > 0, "the bake ends before it tells its progress");
        }
        (run, stderr)
    }

    /// Sends a signal and waits; returns what the bake told.
    fn interrupt((mut run, mut stderr): (Child, BufReader<ChildStderr>), signal: &str) -> String {
        let killed = Command::new("sh").args(["-c", &format!("kill -{signal} {}", run.id())]).status().unwrap();
        assert!(killed.success());
        let mut rest = String::new();
        stderr.read_to_string(&mut rest).unwrap();
        let status = run.wait().unwrap();
        if signal != "KILL" {
            assert_eq!(status.code(), Some(0), "{signal}: {rest}");
        }
        rest
    }

    #[test]
    fn an_interrupt_writes_what_there_is_and_resume_finishes() {
        let folder = folder();
        let folder = folder.path();
        // The same bits at the end, from states of the last passes and of rounds.
        for (signal, state, flags) in [
            ("TERM", "room.glb.state", "--density 16 --particles 8"),
            ("INT", "room.glb.0.state", "--adaptive 0.1 --height 4 --particles 8"),
            ("HUP", "room.glb.state", "--adaptive 0.001 --height 9 --elements 400000 --particles 64"),
        ] {
            let line = |passes: u32| format!("bake scene.toml -o room.glb {flags} --passes {passes}");
            let rest = interrupt(begun(folder, &line(1_000_000)), signal);
            assert!(rest.contains("interrupted") && rest.contains(state) && rest.contains("--resume"), "{rest}");
            assert!(mean(&folder.join("room-irradiance-0.exr")) > 0.0);
            let state = lightsum::output::State::read(&folder.join(state)).unwrap();
            if signal != "HUP" {
                works(folder, &format!("{} --resume", line(state.passes + 3)));
                let resumed = fs::read(folder.join("room-irradiance-0.exr")).unwrap();
                for name in ["room.glb.state", "room.glb.0.state"] {
                    let _ = fs::remove_file(folder.join(name));
                }
                works(folder, &line(state.passes + 3));
                assert!(resumed == fs::read(folder.join("room-irradiance-0.exr")).unwrap(), "{signal}");
            }
        }
    }

    #[test]
    fn a_killed_adaptive_bake_goes_on_from_its_checkpoint() {
        let folder = folder();
        let folder = folder.path();
        let line = "bake scene.toml -o room.glb --adaptive 0.1 --height 4 --particles 8";
        let run = begun(folder, &format!("{line} --passes 1000000 --checkpoint 0.05"));
        interrupt(run, "KILL");
        let state = lightsum::output::State::read(&folder.join("room.glb.0.state")).unwrap();
        let passes = state.passes + 2;
        works(folder, &format!("{line} --passes {passes} --resume"));
        let resumed = fs::read(folder.join("room-irradiance-0.exr")).unwrap();
        works(folder, &format!("{line} --passes {passes}"));
        assert!(resumed == fs::read(folder.join("room-irradiance-0.exr")).unwrap());
    }
}

#[test]
fn wrong_use_is_told() {
    let folder = folder();
    let folder = folder.path();
    for (line, word) in [
        ("bake scene.toml -o room.png", ".glb"),
        ("bake scene.toml -o room.glb --density 1e6", "--density"),
        ("bake scene.toml -o room.glb --density 0", "--density"),
        ("bake scene.toml -o room.glb --max-size 7", "--max-size"),
        ("bake scene.toml -o absent/room.glb", "absent"),
        ("bake absent.toml -o room.glb", "absent.toml"),
        ("bake scene.toml -o room.glb --exposure 1", "--unlit"),
        ("render scene.toml -o a.png --light-from absent.glb", "absent.glb"),
    ] {
        let message = fails(folder, line);
        assert!(message.contains(word) && !message.contains("panicked"), "{line}: {message}");
        assert!(!folder.join("room.glb").exists());
    }
}

#[test]
fn adaptive_bakes_are_shown_like_others() {
    let folder = folder();
    let folder = folder.path();
    let told =
        works(folder, "bake scene.toml -o room.glb --adaptive 0.05 --height 5 --passes 8 --clip 0.1 --prefilter 4");
    assert!(told.contains("surfaces") && told.contains("MiB") && told.contains("rounds"), "{told}");
    works(folder, "render scene.toml --float --no-layers --passes 8 -o full.exr");
    for lookup in ["bilinear", "bicubic"] {
        let kept = format!("{lookup}.exr");
        works(
            folder,
            &format!(
                "render scene.toml --float --no-layers --passes 8 -o {kept} --light-from room.glb --lookup {lookup}"
            ),
        );
        let ratio = mean(&folder.join(kept)) / mean(&folder.join("full.exr"));
        assert!((ratio - 1.0).abs() < 0.05, "{lookup}: {ratio}");
    }
    works(folder, "bake scene.toml -o few.glb --adaptive 0.05 --elements 20 --budget 0 --passes 1 --unlit");
    for (flags, named) in [
        ("--adaptive 0", "--adaptive"),
        ("--adaptive nan", "--adaptive"),
        ("--adaptive 0.1 --density 4", "--density"),
        ("--adaptive 0.1 --height 11", "--height"),
        ("--adaptive 0.1 --height 9 --max-size 256", "7 would fit"),
        ("--adaptive 0.1 --elements 1", "--elements"),
        ("--adaptive 0.1 --prefilter 7", "--prefilter"),
        ("--height 4", "--adaptive"),
    ] {
        let message = fails(folder, &format!("bake scene.toml -o a.glb {flags}"));
        assert!(message.contains(named) && !message.contains("panicked"), "{flags}: {message}");
    }
    let told = works(folder, "render scene.toml -o a.png --lookup bicubic --passes 1");
    assert!(told.contains("--lookup has no effect: it needs --light-from"), "{told}");
}
