//! The command line with a device: outputs, resuming, and failures.
//!
//! LIGHTSUM_DEVICE names the device, as for all tests with a device.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Output, Stdio};
use std::time::{Duration, Instant};

use lightsum::output::State;

/// A room without a front: floor, back wall, and a lamp that shines down.
pub const MODEL: &str = "mtllib room.mtl
v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1
v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5
v -1 1 -1\nv 1 1 -1
usemtl floor\nf 1 2 3 4
usemtl wall\nf 1 4 10 9
usemtl lamp\nf 5 6 7 8
";
pub const MATERIALS: &str =
    "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl wall\nKd 0.2 0.6 0.3\nnewmtl lamp\nKd 0 0 0\nKe 10 10 10\n";
pub const SCENE: &str = "model = \"room.obj\"
[camera]
eye = [0.0, 0.5, 4.0]
target = [0.0, 0.4, 0.0]
fov_y = 30.0
resolution = [20, 16]
";

/// A folder with the scene.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in [("room.obj", MODEL), ("room.mtl", MATERIALS), ("scene.toml", SCENE)] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// The folder of the kernels that drivers have compiled, which all runs share: it outlives the tests, as a user's does.
pub fn cache() -> &'static str {
    concat!(env!("CARGO_TARGET_TMPDIR"), "/cache")
}

/// The program in a folder.
pub fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    command.args(arguments.split_whitespace()).current_dir(folder).env_remove("RUST_LOG");
    let renders = ["render", "animate", "bake"].iter().any(|name| arguments.starts_with(name));
    if let (Ok(device), true) = (std::env::var("LIGHTSUM_DEVICE"), renders && !arguments.contains("--device")) {
        command.args(["--device", &device]);
    }
    command.env("XDG_CACHE_HOME", cache());
    command
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[track_caller]
pub fn succeeds(folder: &Path, arguments: &str) -> Output {
    let output = command(folder, arguments).output().expect("the program starts");
    assert!(output.status.success(), "{arguments}: {}", text(&output.stderr));
    output
}

/// Contents of the files of a folder by name, without the cache.
pub fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    entries.filter(|path| path.is_file()).map(|path| (name(&path), fs::read(&path).unwrap_or_default())).collect()
}

/// Runs it, checks the exit code, that the message contains `names`, and that no file was changed or left; returns the
/// message.
#[track_caller]
pub fn fails(folder: &Path, arguments: &str, code: i32, names: &[&str]) -> String {
    fs::write(folder.join("old.exr"), "an image from before").unwrap();
    let before = contents(folder);
    let output = command(folder, arguments).output().expect("the program starts");
    let message = text(&output.stderr);
    println!("{arguments}\n    {}", message.trim_end());
    assert_eq!(output.status.code(), Some(code), "{arguments}: {message}");
    assert!(message.lines().any(|line| line.starts_with("error: ")), "{arguments}: {message}");
    assert!(!message.contains("panicked"), "{arguments}: {message}");
    for name in names {
        assert!(message.contains(name), "{arguments}: no {name:?} in {message}");
    }
    assert!(contents(folder) == before, "{arguments} left or changed a file");
    message
}

/// The channels of an EXR file by name.
pub fn channels(path: &Path) -> BTreeMap<String, Vec<f32>> {
    let image = exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    let list = image.layer_data.channel_data.list;
    list.iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
}

#[test]
fn images_layers_and_statistics_are_written() {
    let folder = folder();
    let output = succeeds(
        folder.path(),
        "render scene.toml -o a.exr -o a.png --float --passes 8 --particles 8 --compensation exact --filter off --no-antialias \
         --stats a.json --validation",
    );
    let last = text(&output.stdout).lines().last().unwrap_or_default().to_owned();
    assert!(last.contains("8 passes") && last.ends_with("-> a.exr, a.png"), "{last}");
    assert_eq!(image::image_dimensions(folder.path().join("a.png")).unwrap(), (20, 16));

    let image = channels(&folder.path().join("a.exr"));
    let mut names: Vec<String> = ["R", "G", "B", "A", "depth.Z"].map(String::from).into();
    names.extend(["X", "Y", "Z"].map(|c| format!("normal.{c}")));
    for layer in ["albedo", "irradiance_direct", "irradiance_indirect"] {
        names.extend(["R", "G", "B"].map(|c| format!("{layer}.{c}")));
    }
    names.sort();
    assert_eq!(image.keys().cloned().collect::<Vec<_>>(), names);
    // Pixels that show only the wall: L = albedo E / pi.
    let shows_wall = |&i: &usize| image["A"][i] == 1.0 && (image["albedo.G"][i] - 0.6).abs() < 1e-3;
    let wall: Vec<usize> = (0..20 * 16).filter(shows_wall).collect();
    assert!(wall.len() > 20, "{} pixels show the wall", wall.len());
    for i in wall {
        let at = |name: &str| image[name][i];
        assert!((at("albedo.R") - 0.2).abs() < 1e-3 && (at("albedo.B") - 0.3).abs() < 1e-3);
        assert!((at("normal.Z") - 1.0).abs() < 1e-3, "the wall faces the eye");
        assert!((at("depth.Z") - 5.0).abs() < 0.1, "the wall is five away along the view, not {}", at("depth.Z"));
        for (c, albedo) in [("R", 0.2), ("G", 0.6), ("B", 0.3)] {
            let e = at(&format!("irradiance_direct.{c}")) + at(&format!("irradiance_indirect.{c}"));
            let l = albedo * e / std::f32::consts::PI;
            assert!(e > 0.0 && (at(c) - l).abs() <= 1e-4 * l, "{} is not {l}", at(c));
        }
    }

    let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("a.json")).unwrap()).unwrap();
    for key in ["device", "driver", "api", "scene"] {
        assert!(stats[key].as_str().is_some_and(|s| !s.is_empty()), "{key}: {}", stats[key]);
    }
    assert_eq!(stats["resolution"], serde_json::json!([20, 16]));
    assert_eq!((&stats["triangles"], &stats["passes"], &stats["passes_rendered"]), (&6.into(), &8.into(), &8.into()));
    for key in ["nodes", "lights_per_pass", "rays", "rays_per_second", "error_estimate"] {
        assert!(stats[key].as_f64().is_some_and(|v| v > 0.0), "{key}: {}", stats[key]);
    }
    for stage in ["load", "prepare", "render", "write"] {
        assert!(stats["stages"][stage].as_f64().is_some_and(|s| s >= 0.0), "{stage}: {}", stats["stages"]);
    }
    for pass in ["walk", "eye", "shade", "gather", "collect", "accumulate"] {
        assert!(stats["gpu_passes"][pass].as_f64().is_some_and(|s| s >= 0.0), "{pass}: {}", stats["gpu_passes"]);
    }
}

#[test]
fn a_resumed_run_equals_an_unbroken_one() {
    let folder = folder();
    let run = |output: &str, passes: u32, more: &str| {
        succeeds(folder.path(), &format!("render scene.toml -o {output} --particles 8 --passes {passes} {more}"))
    };
    run("whole.exr", 7, "");
    run("parts.exr", 3, "--resume");
    assert!(folder.path().join("parts.exr.state").exists());
    run("parts.exr", 7, "--resume");
    let image = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(image("whole.exr") == image("parts.exr"));
    // A second run with nothing left to do changes nothing.
    run("parts.exr", 7, "--resume");
    assert!(image("whole.exr") == image("parts.exr"));
    assert!(!contents(folder.path()).keys().any(|name| name.contains(".tmp")));

    // A state of another rendering, or a damaged one, is refused and kept.
    let state = folder.path().join("parts.exr.state");
    for (other, named) in [("--seed 1", "settings"), ("--max-depth 3", "settings"), ("--resolution 16x20", "20x16")] {
        let line = format!("render scene.toml -o parts.exr --particles 8 --passes 9 --resume {other}");
        fails(folder.path(), &line, 1, &["parts.exr.state", named]);
    }
    let whole = fs::read(&state).unwrap();
    fs::copy(&state, folder.path().join("other.exr.state")).unwrap();
    fs::write(folder.path().join("other.toml"), SCENE.replace("0.0, 0.4, 0.0", "0.0, 0.3, 0.0")).unwrap();
    fails(
        folder.path(),
        "render other.toml -o other.exr --particles 8 --passes 9 --resume",
        1,
        &["other.exr.state", "another scene"],
    );
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    for (bytes, named) in [(&whole[..whole.len() - 1], "cut off"), (&damaged[..], "damaged"), (b"PNG", "not a state")] {
        fs::write(&state, bytes).unwrap();
        let line = "render scene.toml -o parts.exr --particles 8 --passes 9 --resume";
        fails(folder.path(), line, 1, &["parts.exr.state", named]);
    }
}

/// A program that ends with its test, whatever becomes of that.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended; nothing is to be done then.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A rendering that goes on until it is stopped, after its first line of progress.
pub fn endless(folder: &Path, more: &str) -> (Running, BufReader<ChildStderr>) {
    let line = format!("render scene.toml -o a.exr --particles 8 --resolution 96x64 --passes 1000000 {more}");
    let mut run = Running(command(folder, &line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap());
    let mut stderr = BufReader::new(run.0.stderr.take().unwrap());
    let mut progress = String::new();
    stderr.read_line(&mut progress).unwrap();
    assert!(progress.contains("passes") && progress.contains("left"), "{progress}");
    (run, stderr)
}

pub fn kill(run: &Child, signal: &str) {
    let killed = Command::new("sh").args(["-c", &format!("kill -{signal} {}", run.id())]).status().unwrap();
    assert!(killed.success());
}

/// Goes on from the state of `a.exr` for three passes and compares with an unbroken run.
fn finishes(folder: &Path) {
    let passes = State::read(&folder.join("a.exr.state")).unwrap().passes;
    assert!(passes > 0);
    let line = |output: &str| {
        format!("render scene.toml -o {output} --particles 8 --resolution 96x64 --passes {}", passes + 3)
    };
    succeeds(folder, &format!("{} --resume", line("a.exr")));
    succeeds(folder, &line("b.exr"));
    let image = |name: &str| fs::read(folder.join(name)).unwrap();
    assert!(image("a.exr") == image("b.exr"), "after {passes} passes and three more");
}

#[test]
fn an_interrupt_writes_what_there_is_and_resume_finishes() {
    for signal in ["INT", "TERM", "HUP"] {
        let folder = folder();
        let (mut run, mut stderr) = endless(folder.path(), "");
        kill(&run.0, signal);
        let mut rest = String::new();
        stderr.read_to_string(&mut rest).unwrap();
        let status = run.0.wait().unwrap();
        assert_eq!(status.code(), Some(0), "{signal}: {rest}");
        assert!(rest.contains("interrupted") && rest.contains("a.exr.state") && rest.contains("--resume"), "{rest}");
        assert!(channels(&folder.path().join("a.exr"))["R"].iter().any(|&r| r > 0.0));
        // All signals take one way, whose bits are compared once.
        match signal {
            "INT" => finishes(folder.path()),
            _ => assert!(State::read(&folder.path().join("a.exr.state")).unwrap().passes > 0),
        }
    }
}

#[test]
fn a_killed_run_goes_on_from_its_checkpoint() {
    let folder = folder();
    let (mut run, _stderr) = endless(folder.path(), "--checkpoint 0.05");
    let state = folder.path().join("a.exr.state");
    let start = Instant::now();
    while !state.exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "there is no checkpoint");
        std::thread::sleep(Duration::from_millis(10));
    }
    kill(&run.0, "KILL");
    assert!(!run.0.wait().unwrap().success());
    // As if it had been killed while it wrote them.
    let parts = [".a.exr.4194304-0.tmp", ".a.exr.state.4194304-3.tmp"].map(|name| folder.path().join(name));
    parts.iter().for_each(|part| fs::write(part, "part").unwrap());
    finishes(folder.path());
    assert!(!parts.iter().any(|part| part.exists()), "{:?}", contents(folder.path()).keys());
}

#[test]
fn a_finished_run_leaves_no_checkpoint() {
    let folder = folder();
    for checkpoint in ["0.001", "off"] {
        let line = format!("render scene.toml -o a.exr --particles 8 --passes 3 --checkpoint {checkpoint}");
        succeeds(folder.path(), &line);
        assert!(!folder.path().join("a.exr.state").exists());
    }
    let line = "render scene.toml -o a.exr --passes 1 --checkpoint 0";
    fails(folder.path(), line, 2, &["--checkpoint", "above 0", "off"]);
}

#[cfg(target_os = "linux")]
#[test]
fn an_image_that_cannot_be_written_leaves_its_state() {
    let folder = folder();
    let output = folder.path().join("a.exr");
    std::os::unix::fs::symlink("/dev/full", &output).unwrap();
    let line = "render scene.toml -o a.exr --particles 8 --resolution 96x64 --passes 2";
    let run = command(folder.path(), line).output().unwrap();
    let stderr = text(&run.stderr);
    assert_eq!(run.status.code(), Some(1), "{stderr}");
    assert!(
        ["a.exr: ", "state after 2 passes is in a.exr.state", "--resume"].iter().all(|t| stderr.contains(t)),
        "{stderr}"
    );
    fs::remove_file(&output).unwrap();
    finishes(folder.path());
}

#[test]
fn exported_lights_are_rendered_again() {
    let folder = folder();
    let output = succeeds(folder.path(), "render scene.toml --particles 16 --export-lights lights.gltf");
    assert!(text(&output.stdout).contains("virtual lights to lights.gltf"), "{}", text(&output.stdout));
    let common = "--float --no-compensation --no-antialias --passes 1 --particles 16 --light-pool 0";
    succeeds(folder.path(), &format!("render scene.toml -o a.exr {common} --interleave 1x1"));
    succeeds(folder.path(), &format!("render lights.gltf -o b.exr --max-depth 2 {common}"));
    let (a, b) = (channels(&folder.path().join("a.exr")), channels(&folder.path().join("b.exr")));
    let sum = |c: &[f32]| c.iter().map(|&v| f64::from(v)).sum::<f64>();
    let (a, b) = (sum(&a["G"]), sum(&b["G"]));
    // Positions are moved off their surfaces a second time.
    assert!((b / a - 1.0).abs() < 1e-3, "{a} and {b}");
}

#[test]
fn a_model_without_light_gets_a_sky() {
    let folder = folder();
    fs::write(folder.path().join("dark.obj"), MODEL.replace("usemtl lamp", "usemtl wall")).unwrap();
    let output = succeeds(folder.path(), "render dark.obj -o a.exr --passes 1 --resolution 20x16");
    assert!(text(&output.stderr).contains("dark has no light; an overcast sky lights it"), "{}", text(&output.stderr));
    let image = channels(&folder.path().join("a.exr"));
    assert!(image["G"].iter().any(|&g| g > 0.1));
}

#[test]
fn a_black_image_is_told() {
    let folder = folder();
    let warns = |camera: &str| {
        let output = succeeds(folder.path(), &format!("render scene.toml -o a.png --passes 1 {camera}"));
        text(&output.stderr).contains("the image is black")
    };
    assert!(!warns(""));
    assert!(warns("--eye 0,0.5,-4"), "from behind the wall");
}

#[test]
fn damaged_scenes_are_refused() {
    let folder = folder();
    let write = |name: &str, text: String| fs::write(folder.path().join(name), text).unwrap();
    let run = |scene: &str| format!("render {scene} -o old.exr --passes 1");
    fails(folder.path(), &run("absent.toml"), 1, &["absent.toml"]);
    write("nan.obj", MODEL.replace("v 1 0 1", "v 1 nan 1"));
    fails(folder.path(), &run("nan.obj"), 1, &["nan.obj"]);
    write("infinite.obj", MODEL.replace("v 1 0 1", "v 1 1e999 1"));
    fails(folder.path(), &run("infinite.obj"), 1, &["infinite.obj"]);
    write("index.obj", MODEL.replace("f 1 2 3 4", "f 1 2 3 99"));
    fails(folder.path(), &run("index.obj"), 1, &["index.obj:13", "99"]);
    write("flat.obj", MODEL.replace("f 5 6 7 8", "f 5 6 5"));
    fails(folder.path(), &run("flat.obj"), 1, &["flat.obj"]);
    let night = SCENE.replace("room.obj", "dark.obj") + "[environment]\nradiance = [0.0, 0.0, 0.0]\n";
    write("dark.obj", MODEL.replace("usemtl lamp", "usemtl wall"));
    write("night.toml", night);
    fails(folder.path(), &run("night.toml"), 1, &["night.toml", "emits"]);
    write("empty.obj", String::new());
    fails(folder.path(), &run("empty.obj"), 1, &["empty.obj"]);
    write("key.toml", SCENE.replace("fov_y", "fovy"));
    fails(folder.path(), &run("key.toml"), 1, &["key.toml:", "fovy"]);
    write("value.toml", SCENE.replace("30.0", "\"wide\""));
    fails(folder.path(), &run("value.toml"), 1, &["value.toml:"]);
    write("model.toml", SCENE.replace("room.obj", "hall.obj"));
    fails(folder.path(), &run("model.toml"), 1, &["model.toml:1", "hall.obj"]);
    write("material.toml", format!("{SCENE}[materials.flor]\nroughness = 0.5\n"));
    fails(folder.path(), &run("material.toml"), 1, &["material.toml:", "flor", "floor"]);
    write("setting.toml", format!("{SCENE}[render]\nmax_depth = 99\n"));
    fails(folder.path(), &run("setting.toml"), 1, &["setting.toml:", "max_depth", "99", "1 to 16"]);
    write("broken.gltf", String::from("{ \"asset\": "));
    fails(folder.path(), &run("broken.gltf"), 1, &["broken.gltf"]);
    fails(folder.path(), &run("room.mtl"), 1, &["room.mtl"]);
}

#[test]
fn wrong_use_with_a_scene_that_is_there() {
    let folder = folder();
    let run = |flags: &str| format!("render scene.toml -o old.exr {flags}");
    fails(folder.path(), &run("--tonemap film"), 2, &["--tonemap", "film"]);
    fails(folder.path(), &run("--resolution 100000x100000"), 2, &["--resolution", "100000x100000"]);
    #[cfg(not(feature = "oidn"))]
    fails(folder.path(), &run("--denoise oidn"), 2, &["--denoise", "--features oidn"]);
    fails(folder.path(), &run("--denoise oidn --summands"), 2, &["--denoise", "--summands"]);
    fails(folder.path(), &run("--device nonesuch"), 1, &["nonesuch"]);
    fails(folder.path(), &run("--device 999"), 1, &["999"]);
    fails(folder.path(), &run("--fov 30 --eye 0,0,0 --target 0,1,0"), 2, &["--up"]);
}

#[test]
fn an_image_beyond_the_limits_of_the_device_is_refused_by_the_limits_name() {
    let listed = lightsum::gpu::list_devices().expect("the tests need a Vulkan device");
    println!("{} devices", listed.len());
    let folder = folder();
    // Four floats for each of 2^26 pixels are a gibibyte; a device that can bind that much has no such limit.
    let options = lightsum::gpu::ContextOptions {
        device: std::env::var("LIGHTSUM_DEVICE").map_or_else(|_| Default::default(), |name| name.parse().unwrap()),
        ..Default::default()
    };
    let context = lightsum::gpu::Context::headless(&options).unwrap();
    let limit = context.info().max_storage_buffer_range;
    if limit < 1 << 30 {
        let limit = limit.to_string();
        // A lens blurs over the whole image, so no strip of it can be rendered by itself.
        let line = "render scene.toml -o old.exr --passes 1 --resolution 8192x8192 --aperture 0.1";
        fails(folder.path(), line, 1, &["maxStorageBufferRange", &limit, "resolution"]);
        // Strips are rendered one after the other, each to its end.
        let line = "render scene.toml -o old.exr --resolution 8192x8192 --time 1";
        fails(folder.path(), line, 2, &["--time", "strips", "--passes"]);
    }
}

#[test]
fn places_that_cannot_be_written_are_refused_and_nothing_is_left() {
    let folder = folder();
    let run = |files: &str| format!("render scene.toml --passes 1 --particles 2 {files}");
    for flag in ["-o", "-o old.exr --stats", "-o old.exr --export-lights"] {
        let file = if flag.contains("lights") { "missing/lights.gltf" } else { "missing/a.exr" };
        fails(folder.path(), &run(&format!("{flag} {file}")), 1, &[file]);
        // Not even the administrator may create a file there.
        let file = if flag.contains("lights") { "/proc/lights.gltf" } else { "/proc/a.exr" };
        fails(folder.path(), &run(&format!("{flag} {file}")), 1, &[file]);
    }
    fails(folder.path(), &run("-o scene.toml/a.exr"), 1, &["scene.toml/a.exr"]);
    fs::create_dir(folder.path().join("folder.exr")).unwrap();
    fails(folder.path(), &run("-o folder.exr"), 1, &["folder.exr", "directory"]);
}

#[test]
fn a_full_disk_is_an_error_and_leaves_nothing() {
    let folder = folder();
    std::os::unix::fs::symlink("/dev/full", folder.path().join("full.exr")).unwrap();
    let output = command(folder.path(), "render scene.toml --passes 1 --particles 2 -o full.exr").output().unwrap();
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("error: full.exr: writing failed") && !message.contains("panicked"), "{message}");

    // Files may not grow beyond some 4 KiB: writing fails in the middle.
    fs::write(folder.path().join("old.exr"), "an image from before").unwrap();
    let before = contents(folder.path());
    for (output, file) in [("--resolution 128x96 -o", "old.exr"), ("--export-lights", "lights.gltf")] {
        let inner = command(folder.path(), &format!("render scene.toml --passes 1 --particles 64 {output} {file}"));
        let mut limited = Command::new("sh");
        let line = "ulimit -f 4; exec \"$0\" \"$@\"";
        limited.args(["-c", line]).arg(inner.get_program()).args(inner.get_args()).current_dir(folder.path());
        limited.env_remove("RUST_LOG").env("XDG_CACHE_HOME", cache());
        let output = limited.output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{:?}: {message}", output.status);
        assert!(message.contains(&format!("error: {file}: writing failed")), "{message}");
        assert!(!message.contains("panicked"), "{message}");
        let after = contents(folder.path());
        assert!(after == before, "left: {:?}", after.keys());
    }
}

#[test]
fn time_and_target_error_end_a_rendering() {
    let folder = folder();
    let stats = |flags: &str| -> serde_json::Value {
        succeeds(folder.path(), &format!("render scene.toml --particles 8 --stats a.json {flags}"));
        serde_json::from_slice(&fs::read(folder.path().join("a.json")).unwrap()).unwrap()
    };
    let by_error = stats("--target-error 0.1 --passes 100000");
    assert!(by_error["error_estimate"].as_f64().is_some_and(|e| e > 0.0 && e <= 0.1), "{by_error}");
    let passes = by_error["passes"].as_u64().unwrap_or_default();
    assert!((2..100_000).contains(&passes), "{passes}");
    let by_time = stats("--time 0.5 --passes 1000000");
    let seconds = by_time["stages"]["render"].as_f64().unwrap_or_default();
    // The pass that runs when time is up is finished. The stage contains only the passes, not the estimates between
    // them.
    assert!((0.25..30.0).contains(&seconds) && by_time["passes"].as_u64() < Some(1_000_000), "{by_time}");
}
