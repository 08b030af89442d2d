//! Kernels compiled from their files when an engine is made. A program of its own, so that the other tests need not be compiled
//! again with this feature.

use std::path::Path;
use std::process::Command;

use lightsum::gpu::{Buffer, Context, ContextOptions, Memory};
use lightsum::scene::builtin;
use lightsum::{Engine, Settings};

/// Options of the tests' device: the one named by LIGHTSUM_DEVICE, else any.
fn options() -> ContextOptions {
    let device = std::env::var("LIGHTSUM_DEVICE").map_or_else(|_| Default::default(), |name| name.parse().unwrap());
    ContextOptions { device, validation: true, ..ContextOptions::default() }
}

/// Prints the radiance at the centre of a furnace, or the error. The tests below run it in a process of its own, since
/// all threads of a process share its environment.
#[test]
#[ignore = "run by the other tests here with a folder of shaders in LIGHTSUM_SHADERS"]
fn render_once() {
    let render = || {
        let context = Context::headless(&options())?;
        let scene = builtin::furnace(0.5, 1.0);
        let camera = lightsum::Camera { resolution: [1, 1], ..scene.camera.unwrap() };
        let mut engine = Engine::new(&context, &scene, camera, Settings { max_depth: 1, ..Settings::plain() })?;
        let readback = Buffer::new(&context, "image", engine.image().bytes(), Memory::Readback)?;
        context.submit_and_wait("furnace", None, |rec| {
            engine.record_setup(rec)?;
            engine.record_pass(rec)?;
            engine.record_image(rec)?;
            rec.copy_image_to_buffer(engine.image(), &readback)
        })?;
        let texel = readback.read::<f32>()?;
        assert_eq!(context.take_messages(), Vec::<String>::new());
        Ok::<_, lightsum::Error>(texel)
    };
    match render() {
        Ok(texel) => println!("radiance {}", texel[0]),
        Err(error) => println!("error {error}"),
    }
}

/// Output of the test above for a copy of the shaders with one text of one file replaced.
fn with_change(file: &str, from: &str, to: &str) -> String {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let dir = tempfile::tempdir().unwrap();
    for folder in [".", "include"] {
        std::fs::create_dir_all(dir.path().join(folder)).unwrap();
        for entry in std::fs::read_dir(source.join(folder)).unwrap() {
            let entry = entry.unwrap();
            if entry.file_type().unwrap().is_file() {
                std::fs::copy(entry.path(), dir.path().join(folder).join(entry.file_name())).unwrap();
            }
        }
    }
    let path = dir.path().join(file);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{file} has no {from:?}");
    std::fs::write(&path, text.replace(from, to)).unwrap();
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "--nocapture", "render_once"])
        .env("LIGHTSUM_SHADERS", dir.path())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    text
}

#[test]
fn a_changed_shader_is_picked_up() {
    // Emission alone reaches the eye: radiance 1.
    let plain = with_change("resolve.wgsl", "(sum - ", "(sum - ");
    assert!(plain.contains("radiance 1\n"), "{plain}");
    let doubled = with_change("resolve.wgsl", "(sum - ", "2.0 * (sum - ");
    assert!(doubled.contains("radiance 2\n"), "{doubled}");
    // Also through an include.
    let dark = with_change(
        "include/surface.wgsl",
        "vec3<f32>(0.0), emission * cosine_falloff",
        "vec3<f32>(0.0), vec3<f32>(0.25) * cosine_falloff",
    );
    assert!(dark.contains("radiance 0.25\n"), "{dark}");
}

#[test]
fn a_broken_shader_names_file_and_line() {
    let broken = with_change("include/surface.wgsl", "let face = cross(e1, e2);", "let face = cross_of(e1, e2);");
    let text =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders/include/surface.wgsl")).unwrap();
    let line = 1 + text.lines().position(|line| line.contains("let face = cross(e1, e2);")).unwrap();
    assert!(broken.contains("error shader "), "{broken}");
    assert!(broken.contains(&format!("include/surface.wgsl:{line}:")) && broken.contains("cross_of"), "{broken}");
}

#[test]
fn a_changed_interface_asks_for_a_build() {
    let changed =
        with_change("include/frame_parameters.wgsl", "    keys: vec4<u32>,", "    keys: vec4<u32>, more: vec4<u32>,");
    assert!(changed.contains("error shader ") && changed.contains("build the program again"), "{changed}");
}
