//! Renderings in parts, films and their merging.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use lightsum::output::FilmFile;

use crate::render::{SCENE, command, contents, fails, folder, kill, succeeds, text};

const COMMON: &str = "--particles 8 --passes 7";

/// Renders the parts of a rendering to films `N-1.film`, `N-2.film` and so on.
fn parts(folder: &Path, count: u32, more: &str) {
    for part in 1..=count {
        succeeds(folder, &format!("render scene.toml -o {count}-{part}.film --shard {part}/{count} {COMMON} {more}"));
    }
}

#[test]
fn films_of_parts_merge_to_the_image_of_all() {
    let folder = folder();
    let folder = folder.path();
    let file = |name: &str| fs::read(folder.join(name)).unwrap();
    let same = |a: &str, b: &str| assert!(file(a) == file(b), "{a} and {b} differ");
    succeeds(folder, &format!("render scene.toml -o whole.exr -o whole.png {COMMON} --exposure -0.5"));
    parts(folder, 3, "--exposure -0.5");
    // The films know exposure and provenance.
    let said = succeeds(folder, "merge 3-2.film 3-3.film 3-1.film -o a.exr -o a.png -o all.film");
    assert!(said.stderr.is_empty(), "{}", text(&said.stderr));
    assert!(
        text(&said.stdout).ends_with("scene: 7 passes of 3 films -> a.exr, a.png, all.film\n"),
        "{}",
        text(&said.stdout)
    );
    same("whole.exr", "a.exr");
    same("whole.png", "a.png");
    succeeds(folder, "merge all.film -o b.exr");
    same("whole.exr", "b.exr");
    // Sums of sums, and a film of all passes by itself.
    let said = succeeds(folder, "merge 3-1.film 3-3.film -o most.film");
    assert!(text(&said.stderr).contains("2 of 7 passes are missing: 1 and 4"), "{}", text(&said.stderr));
    succeeds(folder, "merge 3-2.film most.film -o c.exr");
    same("whole.exr", "c.exr");
    succeeds(folder, &format!("render scene.toml -o one.film {COMMON} --exposure -0.5"));
    same("one.film", "all.film");

    // A part without a pass is no error, nor is a part of the passes.
    succeeds(folder, "render scene.toml -o none.film --shard 3/3 --passes 2 --particles 8 --exposure -0.5");
    succeeds(folder, "merge 3-1.film none.film -o d.exr");
    fails(folder, "merge none.film -o d2.exr", 1, &["none.film", "no pass"]);
    // Layers, crops and the seed.
    let crop = "--crop 3,2,9,8 --summands --seed 5 --compensation exact";
    succeeds(folder, &format!("render scene.toml -o crop.exr {COMMON} {crop}"));
    parts(folder, 2, crop);
    succeeds(folder, "merge 2-1.film 2-2.film -o e.exr");
    same("crop.exr", "e.exr");
}

#[test]
fn films_that_do_not_belong_together_are_refused_by_name() {
    let folder = folder();
    let folder = folder.path();
    parts(folder, 2, "");
    let film = |name: &str, more: &str| {
        succeeds(folder, &format!("render scene.toml -o {name}.film --shard 2/2 --passes 7 {more}"));
    };
    film("seed", "--particles 8 --seed 3");
    film("lights", "--particles 4");
    film("size", "--particles 8 --resolution 16x20");
    film("camera", "--particles 8 --fov 31");
    fs::write(folder.join("hall.toml"), SCENE).unwrap();
    succeeds(folder, &format!("render hall.toml -o hall.film --shard 2/2 {COMMON}"));
    let mtl = fs::read_to_string(folder.join("room.mtl")).unwrap();
    fs::write(folder.join("room.mtl"), mtl.replace("0.5 0.5 0.5", "0.5 0.5 0.6")).unwrap();
    film("material", "--particles 8");
    for (other, why) in [
        ("seed", "settings: seed"),
        ("lights", "settings: particles"),
        ("size", "16x20 pixels"),
        ("camera", "another camera"),
        ("hall", "\"hall\""),
        ("material", "another content"),
        ("2-1", "would count twice"),
    ] {
        let names = ["2-1.film", &format!("{other}.film"), why];
        fails(folder, &format!("merge 2-1.film {other}.film -o x.exr"), 1, &names);
    }
    let whole = fs::read(folder.join("2-2.film")).unwrap();
    fs::write(folder.join("short.film"), &whole[..whole.len() - 9]).unwrap();
    fails(folder, "merge 2-1.film short.film -o x.exr", 1, &["short.film", "cut off"]);
    fails(folder, "merge 2-1.film scene.toml -o x.exr", 1, &["scene.toml", "not a film"]);
    fails(folder, "merge 2-1.film absent.film -o x.exr", 1, &["absent.film"]);
    fails(folder, "merge 2-1.film 2-2.film -o 2-1.film", 1, &["2-1.film"]);
    fails(folder, "merge 2-1.film -o x.jpg", 2, &[".film"]);
    // Flags that concern images, and outputs that are not one film.
    for (flags, names) in [
        ("-o a.exr --shard 1/2", ["--shard", ".film"]),
        ("-o a.exr -o a.film --shard 1/2", ["--shard", "alone"]),
        ("-o a.film --target-error 0.1", ["--target-error", "film"]),
        ("-o a.film --preview 1", ["--preview", "film"]),
        ("-o a.film --shard 3/2", ["--shard", "I/N"]),
    ] {
        fails(folder, &format!("render scene.toml {flags}"), 2, &names);
    }
}

#[test]
fn a_killed_part_goes_on_from_its_film() {
    let folder = folder();
    let folder = folder.path();
    let line = |passes: u32| {
        format!("render scene.toml -o a.film --shard 2/3 --particles 8 --resolution 96x64 --passes {passes}")
    };
    let mut run = command(folder, &format!("{} --checkpoint 0.05", line(3_000_000))).spawn().unwrap();
    let film = folder.join("a.film");
    let start = Instant::now();
    while !film.exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "there is no film");
        std::thread::sleep(Duration::from_millis(10));
    }
    kill(&run, "KILL");
    assert!(!run.wait().unwrap().success());
    let end = FilmFile::read(&film).unwrap().about.passes.end() + 6;
    fails(
        folder,
        &format!("{} --resume --shard 3/3", line(end).replace("--shard 2/3", "")),
        1,
        &["a.film", "none of this part"],
    );
    fails(folder, &format!("{} --resume --seed 1", line(end)), 1, &["a.film", "another scene, camera or settings"]);
    succeeds(folder, &format!("{} --resume", line(end)));
    succeeds(folder, &line(end).replace("a.film", "b.film"));
    assert!(fs::read(&film).unwrap() == fs::read(folder.join("b.film")).unwrap());
    assert!(!contents(folder).keys().any(|name| name.contains(".state")));
}

#[cfg(not(feature = "mpi"))]
#[test]
fn a_program_without_mpi_says_so_under_a_launcher() {
    let folder = folder();
    let run = |line: &str, variable: &str, ranks: &str| {
        let output = command(folder.path(), line).env(variable, ranks).output().unwrap();
        (output.status.code(), text(&output.stderr))
    };
    let line = format!("render scene.toml -o a.exr {COMMON}");
    for variable in ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"] {
        let (code, message) = run(&line, variable, "4");
        assert_eq!(code, Some(2), "{message}");
        assert!(
            ["mpirun", "4 ranks", "--features mpi", "--shard"].iter().all(|word| message.contains(word)),
            "{message}"
        );
    }
    // A job of one rank, and a part in a job of several.
    assert_eq!(run(&line, "OMPI_COMM_WORLD_SIZE", "1").0, Some(0));
    assert_eq!(run(&line.replace("a.exr", "a.film --shard 1/4"), "OMPI_COMM_WORLD_SIZE", "4").0, Some(0));
}
