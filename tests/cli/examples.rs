//! The programs in `examples/`, run as their first lines say; `gpu` runs `embed`, `lights_for_rasterizer` and `g_buffer` under the validation layer too.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::render::{cache, channels, folder, text};

/// A file of the example `name`. `cargo test` builds examples, unless one binary of tests alone is asked for.
pub fn built(name: &str, file: &str, source: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let built = test.ancestors().nth(2).unwrap().join("examples").join(file);
    // It lies in target/PROFILE/examples.
    let target = built.ancestors().nth(2).unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join(source);
    let changed = |path: &Path| fs::metadata(path).and_then(|data| data.modified()).ok();
    if changed(&built) < changed(&source) {
        let mut build = Command::new(env!("CARGO"));
        build.args(["build", "--quiet", "--example", name, "--manifest-path"]);
        build.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"));
        if target.ends_with("release") {
            build.arg("--release");
        }
        assert!(build.arg("--target-dir").arg(target.parent().unwrap()).status().unwrap().success());
    }
    built
}

/// A program in `examples/`, in a folder.
pub fn example(name: &str, folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(built(name, name, &format!("examples/{name}.rs")));
    command.args(arguments).current_dir(folder).env_remove("RUST_LOG").env("XDG_CACHE_HOME", cache());
    command
}

/// Runs an example and returns its standard output.
fn runs(name: &str, folder: &Path, arguments: &[&str]) -> String {
    let output = example(name, folder, arguments).output().unwrap();
    assert!(output.status.success(), "{name}: {}", text(&output.stderr));
    text(&output.stdout)
}

#[test]
fn examples_write_pictures() {
    let folder = folder();
    for (name, arguments) in [
        ("render", &["scene.toml", "a.exr", "1"][..]),
        ("build_scene", &["built.png", "1"]),
        ("kernels", &["kernels.png", "0.3"]),
        ("g_buffer", &["g_buffer.png", "1"]),
    ] {
        runs(name, folder.path(), arguments);
        let picture =
            arguments.iter().find(|argument| argument.ends_with(".exr") || argument.ends_with(".png")).unwrap();
        assert!(fs::metadata(folder.path().join(picture)).unwrap().len() > 100, "{name}");
    }
}

#[test]
fn the_example_of_a_scene_that_moves_turns_a_block() {
    let folder = folder();
    let told = runs("moving", folder.path(), &["frames", "2"]);
    assert_eq!(told.lines().count(), 7, "{told}");
    assert!(told.lines().last().unwrap().starts_with("frame 6: 2 passes"), "{told}");
    let frame =
        |n: u32| image::open(folder.path().join(format!("frames/moving-{n:02}.png"))).unwrap().into_rgb8().into_raw();
    let differ = |a: u32, b: u32| frame(a).iter().zip(&frame(b)).filter(|(a, b)| a.abs_diff(**b) > 32).count();
    assert!(differ(0, 3) > 1000, "{} values differ: the block stands still", differ(0, 3));
}

#[test]
fn the_example_of_passes_tells_times_and_layers() {
    let folder = folder();
    let told = runs("passes", folder.path(), &["scene.toml", "layers.exr"]);
    // Lines of layers: a name and three numbers.
    let means: BTreeMap<&str, Vec<f64>> = (told.lines())
        .filter_map(|line| line.split_once(' '))
        .map(|(name, rest)| (name, rest.split_whitespace().filter_map(|word| word.parse().ok()).collect()))
        .filter(|(_, numbers): &(_, Vec<f64>)| numbers.len() == 3)
        .collect();
    let summands = means["emission"].iter().zip(&means["diffuse"]).zip(&means["specular"]).map(|((e, d), s)| e + d + s);
    for (color, sum) in means["color"].iter().zip(summands) {
        // They are printed with four digits.
        assert!(sum > 0.01 && (color - sum).abs() < 3e-4, "{told}");
    }
    assert!(told.contains("eye") && told.contains("shade"), "times of passes: {told}");
    let layers = channels(&folder.path().join("layers.exr"));
    assert!(layers.contains_key("diffuse.R") && layers["R"].len() == 320 * 240, "{:?}", layers.keys());
}

#[test]
fn the_example_of_other_sizes_ends_with_equal_films() {
    let folder = folder();
    let told = runs("resize", folder.path(), &["scene.toml"]);
    assert!(told.ends_with("two films of two passes equal one of four\n"), "{told}");
}

#[test]
fn the_example_of_radiosity_prints_table_and_figure() {
    let folder = folder();
    let told = runs("radiosity", folder.path(), &["table", "1000", "2"]);
    for line in ["subdivided | ", "textures, bilinear | ", "textures, bicubic | "] {
        assert!(told.lines().any(|told| told.starts_with(line)), "{told}");
    }
    let told = runs("radiosity", folder.path(), &["figure", "figure.png", "4"]);
    for line in ["reference | 0.0000 | ", "8 x 8, 4 x 4, bilinear | ", "257 x 257, 2 x 2, Mitchell | "] {
        assert!(told.lines().any(|told| told.starts_with(line)), "{told}");
    }
    assert_eq!(image::image_dimensions(folder.path().join("figure.png")).unwrap(), (7 * 132 - 4, 4 * 132 - 4));
    let wrong = example("radiosity", folder.path(), &["figures"]).output().unwrap();
    assert!(!wrong.status.success() && text(&wrong.stderr).contains("expected: table"), "{}", text(&wrong.stderr));
}
