//! Renderings that go on with another driver.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::render::{channels, command, folder, succeeds, text};

/// Red, green and blue of all pixels of an image.
fn colors(path: &Path) -> Vec<f32> {
    channels(path)
        .into_iter()
        .filter(|(name, _)| matches!(name.as_str(), "R" | "G" | "B"))
        .flat_map(|(_, v)| v)
        .collect()
}

/// Renders two passes with lavapipe and two with another driver: `other` makes the command with it.
fn goes_on(other: impl Fn(&Path, &str) -> Command) {
    let folder = folder();
    let line =
        |output: &str, passes: u32| format!("render scene.toml -o {output} --particles 8 --passes {passes} --resume");
    succeeds(folder.path(), &line("whole.exr", 4));
    succeeds(folder.path(), &line("parts.exr", 2));
    let state = folder.path().join("parts.exr.state");
    let before = fs::read(&state).unwrap();
    let output = other(folder.path(), &line("parts.exr", 4)).output().unwrap();
    let message = text(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert!(message.contains("the passes so far are of") && message.contains("the others will be of"), "{message}");
    assert!(fs::read(&state).unwrap() != before, "passes were added: {message}");
    let [whole, parts] = ["whole.exr", "parts.exr"].map(|name| colors(&folder.path().join(name)));
    let sum = |values: &[f32]| values.iter().map(|v| f64::from(v * v)).sum::<f64>();
    let differences: Vec<f32> = whole.iter().zip(&parts).map(|(a, b)| a - b).collect();
    let error = (sum(&differences) / sum(&whole)).sqrt();
    println!("relative difference {error:.1e}");
    assert!(whole.len() == parts.len() && sum(&whole) > 0.0 && error < 1e-3, "{error}");
    // Back on the first driver the others are told in turn.
    let back = text(&succeeds(folder.path(), &line("parts.exr", 5)).stderr);
    assert!(back.contains("the passes so far are of"), "{back}");
}

/// Narrower vectors make another device of lavapipe: its subgroups have four invocations.
#[test]
fn a_rendering_goes_on_with_other_subgroups() {
    goes_on(|folder, line| {
        let mut command = command(folder, line);
        command.env("LP_NATIVE_VECTOR_WIDTH", "128");
        command
    });
}

/// `make test` runs it: the driver may have to be fetched.
#[test]
#[ignore = "run by make test, which fetches the other driver"]
fn a_rendering_goes_on_with_swiftshader() {
    goes_on(|folder, line| {
        let mut command = Command::new(concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/swiftshader.sh"));
        command.arg(env!("CARGO_BIN_EXE_lightsum")).args(line.split_whitespace()).current_dir(folder);
        command.env("XDG_CACHE_HOME", crate::render::cache()).env_remove("RUST_LOG");
        // The script keeps the driver in the target folder, beside which it lies.
        command.env_remove("CARGO_TARGET_DIR");
        command
    });
}
