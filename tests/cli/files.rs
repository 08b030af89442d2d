//! Files that a scene may name, outputs that would overwrite them, outputs that another process writes, folders that go.

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::Stdio;

use crate::render::{MATERIALS, MODEL, SCENE, command, contents, endless, fails, folder, kill, succeeds, text};

/// A white image of one pixel.
fn write_image(path: &Path) {
    image::RgbImage::from_pixel(1, 1, image::Rgb([255; 3])).save(path).unwrap();
}

/// The scene with a texture on its floor.
fn textured(folder: &Path, texture: &str) {
    let materials = MATERIALS.replace("newmtl floor\n", &format!("newmtl floor\nmap_Kd {texture}\n"));
    fs::write(folder.join("room.mtl"), materials).unwrap();
    fs::write(folder.join("room.obj"), MODEL).unwrap();
}

#[test]
fn files_outside_of_the_scenes_folder_need_a_flag() {
    let folder = folder();
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).unwrap();
    fs::write(inner.join("scene.toml"), SCENE).unwrap();
    write_image(&folder.path().join("a.png"));
    write_image(&inner.join("b.png"));
    for (texture, inside) in [("b.png", true), ("../inner/b.png", true), ("../a.png", false), ("/dev/zero", false)] {
        textured(&inner, texture);
        let output = command(&inner, "info scene.toml").output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(i32::from(!inside)), "{texture}: {message}");
        if texture == "../a.png" {
            let told = ["room.mtl:", "a.png", "outside of the scene's folder", "--allow-outside"];
            assert!(told.iter().all(|told| message.contains(told)), "{message}");
            succeeds(&inner, "info scene.toml --allow-outside");
        }
    }
    // The model of a description may lie elsewhere, with its textures beside it.
    textured(&inner, "b.png");
    fs::write(folder.path().join("scene.toml"), SCENE.replace("room.obj", "inner/room.obj")).unwrap();
    succeeds(folder.path(), "info scene.toml");
    fs::create_dir(folder.path().join("scenes")).unwrap();
    fs::write(folder.path().join("scenes/scene.toml"), SCENE.replace("room.obj", "../inner/room.obj")).unwrap();
    succeeds(folder.path(), "info scenes/scene.toml");
}

#[test]
fn memory_for_inputs_is_bounded() {
    let folder = folder();
    succeeds(folder.path(), "info scene.toml --max-input-memory 1M");
    let image = image::RgbImage::from_fn(512, 512, |x, y| image::Rgb([x as u8, y as u8, 0]));
    image.save(folder.path().join("a.png")).unwrap();
    textured(folder.path(), "a.png");
    // The file is small, and what it is decoded to is not.
    fails(folder.path(), "info scene.toml --max-input-memory 1M", 1, &["a.png", "1048576 bytes", "--max-input-memory"]);
    succeeds(folder.path(), "info scene.toml --max-input-memory 2M");
    for wrong in ["0", "M", "1X", "-1", "99999999999T", "1.5G"] {
        fails(
            folder.path(),
            &format!("info scene.toml --max-input-memory={wrong}"),
            2,
            &["--max-input-memory", "512M"],
        );
    }
}

#[test]
fn outputs_do_not_overwrite_the_scene() {
    let folder = folder();
    write_image(&folder.path().join("1.png"));
    textured(folder.path(), "1.png");
    let path = "frames = 3\n[[camera]]\ntime = 0.0\neye = [0.0, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n\
                [[camera]]\ntime = 1.0\neye = [0.5, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n";
    fs::write(folder.path().join("path.toml"), path).unwrap();
    fs::create_dir(folder.path().join("sub")).unwrap();
    for (line, file) in [
        ("render scene.toml --passes 1 -o old.exr --stats scene.toml", "scene.toml"),
        ("render scene.toml --passes 1 -o old.exr --stats sub/../room.mtl", "room.mtl"),
        ("render scene.toml --passes 1 -o 1.png", "1.png"),
        ("animate scene.toml --path path.toml -o %d.png", "1.png"),
        ("animate scene.toml --path path.toml --timings path.toml", "path.toml"),
    ] {
        fails(folder.path(), line, 1, &[file, "is read from", "another name"]);
    }
    succeeds(folder.path(), "render scene.toml --particles 4 --export-lights lights.gltf");
    let line = "render lights.gltf --passes 1 --export-lights lights.gltf";
    fails(folder.path(), line, 1, &["lights", "is read from"]);
    let line = "render scene.toml --passes 1 -o old.exr --stats old.exr";
    fails(folder.path(), line, 1, &["old.exr", "two outputs"]);
}

#[test]
fn names_may_be_as_long_as_the_system_takes_them() {
    let folder = folder();
    let longest = format!("{}.exr", "a".repeat(251));
    succeeds(folder.path(), &format!("render scene.toml --passes 1 --particles 2 -o {longest} --resume"));
    succeeds(folder.path(), &format!("render scene.toml --passes 2 --particles 2 -o {longest} --resume"));
    succeeds(folder.path(), "render scene.toml --passes 2 --particles 2 -o short.exr");
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(bytes(&longest) == bytes("short.exr"));
    fails(folder.path(), &format!("render scene.toml --passes 1 -o a{longest}"), 1, &["too long"]);
}

#[cfg(target_os = "linux")]
#[test]
fn standard_output_takes_files() {
    let folder = folder();
    let told = succeeds(folder.path(), "render scene.toml --passes 1 --particles 2 -o a.exr --stats /dev/stdout");
    // The line that names the files goes to standard error.
    let statistics: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
    assert_eq!(statistics["passes"], 1);
    assert!(String::from_utf8_lossy(&told.stderr).contains("a.exr"));
    // PNG, as a pipe has no name, or the format of the file to which it goes.
    let line = "render scene.toml --passes 1 --particles 2 -o /dev/stdout";
    let streamed = succeeds(folder.path(), line).stdout;
    succeeds(folder.path(), "render scene.toml --passes 1 --particles 2 -o a.png");
    assert!(streamed == fs::read(folder.path().join("a.png")).unwrap());
    let file = fs::File::create(folder.path().join("b.exr")).unwrap();
    assert!(command(folder.path(), line).stdout(file).status().unwrap().success());
    assert!(fs::read(folder.path().join("a.exr")).unwrap() == fs::read(folder.path().join("b.exr")).unwrap());
}

#[test]
fn a_second_process_on_one_output_is_told() {
    let folder = folder();
    let (mut first, mut stderr) = endless(folder.path(), "");
    for line in
        ["render scene.toml -o b.exr -o a.exr --passes 1", "render scene.toml -o b.exr --stats a.exr --passes 1"]
    {
        fails(folder.path(), line, 1, &["a.exr", "another lightsum writes this file"]);
    }
    succeeds(folder.path(), "render scene.toml -o b.exr --passes 1 --particles 2");
    kill(&first.0, "KILL");
    stderr.read_to_string(&mut String::new()).unwrap();
    assert!(!first.0.wait().unwrap().success());
    // A killed process leaves no output locked.
    succeeds(folder.path(), "render scene.toml -o a.exr --passes 1 --particles 2");
}

#[test]
fn a_folder_that_is_removed_does_not_lose_the_passes() {
    let folder = folder();
    let [out, instead] = ["out", "instead"].map(|name| folder.path().join(name));
    fs::create_dir(&out).unwrap();
    fs::create_dir(&instead).unwrap();
    let line = "render scene.toml -o out/b.exr --particles 8 --passes 1000000";
    let mut command = command(folder.path(), line);
    let mut run = command.env("TMPDIR", &instead).stderr(Stdio::piped()).spawn().unwrap();
    let mut stderr = run.stderr.take().unwrap();
    let mut first = [0];
    stderr.read_exact(&mut first).unwrap();
    fs::remove_dir_all(&out).unwrap();
    kill(&run, "INT");
    let mut message = String::new();
    stderr.read_to_string(&mut message).unwrap();
    assert_eq!(run.wait().unwrap().code(), Some(1), "{message}");
    let state = instead.join("b.exr.state");
    assert!(message.contains(&format!("is in {}", state.display())), "{message}");
    let passes = lightsum::output::State::read(&state).unwrap().passes;
    fs::create_dir(&out).unwrap();
    fs::rename(&state, out.join("b.exr.state")).unwrap();
    let line = |output: &str| format!("render scene.toml -o {output} --particles 8 --passes {}", passes + 1);
    succeeds(folder.path(), &format!("{} --resume", line("out/b.exr")));
    succeeds(folder.path(), &line("c.exr"));
    assert!(fs::read(out.join("b.exr")).unwrap() == fs::read(folder.path().join("c.exr")).unwrap());
    assert!(!contents(&instead).keys().any(|name| name.contains(".lock")), "locks are removed");
}

#[test]
fn light_beyond_numbers_is_an_error() {
    let folder = folder();
    fs::write(folder.path().join("room.mtl"), MATERIALS.replace("10 10 10", "1e31 1e31 1e31")).unwrap();
    let line = "render scene.toml -o old.exr --passes 3 --particles 2";
    let message = fails(folder.path(), line, 1, &["8 passes in a row", "no number", "emission"]);
    assert!(message.contains("pass 0 is left out"), "{message}");
    let message =
        fails(folder.path(), "render scene.toml -o old.exr --reference --spp 2", 1, &["all 2 paths", "no number"]);
    assert!(message.contains("emission"), "{message}");
}

#[test]
fn a_rendering_that_does_not_fit_the_device_is_refused() {
    let folder = folder();
    let line = "render scene.toml -o new.exr --passes 1 --particles 4 --resolution 64x64";
    let refused = format!("{line} --max-device-memory 1M");
    fails(folder.path(), &refused, 1, &["1048576 are free or allowed", "lower --light-pool"]);
    let refused = format!("{refused} --light-pool 0");
    let message = fails(folder.path(), &refused, 1, &["1048576 are free or allowed", "lower --resolution"]);
    assert!(!folder.path().join("new.exr").exists(), "{message}");
    fails(folder.path(), &format!("{line} --max-device-memory 64K"), 1, &["bytes of the device's memory are needed"]);
    fails(folder.path(), "bake scene.toml -o a.glb --density 4 --max-device-memory 64K", 1, &["--max-device-memory"]);
    fails(folder.path(), &format!("{line} --max-device-memory=-1"), 2, &["--max-device-memory", "512M"]);
    succeeds(folder.path(), &format!("{line} --max-device-memory 1G --stats s.json"));
    let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("s.json")).unwrap()).unwrap();
    assert!(stats["device_bytes"].as_u64().unwrap() > 1 << 20, "{stats}");
}
