//! The command line as a user meets it, where it needs no Vulkan device.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn lightsum(arguments: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    command.args(arguments).current_dir(folder).env_remove("RUST_LOG").output().expect("the program starts")
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs it, checks the exit code and returns standard error; standard output must be empty.
fn fails(arguments: &[&str], code: i32) -> String {
    let folder = folder();
    let output = lightsum(arguments, folder.path());
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    assert!(message.starts_with("error: ") && !message.contains("panicked"), "{arguments:?}: {message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{arguments:?} left a file");
    message
}

/// A floor under a lamp that shines down on it.
const MODEL: &str = "mtllib box.mtl
v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1
v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5
usemtl floor\nf 1 2 3 4
usemtl lamp\nf 5 6 7 8
";
const MATERIALS: &str = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 10 10 10\n";

#[test]
fn help_explains_every_flag() {
    let folder = folder();
    let general = lightsum(&["--help"], folder.path());
    assert!(general.status.success());
    assert!(text(&general.stdout).contains("render"));
    for (command, least) in [("render", 60), ("animate", 43), ("bake", 40)] {
        let output = lightsum(&[command, "--help"], folder.path());
        assert!(output.status.success());
        let help = text(&output.stdout);
        // A flag's entry is its head, alone on a line, and its help on the lines below that are indented further.
        let heads: Vec<usize> = (help.lines().enumerate())
            .filter(|(_, line)| line.starts_with("  -") || line.starts_with("      --"))
            .map(|(i, _)| i)
            .collect();
        assert!(heads.len() >= least, "{command}: {} flags, there were {least}", heads.len());
        let lines: Vec<&str> = help.lines().collect();
        for head in heads {
            let words =
                lines.get(head + 1).filter(|line| line.starts_with("          ")).map_or("", |line| line.trim());
            assert!(words.len() > 10, "{command}: {} has no help, but {words:?}", lines[head].trim());
        }
    }
    let version = lightsum(&["--version"], folder.path());
    assert_eq!(text(&version.stdout), concat!("lightsum ", env!("CARGO_PKG_VERSION"), "\n"));
}

#[test]
fn nothing_to_do_is_wrong_use() {
    let output = lightsum(&[], folder().path());
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("Usage"));
}

#[test]
fn wrong_use_exits_with_2_and_names_the_flag() {
    assert!(fails(&["render", "a.toml", "-o", "a.exr", "--pases", "3"], 2).contains("--pases"));
    assert!(fails(&["paint"], 2).contains("paint"));
    assert!(fails(&["render", "a.toml"], 2).contains("--output"));
    assert!(fails(&["render", "-o", "a.exr"], 2).contains("SCENE"));
    let value = |flag: &str, value: &str| {
        let message = fails(&["render", "a.toml", "-o", "a.exr", flag, value], 2);
        assert!(message.contains(flag) && message.contains(value), "{message}");
    };
    value("--output", "a.jpg");
    value("--resolution", "0x10");
    value("--resolution", "100000x100000");
    value("--resolution", "12");
    value("--passes", "0");
    value("--passes", "many");
    value("--particles", "0");
    value("--particles", "70000");
    value("--max-depth", "17");
    value("--clip", "-1");
    value("--clip-fraction", "nan");
    value("--time", "0");
    value("--target-error", "inf");
    value("--lights-per-dispatch", "65");
    value("--rounds", "0");
    value("--seed", "-1");
    value("--tonemap", "film");
    value("--preset", "best");
    value("--eye", "1,2");
    value("--fov", "180");
    value("--exposure", "bright");
}

#[test]
fn files_that_are_not_there_exit_with_1_and_are_named() {
    assert!(fails(&["render", "absent.toml", "-o", "a.exr"], 1).contains("absent.toml"));
    assert!(fails(&["render", "absent.glb", "-o", "a.exr"], 1).contains("absent.glb"));
    // The outputs are checked before the scene is read, and long before it is rendered.
    for flag in ["--output", "--stats", "--export-lights"] {
        let message = fails(&["render", "absent.toml", "-o", "a.exr", flag, "nowhere/a.exr"], 1);
        assert!(message.contains("nowhere/a.exr"), "{message}");
    }
    assert!(fails(&["render", "absent.toml", "-o", "a.exr", "--stats", "."], 1).contains("is a directory"));
}

#[test]
fn a_name_that_is_not_utf8_is_a_name() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    let name = OsStr::from_bytes(b"caf\xe9.obj");
    let output = command.args(["render", "-o", "a.exr"]).arg(name).current_dir(folder().path()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("caf"));
}

#[test]
fn devices_are_listed_or_their_absence_is_an_error() {
    for arguments in [&["--list-devices"][..], &["render", "--list-devices"]] {
        let output = lightsum(arguments, folder().path());
        match output.status.code() {
            Some(0) => {
                let lines = text(&output.stdout);
                assert!(lines.lines().enumerate().all(|(i, line)| line.starts_with(&format!("{i}  "))), "{lines}");
                assert!(lines.contains("Vulkan 1."), "{lines}");
            }
            code => {
                assert_eq!(code, Some(1));
                assert!(text(&output.stderr).starts_with("error: "));
            }
        }
    }
}

#[test]
fn a_closed_pipe_is_no_crash() {
    let mut command = Command::new("sh");
    let line = format!("'{}' --list-devices | true", env!("CARGO_BIN_EXE_lightsum"));
    let output = command.args(["-c", &line]).output().expect("sh starts");
    assert!(!text(&output.stderr).contains("panicked"));
}

#[test]
fn a_bare_model_is_path_traced_into_every_output() {
    let folder = folder();
    fs::write(folder.path().join("box.obj"), MODEL).unwrap();
    fs::write(folder.path().join("box.mtl"), MATERIALS).unwrap();
    let run = |resolution: &str| {
        let arguments = [
            "render",
            "box.obj",
            "--reference",
            "--spp",
            "2",
            "--resolution",
            resolution,
            "--float",
            "-o",
            "a.exr",
            "-o",
            "a.png",
        ];
        lightsum(&arguments, folder.path())
    };
    let output = run("33x17");
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("no camera"), "{}", text(&output.stderr));
    let last = text(&output.stdout).lines().last().unwrap_or_default().to_owned();
    assert!(last.contains("a.exr, a.png"), "{last}");
    let image = exr::prelude::read_first_flat_layer_from_file(folder.path().join("a.exr")).unwrap();
    assert_eq!((image.layer_data.size.0, image.layer_data.size.1), (33, 17));
    let channels = image.layer_data.channel_data.list;
    assert!(channels.iter().all(|c| c.sample_data.values_as_f32().all(f32::is_finite)));
    assert!(channels.iter().any(|c| c.sample_data.values_as_f32().any(|v| v > 0.0)));
    let dimensions = image::image_dimensions(folder.path().join("a.png")).unwrap();
    assert_eq!(dimensions, (33, 17));

    let names = |extension: &str| {
        let entries = fs::read_dir(folder.path()).unwrap();
        entries.filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|x| x == extension)).count()
    };
    assert_eq!((names("tmp"), names("state")), (0, 0));
    // The same command writes the same bytes.
    let first = fs::read(folder.path().join("a.exr")).unwrap();
    assert!(run("33x17").status.success());
    assert!(fs::read(folder.path().join("a.exr")).unwrap() == first);
}

#[test]
fn a_camera_that_sees_nothing_is_refused() {
    let folder = folder();
    fs::write(folder.path().join("box.obj"), MODEL).unwrap();
    fs::write(folder.path().join("box.mtl"), MATERIALS).unwrap();
    let arguments = ["render", "box.obj", "--reference", "-o", "a.exr", "--eye", "1,2,3", "--target", "1,2,3"];
    let output = lightsum(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("--eye"));
    assert!(!folder.path().join("a.exr").exists());
}

#[test]
fn info_tells_what_a_scene_holds() {
    let folder = folder();
    let model = "mtllib a.mtl\no lamp\nusemtl lamp\nv 0 0 0\nv 2 0 0\nv 0 0 -1\nf 1 2 3\n";
    std::fs::write(folder.path().join("a.obj"), model).unwrap();
    std::fs::write(folder.path().join("a.mtl"), "newmtl lamp\nKe 3 3 3\nmap_Bump bumps.png\n").unwrap();
    let output = lightsum(&["info", "a.obj"], folder.path());
    let told = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    // A triangle of area 1 with radiance 3: 3 pi.
    for part in [
        "a: 1 triangles",
        "size: 2.0000 x 0.0000 x 1.0000",
        "camera: none",
        "material \"lamp\": 1, 9.425 W",
        "left out: map_Bump",
    ] {
        assert!(told.contains(part), "{told:?} lacks {part:?}");
    }
    let output = lightsum(&["info", "a.obj", "--json"], folder.path());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["triangles"].as_u64(), json["high"][0].as_f64()), (Some(1), Some(2.0)));
    assert_eq!(json["lights"][0]["count"].as_u64(), Some(1));
    let output = lightsum(&["info", "b.obj"], folder.path());
    assert!(output.status.code() == Some(1) && text(&output.stderr).contains("b.obj"));
}
