//! The short help, and commands that need no scene.

use std::fs;
use std::process::Command;

use crate::render::{channels, command, fails, folder, succeeds, text};

#[test]
fn the_short_help_fits_a_screen() {
    let commands = ["render", "animate", "bake", if cfg!(feature = "viewer") { "view" } else { "render" }];
    // The list of commands too, each in a line.
    let output = Command::new(env!("CARGO_BIN_EXE_lightsum")).arg("-h").env("COLUMNS", "80").output().unwrap();
    let help = text(&output.stdout);
    assert!(help.lines().count() <= 24 && help.lines().all(|line| line.chars().count() <= 80), "{help}");
    for name in commands {
        let output =
            Command::new(env!("CARGO_BIN_EXE_lightsum")).args([name, "-h"]).env("COLUMNS", "80").output().unwrap();
        let help = text(&output.stdout);
        let lines: Vec<&str> = help.lines().collect();
        println!("{help}");
        let widest = lines.iter().map(|line| line.chars().count()).max().unwrap_or_default();
        assert!(lines.len() <= 25 && widest <= 80, "{name}: {} lines, {widest} columns", lines.len());
        let flags = lines.iter().filter(|line| line.starts_with("  -") || line.starts_with("      --")).count();
        assert!(flags >= 14, "{name}: {flags} flags");
        // The long help has all of them.
        let long = Command::new(env!("CARGO_BIN_EXE_lightsum")).args([name, "--help"]).output().unwrap();
        assert!(text(&long.stdout).contains("--lights-per-dispatch") && !help.contains("--lights-per-dispatch"));
    }
}

#[test]
fn devices_are_listed_in_words_and_as_json() {
    let folder = folder();
    let words = text(&succeeds(folder.path(), "devices").stdout);
    assert_eq!(words, text(&succeeds(folder.path(), "--list-devices").stdout));
    let json: serde_json::Value = serde_json::from_slice(&succeeds(folder.path(), "devices --json").stdout).unwrap();
    let devices = json.as_array().expect("a list");
    assert_eq!(devices.len(), words.lines().count());
    for (device, line) in devices.iter().zip(words.lines()) {
        assert!(line.contains(device["name"].as_str().unwrap()) && device["subgroup_size"].is_u64(), "{device}");
    }
}

#[test]
fn images_are_compared() {
    let folder = folder();
    let run = |line: &str| succeeds(folder.path(), line);
    run("render scene.toml --passes 1 --particles 8 --float -o a.exr -o a.png");
    run("render scene.toml --passes 1 --particles 8 --float --seed 3 -o b.exr");
    let same = text(&run("compare a.exr a.exr --fail-above 0").stdout);
    assert_eq!(same, "relative RMSE 0.000000, energy 1.000000, FLIP 0.000000\n");
    let json = run("compare b.exr a.exr --json --output flip.png").stdout;
    let found: serde_json::Value = serde_json::from_slice(&json).unwrap();
    // The definition, computed once more.
    let [a, b] = ["a.exr", "b.exr"].map(|name| {
        let image = channels(&folder.path().join(name));
        ["R", "G", "B"].map(|c| image[c].clone()).concat()
    });
    let mean = a.iter().map(|v| f64::from(*v)).sum::<f64>() / a.len() as f64;
    let square =
        |(a, b): (&f32, &f32)| (f64::from(*b) - f64::from(*a)).powi(2) / (f64::from(*a).powi(2) + 0.01 * mean * mean);
    let rmse = (a.iter().zip(&b).map(square).sum::<f64>() / a.len() as f64).sqrt();
    let is = found["relative_rmse"].as_f64().unwrap();
    assert!(rmse > 0.0 && (is - rmse).abs() < 1e-6 * rmse, "{is} and {rmse}");
    assert!(found["flip"].as_f64().is_some_and(|flip| flip > 0.0 && flip < 1.0), "{found}");
    assert!(fs::metadata(folder.path().join("flip.png")).is_ok());
    for limit in ["--fail-above 0.000001", "--measure flip --fail-above 0.000001", "--measure energy --fail-above 0"] {
        let output = command(folder.path(), &format!("compare b.exr a.exr {limit}")).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{limit}");
        assert!(text(&output.stdout).starts_with("relative RMSE"), "{limit}");
    }
    run("compare b.exr a.exr --fail-above 100");
    // PNG rounds and clips little.
    let energy = |line: &str| {
        let json: serde_json::Value = serde_json::from_slice(&run(line).stdout).unwrap();
        json["energy"].as_f64().unwrap()
    };
    assert!(energy("compare a.png a.exr --json") <= 1.01);
    run("render scene.toml --passes 1 --particles 2 --resolution 8x8 -o small.png");
    fails(folder.path(), "compare small.png a.exr", 1, &["small.png", "8x8", "20x16"]);
    fails(folder.path(), "compare room.obj a.exr", 1, &["room.obj", "PNG"]);
    fails(folder.path(), "compare none.exr a.exr", 1, &["none.exr"]);
}

#[test]
fn quiet_tells_errors_alone_and_a_log_file_tells_more() {
    let folder = folder();
    let run = |flags: &str| {
        succeeds(folder.path(), &format!("render scene.toml --passes 1 --particles 2 -o a.png --splat-width 9 {flags}"))
    };
    let told = text(&run("").stderr);
    assert!(told.contains("warning: --splat-width has no effect: --glossy is not splats"), "{told}");
    let quiet = run("-q --log-file log.txt");
    assert!(quiet.stderr.is_empty(), "{}", text(&quiet.stderr));
    let log = fs::read_to_string(folder.path().join("log.txt")).unwrap();
    for line in ["warning: --splat-width has no effect", "info: ", "1 pass, rendered in"] {
        assert!(log.contains(line), "{line}: {log}");
    }
    // A log takes the place of a log, and of nothing else; nor is it another output.
    run("-q --log-file log.txt");
    let scene = fs::read(folder.path().join("scene.toml")).unwrap();
    fails(folder.path(), "info scene.toml --log-file scene.toml", 1, &["scene.toml", "no log"]);
    assert_eq!(fs::read(folder.path().join("scene.toml")).unwrap(), scene);
    let output = command(folder.path(), "render scene.toml --passes 1 -o b.exr --log-file b.exr").output().unwrap();
    let message = text(&output.stderr);
    assert!(output.status.code() == Some(1) && message.contains("b.exr: is the name of two outputs"), "{message}");
    fails(folder.path(), "render none.toml -o old.exr -q", 1, &["none.toml"]);
    fails(folder.path(), "render scene.toml -o old.exr --log-file missing/log.txt", 1, &["missing/log.txt"]);
}
