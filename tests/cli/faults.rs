//! Faults of the device: a Vulkan layer of the tests (`tests/fault_layer/`) makes single calls fail.
//!
//! Whatever fails, the program goes on or ends with exit code 1 and an error that names the work; no object is left at the end, no file is
//! half-written, and the passes before are not lost.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use lightsum::output::State;

use crate::examples;
use crate::render::{command, contents, folder, text};

const OUT_OF_HOST_MEMORY: i32 = -1;
const OUT_OF_DEVICE_MEMORY: i32 = -2;
pub const DEVICE_LOST: i32 = -4;
const TIMEOUT: i32 = 2;

/// A folder with the layer's manifest.
fn layer() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let make = || {
        let library = examples::built("fault_layer", "libfault_layer.so", "tests/fault_layer/lib.rs");
        let manifest = serde_json::json!({
            "file_format_version": "1.2.0",
            "layer": {
                "name": "VK_LAYER_LIGHTSUM_fault",
                "type": "GLOBAL",
                "library_path": library,
                "api_version": "1.3.0",
                "implementation_version": "1",
                "description": "makes single calls fail",
            },
        });
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("fault.json"), manifest.to_string()).unwrap();
        folder
    };
    FOLDER.get_or_init(make).path()
}

/// A folder of compiled pipelines that all tests here share; those of a rendering are there.
fn cache() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let make = || {
        let (cache, scene) = (tempfile::tempdir().unwrap(), folder());
        let output = command(scene.path(), RENDER).env("XDG_CACHE_HOME", cache.path()).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        cache
    };
    FOLDER.get_or_init(make).path()
}

/// Runs the program without the layer.
#[track_caller]
fn succeeds(folder: &Path, arguments: &str) {
    let output = command(folder, arguments).env("XDG_CACHE_HOME", cache()).output().unwrap();
    assert!(output.status.success(), "{arguments}: {}", text(&output.stderr));
}

/// A run under the layer.
pub struct Run {
    pub output: Output,
    /// Names of the calls that may fail, in order.
    pub calls: Vec<String>,
    /// The name of those that failed.
    failed: Vec<String>,
    /// Objects made and not destroyed, by kind.
    left: BTreeMap<String, i64>,
}

/// Runs the program; `faults`: numbers of calls, from 1, and their results.
fn run(folder: &Path, arguments: &str, faults: &[(usize, i32)]) -> Run {
    run_command(command(folder, arguments), faults)
}

/// The layer's variables: what fails and where it writes its log.
pub fn variables(faults: &[(usize, i32)], log: &Path) -> [(&'static str, String); 4] {
    let faults: Vec<String> = faults.iter().map(|(call, result)| format!("{call}:{result}")).collect();
    [
        ("VK_LAYER_PATH", layer().display().to_string()),
        ("VK_INSTANCE_LAYERS", String::from("VK_LAYER_LIGHTSUM_fault")),
        ("LIGHTSUM_FAULT", faults.join(",")),
        ("LIGHTSUM_FAULT_LOG", log.display().to_string()),
    ]
}

/// Likewise for a command that is set up already.
pub fn run_command(mut command: Command, faults: &[(usize, i32)]) -> Run {
    let log = tempfile::NamedTempFile::new().unwrap();
    command.env("XDG_CACHE_HOME", cache()).envs(variables(faults, log.path()));
    let output = command.output().unwrap();
    Run::new(output, log.path())
}

impl Run {
    /// From what the program said and what the layer has written.
    pub fn new(output: Output, log: &Path) -> Run {
        let mut run = Run { output, calls: Vec::new(), failed: Vec::new(), left: BTreeMap::new() };
        for line in fs::read_to_string(log).unwrap().lines() {
            let (what, rest) = line.split_once(' ').unwrap();
            match what {
                "made" => *run.left.entry(rest.to_owned()).or_default() += 1,
                "gone" => *run.left.entry(rest.to_owned()).or_default() -= 1,
                _ => {
                    let name = rest.split_once(' ').unwrap().1.to_owned();
                    run.calls.push(name.clone());
                    if what == "fail" {
                        run.failed.push(name);
                    }
                }
            }
        }
        assert!(!run.calls.is_empty(), "the layer was not loaded: {}", text(&run.output.stderr));
        run
    }

    /// Numbers of the calls that submit work.
    pub fn submissions(&self) -> Vec<usize> {
        let numbered = (1..).zip(&self.calls);
        numbered.filter(|(_, name)| name.starts_with("vkQueueSubmit")).map(|(number, _)| number).collect()
    }

    /// Fails unless the run ended in order; returns whether it was successful.
    #[track_caller]
    fn ended_in_order(&self, what: &str) -> bool {
        let message = text(&self.output.stderr);
        let code = self.output.status.code();
        assert!(!message.contains("panicked"), "{what}: {message}");
        assert!(matches!(code, Some(0 | 1)), "{what}: {:?}: {message}", self.output.status);
        let error = message.lines().find(|line| line.starts_with("error: "));
        assert_eq!(error.is_some(), code == Some(1), "{what}: {message}");
        // Of what failed and what can be done.
        assert!(error.is_none_or(|line| line.contains("; ")), "{what}: {message}");
        self.left_nothing(what)
    }

    /// Fails unless every object is gone and the program ended by itself; returns whether it was successful.
    #[track_caller]
    fn left_nothing(&self, what: &str) -> bool {
        let message = text(&self.output.stderr);
        assert!(matches!(self.output.status.code(), Some(0 | 1)), "{what}: {:?}: {message}", self.output.status);
        assert!(!message.contains("panicked"), "{what}: {message}");
        let left: Vec<_> = self.left.iter().filter(|(_, count)| **count != 0).collect();
        assert!(left.is_empty(), "{what} left {left:?}: {message}");
        self.output.status.success()
    }
}

/// A rendering of three passes, its second with a checkpoint after each pass.
const RENDER: &str = "render scene.toml -o a.exr --particles 4 --passes 3 --checkpoint 0.000001";

/// Checks what a failed rendering of `RENDER` leaves: nothing, or the image and the state of fewer passes.
fn leaves_whole_files(folder: &Path, what: &str) {
    for (name, bytes) in contents(folder) {
        match name.as_str() {
            "a.exr" => {
                exr::prelude::read_first_flat_layer_from_file(folder.join(&name))
                    .unwrap_or_else(|e| panic!("{what}: {e}"));
            }
            "a.exr.state" => assert!(State::read(&folder.join(&name)).unwrap().passes <= 3, "{what}"),
            "room.obj" | "room.mtl" | "scene.toml" | "path.toml" => {}
            _ => panic!("{what} left {name} of {} bytes", bytes.len()),
        }
    }
}

fn clean(folder: &Path) {
    for name in ["a.exr", "a.exr.state"] {
        let _ = fs::remove_file(folder.join(name));
    }
}

/// Lets call number `call` of a rendering fail; `sound`: its image without faults.
fn fail_one(folder: &Path, call: usize, result: i32, sound: &[u8]) -> Run {
    clean(folder);
    let run = run(folder, RENDER, &[(call, result)]);
    let what = format!("result {result} of call {call}, {:?}", run.failed);
    if run.ended_in_order(&what) {
        assert!(fs::read(folder.join("a.exr")).unwrap() == sound, "{what}: another image");
    }
    leaves_whole_files(folder, &what);
    run
}

/// A rendering without faults: its calls, and the image.
fn sound(folder: &Path) -> (Vec<String>, Vec<u8>) {
    let sound = run(folder, RENDER, &[]);
    assert!(sound.ended_in_order("no fault"), "{}", text(&sound.output.stderr));
    (sound.calls, fs::read(folder.join("a.exr")).unwrap())
}

#[test]
fn one_call_of_each_kind_may_fail() {
    let folder = folder();
    let (calls, image) = sound(folder.path());
    let mut places: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (call, name) in (1..).zip(&calls) {
        places.entry(name).or_default().push(call);
    }
    println!("{} calls of {} kinds", calls.len(), places.len());
    let results = [OUT_OF_HOST_MEMORY, OUT_OF_DEVICE_MEMORY, DEVICE_LOST];
    let mut errors = 0;
    for (i, (name, places)) in places.iter().enumerate() {
        let result = if *name == "vkWaitForFences" { TIMEOUT } else { results[i % 3] };
        let run = fail_one(folder.path(), places[places.len() * 2 / 3], result, &image);
        errors += usize::from(!run.output.status.success());
    }
    assert!(errors > places.len() / 2, "{errors} of {} ended in errors", places.len());
}

/// Work whose calls fail one after the other.
struct Work {
    name: &'static str,
    arguments: &'static str,
    /// Its files all begin so.
    stem: &'static str,
}

const WORKS: [Work; 4] = [
    Work { name: "rendering", arguments: RENDER, stem: "a" },
    Work {
        name: "bake",
        // As few passes of kernels as a bake can do with: each is a dozen calls that are alike.
        arguments: "bake scene.toml -o a.glb --particles 4 --density 2 --passes 2 --max-depth 2 --clip 0 --compensation off \
                    --photons 0 --light-pool 0 --checkpoint 0.000001",
        stem: "a",
    },
    Work {
        name: "animation",
        arguments: "animate scene.toml --path path.toml -o f%d.png --particles 4 --moving-passes 1",
        stem: "f",
    },
    Work { name: "embedding", arguments: "f.png scene.toml", stem: "f" },
];

impl Work {
    fn command(&self, folder: &Path) -> Command {
        if self.name != "embedding" {
            return command(folder, self.arguments);
        }
        static EMBED: OnceLock<PathBuf> = OnceLock::new();
        let embed = EMBED.get_or_init(|| examples::built("embed", "embed", "examples/embed.rs"));
        let mut command = Command::new(embed);
        command.args(self.arguments.split_whitespace()).current_dir(folder);
        command
    }

    /// The files that it has left, which are gone then.
    fn take_files(&self, folder: &Path) -> BTreeMap<String, Vec<u8>> {
        let mut files = contents(folder);
        files.retain(|name, _| name.starts_with(self.stem));
        files.keys().for_each(|name| fs::remove_file(folder.join(name)).unwrap());
        files
    }

    /// Lets one call fail. After success the files are those of the sound run but for states; after an error they are a part of them, or,
    /// of a rendering, of fewer passes.
    fn fail(&self, folder: &Path, (call, result): (usize, i32), sound: &BTreeMap<String, Vec<u8>>) -> Run {
        let run = run_command(self.command(folder), &[(call, result)]);
        let what = format!("{}: result {result} of call {call}, {:?}", self.name, run.failed);
        if self.name == "rendering" {
            leaves_whole_files(folder, &what);
        }
        let is_state = |name: &String| name.ends_with(".state");
        let mut files = self.take_files(folder);
        for (name, bytes) in files.iter().filter(|(name, _)| is_state(name)) {
            let at = folder.join(name);
            fs::write(&at, bytes).unwrap();
            State::read(&at).unwrap_or_else(|e| panic!("{what}: {e}"));
            fs::remove_file(&at).unwrap();
        }
        files.retain(|name, _| !is_state(name));
        let succeeded = match self.name {
            // The host of the example ends with its own words.
            "embedding" => run.left_nothing(&what),
            _ => run.ended_in_order(&what),
        };
        if succeeded {
            assert!(files == *sound, "{what}: other files, {:?}", files.keys());
        } else if self.name != "rendering" {
            let whole = files.iter().all(|(name, bytes)| sound.get(name) == Some(bytes));
            assert!(whole, "{what}: other files, {:?}", files.keys());
        }
        run
    }
}

/// Number of runs for each result of the failed call and each exit code.
type Outcomes = BTreeMap<(i32, Option<i32>), usize>;

/// Lets those of a work's calls fail that `chosen` picks from their number, in turn with each result or, if `each`, with all results.
fn fail_calls(work: &Work, each: bool, chosen: impl Fn(usize) -> Vec<usize>) -> (usize, Outcomes) {
    let folder = folder();
    let path = "frames = 3\n[[camera]]\ntime = 0.0\neye = [0.0, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n\
                [[camera]]\ntime = 0.3\neye = [0.5, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n";
    fs::write(folder.path().join("path.toml"), path).unwrap();
    // The first run compiles and measures what the others find.
    run_command(work.command(folder.path()), &[]);
    work.take_files(folder.path());
    let whole = run_command(work.command(folder.path()), &[]);
    assert!(whole.output.status.success(), "{}: {}", work.name, text(&whole.output.stderr));
    let mut sound = work.take_files(folder.path());
    sound.retain(|name, _| !name.ends_with(".state"));
    assert!(!sound.is_empty(), "{}", work.name);
    let calls = whole.calls;
    let mut outcomes = Outcomes::new();
    for (i, call) in chosen(calls.len()).into_iter().enumerate() {
        let results = match calls[call - 1].as_str() {
            "vkWaitForFences" => &[OUT_OF_HOST_MEMORY, OUT_OF_DEVICE_MEMORY, DEVICE_LOST, TIMEOUT][..],
            _ => &[OUT_OF_HOST_MEMORY, OUT_OF_DEVICE_MEMORY, DEVICE_LOST],
        };
        let results = if each { results } else { &results[i % results.len()..][..1] };
        for &result in results {
            let run = work.fail(folder.path(), (call, result), &sound);
            *outcomes.entry((result, run.output.status.code())).or_default() += 1;
        }
    }
    (calls.len(), outcomes)
}

#[test]
fn some_calls_of_each_work_may_fail() {
    for work in &WORKS[1..] {
        let (calls, outcomes) = fail_calls(work, false, |calls| (1..4).map(|i| i * calls / 4).collect());
        assert_eq!(outcomes.values().sum::<usize>(), 3, "{} with {calls} calls", work.name);
    }
}

#[test]
#[ignore = "takes hours: scripts/faults.py runs it in parts. LIGHTSUM_FAULT_STRIDE=N takes every N-th call, from LIGHTSUM_FAULT_FIRST on, with one result"]
fn every_call_may_fail() {
    let number = |name: &str| std::env::var(name).map_or(1, |number| number.parse().unwrap());
    let (stride, first) = (number("LIGHTSUM_FAULT_STRIDE"), number("LIGHTSUM_FAULT_FIRST"));
    let only = std::env::var("LIGHTSUM_FAULT_WORK").ok();
    for work in WORKS.iter().filter(|work| only.as_ref().is_none_or(|only| only == work.name)) {
        let (calls, outcomes) = fail_calls(work, stride == 1, |calls| (first..=calls).step_by(stride).collect());
        let runs: usize = outcomes.values().sum();
        let errors: usize = outcomes.iter().filter(|((_, code), _)| *code == Some(1)).map(|(_, runs)| runs).sum();
        println!(
            "{}: {calls} calls, {runs} failed, {errors} errors, {} went on: {outcomes:?}",
            work.name,
            runs - errors
        );
    }
}

#[test]
fn an_error_in_a_pass_writes_the_passes_before() {
    let folder = folder();
    let line = "render scene.toml -o a.exr --particles 4 --passes 3 --checkpoint off";
    let (_, image) = sound(folder.path());
    let passes = in_passes(&run(folder.path(), line, &[]).calls, "vkBeginCommandBuffer");
    clean(folder.path());
    assert_eq!(passes.len(), 3);
    let failed = run(folder.path(), line, &[(passes[2], OUT_OF_DEVICE_MEMORY)]);
    assert!(!failed.ended_in_order("the third pass"));
    let message = text(&failed.output.stderr);
    assert!(message.contains("2 passes before the error are in the image"), "{message}");
    assert!(message.contains("state after 2 passes is in a.exr.state"), "{message}");
    assert!(message.contains("error: in pass 2: no memory"), "{message}");
    leaves_whole_files(folder.path(), "the third pass");
    succeeds(folder.path(), &format!("{line} --resume"));
    assert!(fs::read(folder.path().join("a.exr")).unwrap() == image, "the third pass after a fault");
}

/// The last calls of a name in each pass: before its timestamps are read.
fn in_passes(calls: &[String], name: &str) -> Vec<usize> {
    let places =
        |name: &str| (1..).zip(calls).filter(|(_, call)| *call == name).map(|(at, _)| at).collect::<Vec<usize>>();
    let (ends, all) = (places("vkGetQueryPoolResults"), places(name));
    ends.iter().map(|end| *all.iter().rfind(|place| *place < end).unwrap()).collect()
}

#[test]
fn a_lost_device_is_opened_once_more() {
    let folder = folder();
    let (calls, image) = sound(folder.path());
    let lost = in_passes(&calls, "vkQueueSubmit")[2];
    for checkpoint in ["0.000001", "off"] {
        let line = format!("render scene.toml -o a.exr --particles 4 --passes 3 --checkpoint {checkpoint}");
        let lost = in_passes(&run(folder.path(), &line, &[]).calls, "vkQueueSubmit")[2];
        clean(folder.path());
        let once = run(folder.path(), &line, &[(lost, DEVICE_LOST)]);
        let message = text(&once.output.stderr);
        assert!(once.ended_in_order("lost once"), "{message}");
        let after = if checkpoint == "off" { "after 0 passes" } else { "after 2 passes" };
        assert!(message.contains("opening it once more") && message.contains(after), "{message}");
        assert!(fs::read(folder.path().join("a.exr")).unwrap() == image, "another image with checkpoints {checkpoint}");
    }

    clean(folder.path());
    let twice = run(folder.path(), RENDER, &[(lost, DEVICE_LOST), (lost + calls.len() / 2, DEVICE_LOST)]);
    assert!(!twice.ended_in_order("lost twice"), "{}", text(&twice.output.stderr));
    assert_eq!(twice.failed.len(), 2);
    let message = text(&twice.output.stderr);
    assert!(message.contains("the device was lost") && message.contains("a.exr.state"), "{message}");
    assert!(State::read(&folder.path().join("a.exr.state")).unwrap().passes >= 2);
    succeeds(folder.path(), &format!("{RENDER} --resume"));
    assert!(fs::read(folder.path().join("a.exr")).unwrap() == image, "after two lost devices");
}

/// Runs a work, then again for each of these submissions with the device lost in it: `words` are told, and the files are the same. `range`: the
/// device's maxStorageBufferRange. Returns the number of submissions.
fn goes_on_when_lost(line: &str, stem: &str, range: Option<&str>, words: &[(usize, &str)]) {
    let folder = folder();
    let path = "frames = 4\n[[camera]]\ntime = 0.0\neye = [0.0, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n\
                [[camera]]\ntime = 0.3\neye = [0.5, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n";
    fs::write(folder.path().join("path.toml"), path).unwrap();
    let run = |faults: &[(usize, i32)]| {
        let mut command = command(folder.path(), line);
        range.into_iter().for_each(|range| {
            command.env("LIGHTSUM_FAULT_RANGE", range);
        });
        run_command(command, faults)
    };
    let take_files = || {
        let mut files = contents(folder.path());
        files.retain(|name, _| name.starts_with(stem));
        files.keys().for_each(|name| fs::remove_file(folder.path().join(name)).unwrap());
        files
    };
    // The first run compiles and measures what the others find.
    run(&[]);
    take_files();
    let sound = run(&[]);
    assert!(sound.ended_in_order(line), "{line}: {}", text(&sound.output.stderr));
    let files = take_files();
    assert!(!files.is_empty(), "{line}");
    let passes = in_passes(&sound.calls, "vkQueueSubmit");
    for &(pass, words) in words {
        let call = passes[pass.min(passes.len() - 1)];
        let lost = run(&[(call, DEVICE_LOST)]);
        let message = text(&lost.output.stderr);
        assert!(lost.ended_in_order(line), "{line}, pass {pass}: {message}");
        assert!(message.contains("opening it once more") && message.contains(words), "{line}, pass {pass}: {message}");
        assert!(take_files() == files, "{line}: other files after a device that was lost in pass {pass}");
        let twice = run(&[(call, DEVICE_LOST), (sound.calls.len() + call / 2, DEVICE_LOST)]);
        let message = text(&twice.output.stderr);
        assert_eq!(twice.failed.len(), 2, "{line}: {message}");
        assert!(!twice.ended_in_order(line) && message.contains("error: "), "{line}, pass {pass}, twice: {message}");
        take_files();
    }
}

#[test]
fn a_bake_goes_on_when_its_device_is_lost() {
    let line = "bake scene.toml -o a.glb --particles 8 --density 4 --passes 3";
    let often = format!("{line} --checkpoint 0.000001");
    goes_on_when_lost(&often, "a", None, &[(usize::MAX, "going on from the latest checkpoints")]);
    goes_on_when_lost(&format!("{line} --checkpoint off"), "a", None, &[(usize::MAX, "the device was lost")]);
    let adaptive = "bake scene.toml -o a.glb --particles 8 --passes 6 --checkpoint 0.000001 --adaptive 0.1 --height 3";
    goes_on_when_lost(adaptive, "a", None, &[(4, "the device was lost"), (usize::MAX, "the device was lost")]);
}

#[test]
fn an_animation_goes_on_when_its_device_is_lost() {
    let line = "animate scene.toml --path path.toml -o f%d.png --particles 4 --moving-passes 1";
    goes_on_when_lost(line, "f", None, &[(0, "goes on with frame 0"), (2, "goes on with frame 2")]);
    let ring = format!("{line} --ring lights --ring-length 3");
    goes_on_when_lost(&ring, "f", None, &[(2, "goes on with frame 2")]);
}

#[test]
fn strips_go_on_when_their_device_is_lost() {
    // A bound that the image exceeds.
    let line = "render scene.toml -o a.exr --particles 4 --passes 2 --resolution 320x480";
    let words = [(1, "after 0 of"), (usize::MAX, "rendering goes on after 1 of 2 strips")];
    goes_on_when_lost(line, "a", Some("2000000"), &words);
}

#[test]
fn an_animation_keeps_the_frames_before_an_error() {
    let folder = folder();
    let path = "frames = 4\n[[camera]]\ntime = 0.0\neye = [0.0, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n\
                [[camera]]\ntime = 0.3\neye = [0.5, 0.5, 4.0]\ntarget = [0.0, 0.4, 0.0]\n";
    fs::write(folder.path().join("path.toml"), path).unwrap();
    let line = "animate scene.toml --path path.toml -o f%d.png --timings t.json --particles 4 --moving-passes 1";
    succeeds(folder.path(), line);
    let sound = run(folder.path(), line, &[]);
    assert!(sound.ended_in_order("no fault"));
    let frames: Vec<_> = contents(folder.path()).into_iter().filter(|(name, _)| name.starts_with('f')).collect();
    assert_eq!(frames.len(), 4);
    frames.iter().for_each(|(name, _)| fs::remove_file(folder.path().join(name)).unwrap());
    let third = in_passes(&sound.calls, "vkQueueSubmit")[2];
    let failed = run(folder.path(), line, &[(third, OUT_OF_HOST_MEMORY)]);
    assert!(!failed.ended_in_order("the third frame"));
    let message = text(&failed.output.stderr);
    assert!(message.contains("2 of 4 frames were done before the error"), "{message}");
    let after = contents(folder.path());
    let written: Vec<_> =
        after.iter().filter(|(name, _)| name.starts_with('f')).map(|(n, b)| (n.clone(), b.clone())).collect();
    assert!(written == frames[..2], "{:?}", after.keys());
    let timings: serde_json::Value = serde_json::from_slice(&after["t.json"]).unwrap();
    assert_eq!(timings["frames"].as_array().map(Vec::len), Some(2));
}

#[test]
fn a_bake_keeps_the_passes_before_an_error() {
    let folder = folder();
    let line = "bake scene.toml -o a.glb --particles 8 --density 4 --passes 3 --checkpoint off";
    succeeds(folder.path(), line);
    let files =
        || contents(folder.path()).into_iter().filter(|(name, _)| name.starts_with('a')).collect::<BTreeMap<_, _>>();
    let whole = files();
    let sound = run(folder.path(), line, &[]);
    assert!(sound.ended_in_order("no fault") && files() == whole);
    whole.keys().for_each(|name| fs::remove_file(folder.path().join(name)).unwrap());
    let third = *in_passes(&sound.calls, "vkBeginCommandBuffer").last().unwrap();
    let failed = run(folder.path(), line, &[(third, OUT_OF_HOST_MEMORY)]);
    assert!(!failed.ended_in_order("the third pass"));
    let message = text(&failed.output.stderr);
    assert!(message.contains("state after 2 passes is in a.glb.state"), "{message}");
    assert_eq!(files().into_keys().collect::<Vec<_>>(), ["a.glb.state"]);
    succeeds(folder.path(), &format!("{line} --resume"));
    fs::remove_file(folder.path().join("a.glb.state")).unwrap();
    assert!(files() == whole, "after the third pass again");
}
