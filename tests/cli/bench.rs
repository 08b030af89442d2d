//! The benchmark as a user meets it, at sizes that take no time: output and files of each mode, and failures.
//!
//! LIGHTSUM_DEVICE names the device, as for all tests with a device.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use lightsum::scene::builtin;
use serde_json::Value;

/// Flags for every mode.
const TINY: &str = "--resolution 16x12 --repeats 1";

/// The program in a folder that also holds its temporary files.
fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsum-bench"));
    command.args(arguments.split_whitespace()).current_dir(folder).env_remove("RUST_LOG");
    let starts = ["--device", "--help"].iter().all(|flag| !arguments.contains(flag));
    if let (Ok(device), true) = (std::env::var("LIGHTSUM_DEVICE"), starts) {
        command.args(["--device", &device]);
    }
    command.env("TMPDIR", folder);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

#[track_caller]
fn succeeds(folder: &Path, arguments: &str) -> Output {
    let output = command(folder, arguments).output().expect("the program starts");
    assert!(output.status.success(), "{arguments}: {}", text(&output.stderr));
    output
}

/// Runs a mode with `--json` and returns its lines; each contains the environment of the measurement.
#[track_caller]
fn lines(folder: &Path, arguments: &str) -> Vec<Value> {
    let output = succeeds(folder, &format!("{arguments} {TINY} --json"));
    let lines: Vec<Value> = text(&output.stdout).lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    assert!(!lines.is_empty(), "{arguments} prints nothing");
    for line in &lines {
        assert_eq!(line["program"], concat!("lightsum ", env!("CARGO_PKG_VERSION")));
        let commit = line["commit"].as_str().unwrap();
        assert!(commit == "unknown" || commit.len() >= 4 && commit.chars().all(|c| c.is_ascii_hexdigit()), "{commit}");
        for key in ["device", "driver"] {
            assert!(line[key].as_str().is_some_and(|text| !text.is_empty()), "{key} in {line}");
        }
        assert!(line["cores"].as_u64() > Some(0) && line["subgroup"].as_u64() > Some(0), "{line}");
        assert!(line.get("processor").is_some() && line.get("clock_mhz").is_some(), "{line}");
    }
    lines
}

/// A positive number.
#[track_caller]
fn positive(value: &Value) -> f64 {
    value.as_f64().filter(|&v| v > 0.0).unwrap_or_else(|| panic!("{value} is no number above 0"))
}

/// Runs it, checks the exit code and returns the message, which must contain `names`.
#[track_caller]
fn fails(folder: &Path, arguments: &str, code: i32, names: &[&str]) {
    let output = command(folder, arguments).output().expect("the program starts");
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments}: {message}");
    assert!(message.starts_with("error: ") && !message.contains("panicked"), "{arguments}: {message}");
    for name in names {
        assert!(message.contains(name), "{arguments}: no {name:?} in {message}");
    }
}

#[test]
fn a_frame_is_measured_for_every_scene_and_setting() {
    let folder = folder();
    let cornell = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml");
    let arguments =
        format!("frame --scene room:300 --scene {cornell} --particles 2,16 --traversal single --max-depth 3");
    let lines = lines(folder.path(), &arguments);
    let key =
        |line: &Value| (line["scene"].as_str().unwrap().to_owned(), line["settings"]["particles"].as_u64().unwrap());
    let expected = [("room:300", 2), ("room:300", 16), (cornell, 2), (cornell, 16)].map(|(s, p)| (s.to_owned(), p));
    assert_eq!(lines.iter().map(key).collect::<Vec<_>>(), expected);
    for line in &lines {
        assert_eq!((&line["mode"], &line["kernel"], &line["repeats"]), (&"frame".into(), &"single".into(), &1.into()));
        assert_eq!(line["resolution"], serde_json::json!([16, 12]));
        assert_eq!((&line["settings"]["max_depth"], &line["settings"]["traversal"]), (&3.into(), &"single".into()));
        let (frame, rays) = (positive(&line["median_seconds"]), positive(&line["rays"]));
        assert!(rays > 16.0 * 12.0, "more than the eye's rays");
        assert!((positive(&line["rays_per_second"]) * frame / rays - 1.0).abs() < 1e-6, "{line}");
        assert_eq!(line["spread"], 0.0);
        let passes = line["gpu_passes"].as_array().unwrap();
        let names: Vec<&str> = passes.iter().map(|pass| pass["pass"].as_str().unwrap()).collect();
        let place =
            |name: &str| names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("no {name}: {names:?}"));
        assert!(place("eye") < place("walk") && place("walk") < place("shade") && place("shade") < place("accumulate"));
        // Some are parts of others.
        let whole =
            |name: &str| name == "near_light" || !name.starts_with("near_") && !["sort", "clusters"].contains(&name);
        let wholes = passes.iter().filter(|p| whole(p["pass"].as_str().unwrap()));
        let sum: f64 = wholes.map(|p| positive(&p["median_seconds"])).sum();
        assert!(sum <= frame * 1.05, "the passes take {sum} s of {frame} s");
    }
    assert!(positive(&lines[1]["rays"]) > positive(&lines[0]["rays"]));
    assert_eq!(lines[0]["triangles"], builtin::room(300).triangles.len());
}

#[test]
fn a_master_is_measured_part_by_part() {
    let folder = folder();
    let cornell = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml");
    for exact in ["", "--exact"] {
        let line = lines(folder.path(), &format!("master --scene {cornell} {exact}")).remove(0);
        assert_eq!(
            (&line["mode"], &line["tasks"], &line["exact"]),
            (&"master".into(), &9.into(), &(!exact.is_empty()).into())
        );
        let parts = line["parts"].as_array().unwrap();
        let names: Vec<&str> = parts.iter().map(|part| part["part"].as_str().unwrap()).collect();
        assert_eq!(names, ["unpack", "stage", "pass", "image"]);
        let sum: f64 = parts.iter().map(|part| positive(&part["wall"]["median_seconds"])).sum();
        let frame = positive(&line["frame"]["wall"]["median_seconds"]);
        assert!((sum / frame - 1.0).abs() < 1e-6, "{sum} s of {frame} s");
        let rate = positive(&line["megapixels_per_second"]) * positive(&line["frame"]["processor"]["median_seconds"]);
        assert!((rate - 16.0 * 12.0 * 1e-6).abs() < 1e-9, "{line}");
        // A plain point has 20 bytes, an exact one 176, with 8 or 16 for its first hit.
        let bytes = positive(&line["bytes_per_pixel"]);
        assert!(if exact.is_empty() { bytes < 40.0 } else { bytes > 176.0 }, "{bytes} bytes a pixel");
    }
    let text = text(&succeeds(folder.path(), &format!("master --scene {cornell} {TINY}")).stdout);
    assert!(["points from bytes", "pass: discontinuity", "Mpixel/s"].iter().all(|word| text.contains(word)), "{text}");
}

#[test]
fn tables_are_aligned_and_name_what_they_measure() {
    let folder = folder();
    fs::write(folder.path().join("bare.obj"), BARE).unwrap();
    fs::write(folder.path().join("bare.mtl"), "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKe 10 10 10\n").unwrap();
    let output = text(&succeeds(folder.path(), &format!("frame --scene bare.obj {TINY}")).stdout);
    let rows: Vec<&str> = output.lines().collect();
    let head = rows.iter().position(|row| row.starts_with("pass ")).expect("a head");
    assert!(rows[head - 1].starts_with("bare.obj: 4 triangles, 16x12, "), "{output}");
    let last = rows.iter().position(|row| row.starts_with("whole frame")).expect("a last row");
    let column = rows[head].find("median ms").unwrap() + "median ms".len();
    for row in &rows[head + 1..=last] {
        let (number, rest) = row.split_at(column);
        assert!(number.split_whitespace().last().unwrap().parse::<f64>().is_ok() && rest.starts_with(' '), "{row}");
    }
    assert!(rows[last].ends_with("100 %"), "{output}");
}

/// A floor under a lamp, without a camera.
const BARE: &str = "mtllib bare.mtl
v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1
v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5
usemtl floor\nf 1 2 3 4
usemtl lamp\nf 5 6 7 8
";

#[test]
fn three_series_scale() {
    let folder = folder();
    let lines = lines(folder.path(), "scaling --max-triangles 1500 --max-particles 2");
    let of = |series: &str| lines.iter().filter(|line| line["series"] == series).collect::<Vec<_>>();
    let (triangles, lights, resolution) = (of("triangles"), of("lights"), of("resolution"));
    assert_eq!((triangles.len(), lights.len(), resolution.len(), lines.len()), (2, 2, 4, 8));
    assert_eq!(triangles[0]["triangles"], builtin::room(1000).triangles.len());
    assert_eq!(triangles[1]["scene"], "room:1500");
    assert!(positive(&triangles[1]["scene_bytes"]) > positive(&triangles[0]["scene_bytes"]));
    assert_eq!((&lights[0]["particles"], &lights[1]["particles"]), (&1.into(), &2.into()));
    assert!(positive(&lights[1]["lights"]) > positive(&lights[0]["lights"]));
    let sizes: Vec<_> = resolution.iter().map(|line| line["resolution"].to_string()).collect();
    assert_eq!(sizes, ["[4,3]", "[8,6]", "[16,12]", "[32,24]"]);
    for line in &lines {
        assert_eq!(line["mode"], "scaling");
        positive(&line["median_seconds"]);
        positive(&line["bvh"]["median_seconds"]);
        assert!(line.get("error").is_none());
    }
    let table = text(&succeeds(folder.path(), &format!("scaling --series lights --max-particles 1 {TINY}")).stdout);
    assert!(table.contains("lights") && !table.contains("triangles  "), "{table}");
}

#[test]
fn startup_is_measured_cold_and_warm() {
    let folder = folder();
    let lines = lines(folder.path(), "startup --scene room:300");
    assert_eq!((lines.len(), &lines[0]["mode"], &lines[0]["scene"]), (1, &"startup".into(), &"room:300".into()));
    assert!(lines[0]["settings"]["particles"].as_u64() > Some(0));
    for caches in ["cold", "warm"] {
        for step in ["load", "device", "bvh", "prepare", "first_pass", "second_pass"] {
            let step = &lines[0][caches][step];
            positive(&step["median_seconds"]);
            assert_eq!(step["spread"], 0.0);
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "caches are left");
}

#[test]
fn a_start_fills_the_file_of_pipelines() {
    let folder = folder();
    let file = folder.path().join("pipelines.bin");
    let device = std::env::var("LIGHTSUM_DEVICE").unwrap_or_else(|_| String::from("auto"));
    let arguments = "startup-once --scene room:300 --resolution 4x3 --pipeline-cache pipelines.bin";
    let output = succeeds(folder.path(), &format!("{arguments} --device {device}"));
    let times: Value = serde_json::from_slice(&output.stdout).unwrap();
    positive(&times["prepare"]);
    assert!(fs::read(file).unwrap().starts_with(b"LSPIPES1"));
}

#[test]
fn shadow_rays_are_counted_and_written() {
    let folder = folder();
    let lines = lines(folder.path(), "shadow-rays --scene room:300 --lights 3 --dump-rays rays");
    for line in &lines {
        assert_eq!((&line["mode"], &line["lights"]), (&"shadow-rays".into(), &3.into()));
        assert!(positive(&line["segments"]) >= positive(&line["visible"]), "{line}");
        positive(&line["mega_segments_per_second"]);
    }
    assert_eq!(lines[0]["kernel"], "single");
    let room = builtin::room(300);
    let receivers = lines[0]["receivers"].as_u64().unwrap();
    let size = |name: &str| fs::metadata(folder.path().join("rays").join(name)).expect(name).len();
    assert_eq!(size("vertices.f32"), 12 * room.positions.len() as u64);
    assert_eq!(size("indices.u32"), 12 * room.triangles.len() as u64);
    assert_eq!((size("receivers.f32"), size("normals.f32")), (12 * receivers, 12 * receivers));
    assert_eq!(size("lights.f32"), 12 * 3);
    let points = fs::read(folder.path().join("rays/vertices.f32")).unwrap();
    let first: Vec<f32> = points[..12].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(first, room.positions[0].to_array());
}

#[test]
fn shadow_rays_are_verified_and_what_clusters_meet_is_counted() {
    let folder = folder();
    let lines = lines(folder.path(), "shadow-rays --scene room:300 --lights 5 --verify --counters --only cluster");
    for line in &lines {
        if line["kernel"] == "cluster" {
            assert!(
                line["differing_receivers"].as_u64().unwrap() * 100 <= line["receivers"].as_u64().unwrap(),
                "{line}"
            );
        } else {
            assert_eq!(line["kernel"], "counters");
            assert!(positive(&line["nodes_per_pair"]) >= 1.0, "{line}");
            positive(&line["rays"]);
        }
    }
    // A device without clusters prints nothing; the program still succeeds.
    assert!([0, 2].contains(&lines.len()), "{lines:?}");
}

#[test]
fn rays_to_area_lights_are_measured_and_verified() {
    let folder = folder();
    let measure =
        |area: &str| lines(folder.path(), &format!("shadow-rays --scene room:300 --lights 5 --verify {area}"));
    let (points, default, wide) = (measure(""), measure("--area --counters"), measure("--area 0.3"));
    for (lines, area) in [(&points, Value::Null), (&default, 0.05.into()), (&wide, 0.3.into())] {
        for line in lines.iter().filter(|line| line["kernel"] != "counters") {
            assert_eq!(line["area"], area, "{line}");
            let (differing, receivers) = (&line["differing_receivers"], line["receivers"].as_u64().unwrap());
            assert!(differing.as_u64().unwrap() * 100 <= receivers, "{line}");
            positive(&line["mega_segments_per_second"]);
        }
    }
    // The same points, but other rays.
    assert_eq!(points[0]["receivers"], wide[0]["receivers"]);
    assert_ne!(points[0]["visible"], wide[0]["visible"]);
    // Clusters are counted if the device has them.
    let of = |kernel: &str| default.iter().filter(|line| line["kernel"] == kernel).collect::<Vec<_>>();
    let (clusters, counters) = (of("cluster"), of("counters"));
    assert_eq!((of("single").len(), clusters.len()), (1, counters.len()));
    for line in counters {
        positive(&line["triangles_per_pair"]);
    }

    let arguments = "shadow-rays --scene room:300 --area --dump-rays rays";
    fails(folder.path(), &format!("{arguments} {TINY}"), 2, &["--area", "point lights"]);
    assert!(!folder.path().join("rays").exists());
    fails(folder.path(), &format!("compare --scene room:300 --area --embree ./peer {TINY}"), 2, &["--area"]);
}

/// A substitute for Embree.
fn peer(folder: &Path, script: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.join("peer");
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path
}

#[test]
fn embree_is_compared_by_its_best_packets() {
    let folder = folder();
    // It finds the rays, and runs once in each turn.
    peer(
        folder.path(),
        r#"[ -s "$1/lights.f32" ] && [ -s "$1/normals.f32" ] || exit 1
echo run >> runs
echo '{"peer": "embree", "packet": 8, "segments": 100, "visible": 60, "mega_segments_per_second": 20.0}'
echo '{"peer": "embree", "packet": 16, "segments": 100, "visible": 61, "mega_segments_per_second": 40.0}'"#,
    );
    let lines = lines(folder.path(), "compare --scene room:300 --embree ./peer --turns 2");
    for line in &lines {
        assert_eq!((&line["mode"], &line["embree_packet"]), (&"compare".into(), &16.into()));
        assert_eq!((&line["embree_segments"], &line["embree_visible"]), (&100.into(), &61.into()));
        assert_eq!(line["embree_mega_segments_per_second"], 40.0);
        assert_eq!(line["turns"].as_array().map(Vec::len), Some(2));
        let ours = positive(&line["mega_segments_per_second"]);
        assert!((positive(&line["ratio"]) - ours / 40.0).abs() < 1e-9, "{line}");
    }
    assert_eq!(fs::read_to_string(folder.path().join("runs")).unwrap(), "run\nrun\n");
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "the rays are left: {left:?}");
}

#[test]
fn a_peer_that_does_not_work_is_named() {
    let folder = folder();
    let compare = format!("compare --scene room:300 --turns 1 {TINY} --embree");
    let fails = |program: &str, names: &[&str]| fails(folder.path(), &format!("{compare} {program}"), 1, names);
    fails("./absent", &["./absent", "running"]);
    peer(folder.path(), "echo twenty million");
    fails("./peer", &["./peer", "twenty million"]);
    peer(folder.path(), r#"echo '{"packet": 8, "segments": 10, "visible": 5}'"#);
    fails("./peer", &["./peer", "lacks a measurement"]);
    peer(folder.path(), "true");
    fails("./peer", &["./peer", "no measurement"]);
    peer(folder.path(), "echo 'it is ill' >&2; exit 3");
    fails("./peer", &["./peer", "it is ill", "3"]);
}

#[test]
fn wrong_use_is_named() {
    let folder = folder();
    fs::write(folder.path().join("scene.toml"), "model = \"bare.obj\"\ncolour = 3\n").unwrap();
    for mode in ["frame", "startup", "shadow-rays"] {
        fails(folder.path(), &format!("{mode} --scene absent.toml"), 1, &["absent.toml"]);
        fails(folder.path(), &format!("{mode} --scene room:20"), 2, &["room:20", "--scene"]);
        fails(folder.path(), &format!("{mode} --scene scene.toml {TINY}"), 1, &["scene.toml", "colour"]);
        // The error in the second one is found before the first is measured.
        fails(folder.path(), &format!("{mode} --scene room:8000000 --scene rooom:300"), 1, &["rooom:300"]);
    }
    fails(folder.path(), "frame", 1, &["scenes/cornell/scene.toml"]);
    fails(folder.path(), "frame --scene room:300 --pathz 3", 2, &["--pathz"]);
    fails(folder.path(), "frame --scene room:300 --particles 0", 2, &["--particles"]);
    fails(folder.path(), "scaling --resolution 8192x8192", 2, &["--resolution", "8192x8192"]);
    fails(folder.path(), "scaling --device no-such-device", 1, &["no-such-device"]);
    fails(folder.path(), "paint", 2, &["paint"]);
}

#[test]
fn what_the_device_cannot_hold_is_refused() {
    let folder = folder();
    // A gibibyte in each array, more than lavapipe binds; a GPU may succeed.
    let arguments = "frame --scene room:300 --resolution 8192x8192 --particles 1 --max-depth 1 --repeats 1";
    let output = command(folder.path(), arguments).output().expect("the program starts");
    let message = text(&output.stderr);
    match output.status.code() {
        Some(0) => assert!(text(&output.stdout).contains("whole frame")),
        code => {
            assert_eq!(code, Some(1), "{message}");
            assert!(message.starts_with("error: ") && message.contains("bytes"), "{message}");
        }
    }
}

#[test]
fn a_closed_pipe_ends_it_quietly() {
    let folder = folder();
    let mut child = command(folder.path(), &format!("frame --scene room:300 --particles 1 --max-depth 2 {TINY}"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut first = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
    assert!(first.starts_with("lightsum "), "{first}");
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!((child.wait().unwrap().code(), said.as_str()), (Some(0), ""));
}

#[test]
fn edits_are_measured() {
    let folder = folder();
    let lines = lines(folder.path(), "edits --scene room:900");
    assert_eq!(lines.len(), 1);
    let line = &lines[0];
    assert_eq!((&line["mode"], &line["objects"]), (&"edits".into(), &26.into()));
    assert!(line["object_triangles"].as_u64() > Some(0) && line["bytes"].as_u64() > Some(0), "{line}");
    for key in ["vertices", "refit", "top_level", "lights", "staging", "upload", "pass"] {
        assert!(line[key]["median_seconds"].as_f64() > Some(0.0), "{key}: {line}");
    }
    let output = command(folder.path(), "edits --scene room:900 --object tabl").output().expect("the program starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("\"table 0\""), "{}", text(&output.stderr));
}

#[test]
fn soft_shadows_are_measured_for_every_width_and_number_of_emitters() {
    let folder = folder();
    let of_boards = lines(folder.path(), "shadows --pixels 1,7");
    assert_eq!(of_boards.iter().map(|line| line["pixels"].as_u64()).collect::<Vec<_>>(), [Some(1), Some(7)]);
    let of_room = lines(folder.path(), "shadows --scene room:300 --lights 0,1");
    let emitters: Vec<_> = of_room.iter().map(|line| line["emitters"].as_u64()).collect();
    assert!(emitters[0] == Some(0) && emitters.len() == 2, "{emitters:?}");
    for line in of_boards.iter().chain(&of_room) {
        positive(&line["frame_seconds"]);
        if line["emitters"] != 0 {
            positive(&line["all_seconds"]);
        }
    }
}

#[test]
fn convolution_is_measured_for_every_width_and_form() {
    let folder = folder();
    let lines = lines(folder.path(), "convolve");
    let key = |line: &Value| (line["kernel_width"].as_u64().unwrap(), line["form"].as_str().unwrap().to_owned());
    let expected: Vec<_> = [1, 7, 15, 31, 63, 127]
        .into_iter()
        .flat_map(|width| ["direct", "fast", "invariant"].map(|form| (width, form.to_owned())))
        .collect();
    assert_eq!(lines.iter().map(key).collect::<Vec<_>>(), expected);
    for line in &lines {
        assert_eq!((&line["mode"], &line["repeats"]), (&"convolve".into(), &1.into()));
        assert_eq!(line["resolution"], serde_json::json!([16, 12]));
        positive(&line["median_seconds"]);
        let error = &line["relative_rmse"];
        match (line["form"].as_str(), line["kernel_width"].as_u64()) {
            // Kernels of one pixel keep the image itself.
            (Some("fast"), Some(1)) => assert_eq!(error, 0.0),
            (Some("fast"), _) => assert!(error.as_f64() < Some(0.1), "{line}"),
            _ => assert!(error.is_null(), "{line}"),
        }
    }
    let table = text(&succeeds(folder.path(), &format!("convolve {TINY}")).stdout);
    assert!(table.contains("width px") && table.contains("invariant"), "{table}");
    let few = self::lines(folder.path(), "convolve --kernel-width 3,9 --form fast");
    assert_eq!(few.iter().map(key).collect::<Vec<_>>(), [(3, "fast".to_owned()), (9, "fast".to_owned())]);
    assert!(few.iter().all(|line| line["relative_rmse"].is_null()), "there is nothing to compare with");
}

#[test]
fn a_walkthrough_is_played_for_each_number_of_reflectors() {
    let folder = folder();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/plates/scene.toml");
    let place = |name: &str| folder.path().join(name);
    fs::write(place("room.obj"), GLOSSY).unwrap();
    fs::write(place("room.mtl"), "newmtl floor\nKd 0.4 0.4 0.4\nPr 0.2\nKs 0.3 0.3 0.3\nnewmtl lamp\nKe 10 10 10\n")
        .unwrap();
    // Later frames look away from the floor.
    let path = "frames = 3\n[[camera]]\ntime = 0\neye = [0, 0.6, 3]\ntarget = [0, 0, 0]\n[[camera]]\ntime = 1\neye = [0, 1, 3]\ntarget = [0, 9, 3.1]\n";
    fs::write(place("path.toml"), path).unwrap();
    fs::create_dir(place("images")).unwrap();
    let size = "--resolution 64x48 --path path.toml";
    let all = format!("walkthrough --scene room.obj {size} --json --timings t.json --plot p.svg --images images");
    let output = text(&succeeds(folder.path(), &all).stdout);
    let lines: Vec<Value> = output.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    assert_eq!(lines.iter().map(|line| line["reflectors"].as_u64().unwrap()).collect::<Vec<_>>(), [0, 1]);
    for line in &lines {
        assert_eq!((&line["mode"], &line["frames"]), (&"walkthrough".into(), &3.into()));
        assert_eq!(line["without_reflectors"]["frames"], 2, "{line}");
        let mean = positive(&line["mean_seconds"]);
        assert!((positive(&line["frames_per_second"]) * mean - 1.0).abs() < 1e-9, "{line}");
        positive(&line["median_seconds"]);
        let passes = line["gpu_passes"].as_array().unwrap();
        let mirrors = passes.iter().find(|pass| pass["pass"] == "mirrors");
        assert_eq!(mirrors.is_some(), line["reflectors"] == 1, "{line}");
        assert!(mirrors.is_none_or(|mirrors| positive(&mirrors["share"]) < 1.0));
    }
    let times: Value = serde_json::from_slice(&fs::read(place("t.json")).unwrap()).unwrap();
    let shown: Vec<u64> =
        times["frames"].as_array().unwrap().iter().map(|f| f["reflector_pixels"][0].as_u64().unwrap()).collect();
    assert!(shown[0] > 100 && shown[2] == 0, "{shown:?}");
    assert!(times["slope"]["rays"]["seconds"].is_f64() && times["series"][1]["times"].as_array().unwrap().len() == 3);
    let plot = fs::read_to_string(place("p.svg")).unwrap();
    assert!(plot.starts_with("<svg") && plot.contains("frames per second") && plot.contains("1 reflector\n"), "{plot}");

    // The images are those of `animate`.
    let mut animate = Command::new(env!("CARGO_BIN_EXE_lightsum"));
    let flags = "animate room.obj --path path.toml --resolution 64x48 --preset interactive --moving-passes 1";
    animate.args(flags.split_whitespace()).args("--superposition variant --reflectors 1 -o a-%04d.exr".split(' '));
    if let Ok(device) = std::env::var("LIGHTSUM_DEVICE") {
        animate.args(["--device", &device]);
    }
    let output = animate.current_dir(folder.path()).env("XDG_CACHE_HOME", crate::render::cache()).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    for frame in 0..3 {
        let pixels = |name: String| image::open(place(&name)).unwrap().into_rgb32f().into_raw();
        let (measured, animated) =
            (pixels(format!("images/rays-1-{frame:04}.exr")), pixels(format!("a-{frame:04}.exr")));
        assert!(measured == animated, "frame {frame}");
        assert!(frame > 0 || measured.iter().any(|&x| x > 0.0), "the first frame shows the floor");
    }
    assert!(fs::read(place("images/rays-0-0000.exr")).unwrap() != fs::read(place("images/rays-1-0000.exr")).unwrap());

    let table =
        text(&succeeds(folder.path(), &format!("walkthrough --scene room.obj {size} --reflectors 1 --every 2")).stdout);
    assert!(table.contains("2 frames, 1 of them without") && table.contains("mirrors"), "{table}");

    fs::write(place("empty.toml"), "frames = 0\n").unwrap();
    let walk = |more: &str| format!("walkthrough --scene room.obj {more}");
    fails(folder.path(), &walk("--path empty.toml"), 1, &["empty.toml:1", "frames"]);
    fails(folder.path(), &walk("--path absent.toml"), 1, &["absent.toml"]);
    fails(folder.path(), &walk("--path path.toml --reflectors 1..0"), 2, &["--reflectors", "empty"]);
    fails(folder.path(), &walk("--path path.toml --reflectors 0..2"), 2, &["--reflectors", "room.obj has 1"]);
    fails(folder.path(), &walk("--path path.toml --images absent"), 1, &["absent", "--images"]);
    fails(folder.path(), &walk("--path path.toml --plot absent/p.svg"), 1, &["absent"]);
    fails(folder.path(), &format!("walkthrough --scene {scene} {size} --reflectors 1"), 2, &["has 0"]);
    let moves = format!("{path}[[object]]\nname = \"all\"\nkeys = [{{ time = 0 }}, {{ time = 1, degrees = 9 }}]\n");
    fs::write(place("moves.toml"), moves).unwrap();
    fails(folder.path(), &walk("--path moves.toml --mirror-source images"), 1, &["moves.toml", "take rays"]);

    let both = "--frames 1 --reflectors 1 --mirror-source rays,images --json";
    let output = text(&succeeds(folder.path(), &format!("walkthrough --scene room.obj {size} {both}")).stdout);
    let of_source = |line: &str| {
        let line: Value = serde_json::from_str(line).expect(line);
        let reprojected = line["gpu_passes"].as_array().unwrap().iter().any(|pass| pass["pass"] == "reproject");
        (line["mirror_source"].as_str().unwrap().to_owned(), reprojected)
    };
    assert_eq!(output.lines().map(of_source).collect::<Vec<_>>(), [("rays".into(), false), ("images".into(), true)]);
}

/// A glossy floor under a lamp.
const GLOSSY: &str = "mtllib room.mtl
o all
v -2 0 -2\nv -2 0 2\nv 2 0 2\nv 2 0 -2
v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5
usemtl floor\nf 1 2 3 4
usemtl lamp\nf 5 6 7 8
";
