//! `lightsum-conform` as people who write drivers meet it: one file, without sources.
//!
//! LIGHTSUM_DEVICE names the device, as for all tests with a device.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::Duration;

use lightsum::conform::{ALL, SELF_TESTS};
use serde_json::Value;

/// The program, copied into a folder that holds nothing else.
fn conform(folder: &Path, arguments: &str) -> Output {
    let program = folder.join(format!("conform{}", std::env::consts::EXE_SUFFIX));
    if !program.exists() {
        fs::copy(env!("CARGO_BIN_EXE_lightsum-conform"), &program).unwrap();
    }
    let mut command = Command::new(&program);
    command.args(arguments.split_whitespace()).current_dir(folder).env_remove("RUST_LOG");
    if let (Ok(device), true) = (std::env::var("LIGHTSUM_DEVICE"), arguments.starts_with("run")) {
        command.args(["--device", &device]);
    }
    // A process that another test starts while the copy is written holds it open until it has its own program.
    for _ in 0..500 {
        match command.output() {
            Err(error) if error.kind() == ErrorKind::ExecutableFileBusy => sleep(Duration::from_millis(10)),
            output => return output.expect("the program starts"),
        }
    }
    panic!("{} is still being written after five seconds", program.display());
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn read_json(folder: &Path, name: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join(name)).unwrap()).unwrap()
}

#[test]
fn a_copied_program_needs_no_source_tree() {
    let folder = tempfile::tempdir().unwrap();
    let output = conform(
        folder.path(),
        "run --filter kernels::a_dispatch --filter kernels::subgroups --filter sequences --size 1,65,31x17 --seed 5 \
         --validation --json out.json --junit out.xml",
    );
    let shown = text(&output.stdout);
    assert!(output.status.success(), "{shown}{}", text(&output.stderr));
    assert!(shown.ends_with("\n3 pass\n"), "{shown}");
    let json = read_json(folder.path(), "out.json");
    for key in ["name", "driver", "driver_version", "api_version", "subgroup_operations"] {
        assert!(json["device"][key].as_str().is_some_and(|text| !text.is_empty()), "{key}: {json}");
    }
    assert_eq!(json["settings"]["sizes"], serde_json::json!([[1, 1], [65, 1], [31, 17]]));
    let checks = json["checks"].as_array().unwrap();
    let names: Vec<&str> = checks.iter().map(|check| check["name"].as_str().unwrap()).collect();
    assert!(names.iter().any(|name| name.starts_with("sequences::")) && names.len() == 3, "{names:?}");
    assert!(checks.iter().all(|check| check["verdict"] == "pass" && check["bound"] == "exact"), "{json}");
    let reduce = checks.iter().find(|check| check["kernels"][0] == "reduce").unwrap();
    let uses = |what: &str| reduce["exercises"].as_array().unwrap().iter().any(|feature| feature == what);
    for feature in
        ["atomics", "barriers of workgroups", "loops", "push constants", "subgroup shuffles", "workgroup memory"]
    {
        assert!(uses(feature), "{feature}: {reduce}");
    }
    let xml = fs::read_to_string(folder.path().join("out.xml")).unwrap();
    let document = cases(&xml);
    assert_eq!(document, (3, 0), "{xml}");
}

/// Test cases, and those with an element of a bad end.
fn cases(xml: &str) -> (usize, usize) {
    let count = |part: &str| xml.matches(part).count();
    (count("<testcase "), count("<failure ") + count("<error ") + count("<skipped "))
}

#[test]
fn every_bad_end_is_noticed_and_the_others_keep_their_verdicts() {
    let folder = tempfile::tempdir().unwrap();
    let output = conform(folder.path(), "run --self-test --timeout 5 --json out.json --junit out.xml");
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    let json = read_json(folder.path(), "out.json");
    let verdicts: Vec<(String, String)> = (json["checks"].as_array().unwrap().iter())
        .map(|check| ["verdict", "message"].map(|key| check[key].as_str().unwrap().to_owned()).into())
        .collect();
    let expected = ["fail", "error", "unsupported", "crashed", "timed-out"];
    assert_eq!(verdicts.len(), SELF_TESTS.len());
    for ((verdict, message), expected) in verdicts.iter().zip(expected) {
        assert_eq!(verdict, expected, "{message}");
    }
    let says = |i: usize, part: &str| assert!(verdicts[i].1.contains(part), "{verdicts:?}");
    says(0, "left == right");
    says(1, "device was lost");
    says(2, "maxStorageBufferRange");
    says(3, "signal 6");
    says(4, "within 5 s");
    let xml = fs::read_to_string(folder.path().join("out.xml")).unwrap();
    assert_eq!(cases(&xml), (5, 5), "{xml}");
    assert!(xml.contains("failures=\"1\" errors=\"3\" skipped=\"1\""), "{xml}");
}

#[test]
fn checks_and_devices_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let list = text(&conform(folder.path(), "list").stdout);
    let names: Vec<&str> = list.lines().filter(|line| !line.starts_with(' ')).collect();
    assert_eq!(names, ALL.iter().map(|check| check.name).collect::<Vec<_>>());
    let some = text(&conform(folder.path(), "list --filter indirect_dispatches").stdout);
    assert!(some.contains("    exercises: ") && some.contains("indirect dispatch"), "{some}");
    let devices = conform(folder.path(), "devices");
    assert!(devices.status.success() && text(&devices.stdout).contains("subgroups of"), "{}", text(&devices.stdout));
}

#[test]
fn wrong_use_is_told_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, code, part) in [
        ("run --filter nothing_like_it --json a.json", 1, "lightsum-conform list"),
        ("run --size 0", 2, "--size"),
        ("run --timeout 0", 2, "--timeout"),
        ("run --device no_such_device --json a.json", 1, "no_such_device"),
        ("run --json a.json --junit a.json", 1, "a.json"),
        ("run --json no/such/folder.json", 1, "folder.json"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_lightsum-conform"))
            .args(arguments.split_whitespace())
            .current_dir(folder.path())
            .output()
            .expect("the program starts");
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments}: {message}");
        assert!(message.contains(part) && !message.contains("panicked"), "{arguments}: {message}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{arguments} left a file");
    }
}
