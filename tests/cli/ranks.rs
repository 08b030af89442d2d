//! One rendering on several ranks, under `mpirun`.

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use lightsum::output::FilmFile;

#[cfg(all(feature = "viewer", target_os = "linux"))]
use crate::faults::{self, DEVICE_LOST, Run};
use crate::render::{SCENE, cache, command, contents, folder, kill, succeeds, text};
#[cfg(feature = "viewer")]
use crate::view::{self, Display};

/// mpirun with the program and its arguments, in a folder.
fn mpirun(folder: &Path, ranks: usize, arguments: &str) -> Command {
    let mut command = Command::new("mpirun");
    // More ranks than cores; no binding, so that the processor's driver has all of them.
    command.args(["--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "-n", &ranks.to_string()]);
    command.arg(env!("CARGO_BIN_EXE_lightsum")).args(arguments.split_whitespace());
    if let Ok(device) = std::env::var("LIGHTSUM_DEVICE") {
        command.args(["--device", &device]);
    }
    command.current_dir(folder).env_remove("RUST_LOG").env("XDG_CACHE_HOME", cache());
    command
}

#[track_caller]
fn runs(folder: &Path, ranks: usize, arguments: &str) -> Output {
    let output = mpirun(folder, ranks, arguments).output().expect("mpirun is installed (scripts/setup.sh --tests)");
    assert!(output.status.success(), "{ranks} ranks, {arguments}: {}", text(&output.stderr));
    output
}

#[test]
fn any_number_of_ranks_gives_the_bits_of_one_process() {
    let folder = folder();
    let folder = folder.path();
    let line = |name: &str| format!("render scene.toml -o {name}.exr -o {name}.png --particles 8 --passes 5");
    let same = |name: &str| {
        for kind in ["exr", "png"] {
            let [whole, parts] = ["whole", name].map(|name| fs::read(folder.join(format!("{name}.{kind}"))).unwrap());
            assert!(whole == parts, "{name}.{kind} differs");
        }
    };
    succeeds(folder, &line("whole"));
    runs(folder, 1, &line("alone"));
    same("alone");
    for ranks in [2, 3, 5, 8] {
        let output = runs(folder, ranks, &format!("{} --checkpoint 0.05 --stats s.json", line("parts")));
        same("parts");
        let said = text(&output.stdout);
        assert!(said.contains(&format!("5 passes on {ranks} ranks")), "{said}");
        let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("s.json")).unwrap()).unwrap();
        let passes = |rank: &serde_json::Value| rank["work"]["passes"].as_u64().unwrap();
        let passes: u64 = stats["ranks"].as_array().unwrap().iter().map(passes).sum();
        assert_eq!((passes, &stats["master"]["passes"]), (5, &5.into()), "{ranks} ranks");
    }
    assert!(!contents(folder).keys().any(|name| name.contains(".film") || name.contains(".tmp")));
    // More ranks than passes, which have the files of their own machine, and a film.
    runs(folder, 4, "render scene.toml -o two.film --particles 8 --passes 2 --local-scene");
    succeeds(folder, "render scene.toml -o alone.film --particles 8 --passes 2");
    assert!(fs::read(folder.join("two.film")).unwrap() == fs::read(folder.join("alone.film")).unwrap());
}

#[test]
fn ranks_need_no_files_of_their_own() {
    let folder = folder();
    let folder = folder.path();
    let elsewhere = tempfile::tempdir().unwrap();
    let line = "render scene.toml -o a.exr --particles 8 --passes 2";
    succeeds(folder, &line.replace("a.exr", "b.exr"));
    let program = env!("CARGO_BIN_EXE_lightsum");
    let of_two = |second: &Path, first_line: &str, second_line: &str| {
        let mut command = Command::new("mpirun");
        command.args(["--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "-n", "1", "-wdir"]);
        command.arg(folder).arg(program).args(first_line.split_whitespace());
        command.args([":", "-n", "1", "-wdir"]).arg(second).arg(program).args(second_line.split_whitespace());
        let output = command.env_remove("RUST_LOG").env("XDG_CACHE_HOME", cache()).output().unwrap();
        (output.status.success(), text(&output.stderr))
    };
    let (success, message) = of_two(elsewhere.path(), line, line);
    assert!(success, "{message}");
    assert!(fs::read(folder.join("a.exr")).unwrap() == fs::read(folder.join("b.exr")).unwrap());
    assert_eq!(fs::read_dir(elsewhere.path()).unwrap().count(), 0);
    fs::remove_file(folder.join("a.exr")).unwrap();

    // Other arguments, a rank without a device, and other files.
    let refused = |(success, message): (bool, String), words: &[&str]| {
        assert!(!success, "{message}");
        assert!(
            words.iter().all(|word| message.contains(word)) && !message.contains("panicked"),
            "{words:?}: {message}"
        );
        assert!(!folder.join("a.exr").exists());
    };
    refused(of_two(folder, line, &line.replace("8", "9")), &["rank 1 on", "other arguments", "--particles 9"]);
    let unknown = "render scene.toml -o a.exr --passes 2 --device none-of-this-name";
    refused(of_two(folder, unknown, unknown), &["error: rank 1 on", "none-of-this-name"]);
    let local = format!("{line} --local-scene");
    refused(of_two(elsewhere.path(), &local, &local), &["error: rank 1 on", "scene.toml"]);
    for name in ["room.obj", "room.mtl"] {
        fs::copy(folder.join(name), elsewhere.path().join(name)).unwrap();
    }
    fs::write(elsewhere.path().join("scene.toml"), SCENE.replace("fov_y = 30.0", "fov_y = 31.0")).unwrap();
    let mut three = mpirun(folder, 1, &local);
    three.args([":", "-n", "1", "-wdir"]).arg(folder).arg(program).args(local.split_whitespace());
    three.args([":", "-n", "1", "-wdir"]).arg(elsewhere.path()).arg(program).args(local.split_whitespace());
    let output = three.output().unwrap();
    refused((output.status.success(), text(&output.stderr)), &["error: rank 2 on", "--local-scene"]);
    // Rank 0 has other files than all others, and filters their points.
    fs::write(folder.join("p.toml"), "times = [0]\n[[camera]]\ntime = 0\n").unwrap();
    fs::write(elsewhere.path().join("p.toml"), "times = [0]\n[[camera]]\ntime = 0\n").unwrap();
    let tiles = "animate scene.toml --path p.toml -o a-%d.exr --particles 8 --cluster-tasks tiles --local-scene";
    refused(of_two(elsewhere.path(), tiles, tiles), &["error: rank 1 on", "--local-scene"]);
}

/// Rank 2 has the driver of the processor compute by vectors of half the width, which is another device to Vulkan. On a device that is not the processor it
/// changes nothing.
#[test]
fn a_rank_with_another_device_is_warned_of_and_named_in_the_image() {
    let folder = folder();
    let folder = folder.path();
    let line = "render scene.toml -o a.exr --particles 8 --passes 4 --device cpu";
    let [device, narrow] = ["", "128"].map(|width| {
        let mut command =
            command(folder, "render scene.toml -o alone.exr --particles 2 --passes 1 --device cpu --stats s.json");
        if !width.is_empty() {
            command.env("LP_NATIVE_VECTOR_WIDTH", width);
        }
        assert!(command.output().unwrap().status.success());
        let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("s.json")).unwrap()).unwrap();
        stats["device"].as_str().unwrap().to_owned()
    });
    assert_ne!(device, narrow);
    let mut command = Command::new("mpirun");
    command.args(["--allow-run-as-root", "--oversubscribe", "--bind-to", "none"]);
    for (i, variable) in [None, None, Some("LP_NATIVE_VECTOR_WIDTH=128")].into_iter().enumerate() {
        command.args(if i > 0 { &[":", "-n", "1"][..] } else { &["-n", "1"] });
        command.args(variable.into_iter().flat_map(|variable| ["-x", variable]));
        command.arg(env!("CARGO_BIN_EXE_lightsum")).args(line.split_whitespace());
    }
    command.current_dir(folder).env_remove("RUST_LOG").env("XDG_CACHE_HOME", cache());
    let output = command.output().unwrap();
    let message = text(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert!(message.contains("rank 2 renders by") && message.contains("last bits"), "{message}");
    let note = text(&fs::read(folder.join("a.exr")).unwrap());
    assert!(note.contains(&device) && note.contains(&narrow), "{device} and {narrow} are not in the image");
}

fn wait_for(film: &Path) {
    let start = Instant::now();
    while !film.exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "there is no film");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// The processes that a process has started.
fn children(parent: u32) -> Vec<u32> {
    let of = |pid: u32| {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // After the name in parentheses: state, parent.
        let started_by: u32 = stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()?;
        (started_by == parent).then_some(pid)
    };
    let names = fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    names.filter_map(|name| of(name.parse().ok()?)).collect()
}

#[test]
fn a_job_whose_rank_is_killed_goes_on_with_one_rank_fewer() {
    let folder = folder();
    let folder = folder.path();
    let line = |passes: u32| format!("render scene.toml -o a.exr --particles 8 --resolution 96x64 --passes {passes}");
    let mut run = mpirun(folder, 4, &format!("{} --checkpoint 0.1", line(1_000_000)));
    let mut run = run.stderr(Stdio::piped()).spawn().unwrap();
    let film = folder.join("a.exr.film");
    wait_for(&film);
    // The last of mpirun's children: a rank that renders.
    let last = children(run.id()).into_iter().max().expect("mpirun has children");
    assert!(Command::new("kill").args(["-KILL", &last.to_string()]).status().unwrap().success());
    assert!(!run.wait().unwrap().success());
    let mut message = String::new();
    run.stderr.take().unwrap().read_to_string(&mut message).unwrap();
    assert!(message.contains("rank 3") && message.contains("signal 9"), "{message}");

    let there = FilmFile::read(&film).unwrap();
    assert!(there.film.passes() > 0);
    let end = there.about.passes.end().max(there.film.passes()) + 3;
    runs(folder, 3, &format!("{} --resume", line(end)));
    assert_eq!(FilmFile::read(&film).unwrap().about.passes.count(), u64::from(end));
    succeeds(folder, &line(end).replace("a.exr", "b.exr"));
    assert!(fs::read(folder.join("a.exr")).unwrap() == fs::read(folder.join("b.exr")).unwrap());
}

/// Kills the last rank of a job once a file is there; returns what it told.
fn killed(mut job: Command, file: &Path) -> String {
    let mut run = job.stderr(Stdio::piped()).spawn().unwrap();
    wait_for(file);
    let ranks = children(run.id());
    let last = ranks.iter().max().expect("mpirun has children");
    assert!(Command::new("kill").args(["-KILL", &last.to_string()]).status().unwrap().success());
    let mut message = String::new();
    run.stderr.take().unwrap().read_to_string(&mut message).unwrap();
    assert!(!run.wait().unwrap().success());
    assert!(message.contains("signal 9"), "{message}");
    // mpirun does not wait for the ranks that it kills, and their outputs stay locked until the last thread of them is gone.
    let start = Instant::now();
    let holds = |rank: &u32| {
        let locks = fs::read_to_string("/proc/locks").unwrap_or_default();
        locks.split_whitespace().any(|word| word == rank.to_string())
    };
    while ranks.iter().any(holds) {
        assert!(start.elapsed() < Duration::from_secs(60), "ranks outlive their job: {message}");
        std::thread::sleep(Duration::from_millis(10));
    }
    message
}

/// Frames that were done are whole, rank 0 tells which are missing, and these have the bits of one process whoever renders them.
#[test]
fn an_animation_whose_rank_is_killed_goes_on_with_one_rank_fewer() {
    let folder = folder();
    let folder = folder.path();
    let path = "frames = 4000\n[[camera]]\ntime = 0\n[[camera]]\ntime = 400\neye = [0.5, 0.6, 3.5]\n";
    fs::write(folder.join("p.toml"), path).unwrap();
    let line =
        |name: &str| format!("animate scene.toml -o {name}-%04d.png --path p.toml --moving-passes 1 --particles 4");
    for (name, tasks) in [("f", "frames"), ("t", "tiles")] {
        let job = mpirun(folder, 4, &format!("{} --cluster-tasks {tasks}", line(name)));
        let message = killed(job, &folder.join(format!("{name}-0005.png")));
        // "...; --frames A..4000 renders them"
        let first = message.split_once("--frames ").and_then(|(_, rest)| rest.split_once("..4000 renders"));
        let first: usize = first.unwrap_or_else(|| panic!("{message}")).0.parse().unwrap();
        let there = |frame: usize| folder.join(format!("{name}-{frame:04}.png"));
        assert!(first > 0 && (0..first).all(|frame| there(frame).exists()), "{tasks}, {first}: {message}");
        runs(folder, 3, &format!("{} --cluster-tasks {tasks} --frames {first}..{}", line(name), first + 4));
        succeeds(folder, &format!("{} --frames 0..{}", line("one"), first + 4));
        for frame in 0..first + 4 {
            let one = fs::read(folder.join(format!("one-{frame:04}.png"))).unwrap();
            assert!(fs::read(there(frame)).unwrap() == one, "{tasks}: frame {frame} differs");
        }
    }
}

#[test]
fn a_bake_whose_rank_is_killed_goes_on_with_one_rank_fewer() {
    let folders = [folder(), folder()];
    let [own, other] = folders.each_ref().map(|folder| folder.path());
    let line =
        |passes: u32| format!("bake scene.toml -o a.glb --particles 4 --light-pool 0 --density 4 --passes {passes}");
    let film = own.join("a.glb.0.film");
    let message = killed(mpirun(own, 4, &format!("{} --checkpoint 0.1", line(1_000_000))), &film);
    assert!(message.contains("rank 3"), "{message}");
    let there = FilmFile::read(&film).unwrap();
    assert!(there.film.passes() > 0);
    let end = there.about.passes.end().max(there.film.passes()) + 3;
    runs(own, 3, &format!("{} --resume", line(end)));
    succeeds(other, &line(end));
    let maps = [own, other].map(|folder| {
        let files = contents(folder).into_iter();
        files.filter(|(name, _)| name.ends_with(".exr")).collect::<Vec<_>>()
    });
    assert!(!maps[0].is_empty() && maps[0] == maps[1], "the maps differ");
}

/// Ranks of a launcher whose MPI is not the one of the program: each would be alone.
#[test]
fn a_launcher_of_another_mpi_is_told() {
    let folder = folder();
    let mut alone = command(folder.path(), "render scene.toml -o a.exr --passes 1");
    let output = alone.env("PMI_SIZE", "3").env("PMI_RANK", "0").output().unwrap();
    let said = text(&output.stderr);
    assert!(!output.status.success(), "{said}");
    assert!(["mpirun", "3 ranks", "openmpi-bin"].iter().all(|word| said.contains(word)), "{said}");
    assert!(!folder.path().join("a.exr").exists());
}

#[test]
fn an_interrupt_writes_what_there_is() {
    let folder = folder();
    let folder = folder.path();
    let line = "render scene.toml -o a.exr --particles 8 --resolution 96x64 --passes 1000000 --checkpoint 0.2";
    let mut run = mpirun(folder, 3, line);
    // mpirun waits so many seconds before SIGTERM and again before SIGKILL.
    let mut run = run.env("OMPI_MCA_odls_base_sigkill_timeout", "4").stderr(Stdio::piped()).spawn().unwrap();
    wait_for(&folder.join("a.exr.film"));
    kill(&run, "TERM");
    let mut message = String::new();
    run.stderr.take().unwrap().read_to_string(&mut message).unwrap();
    run.wait().unwrap();
    assert!(message.contains("a.exr.film") && message.contains("--resume"), "{message}");
    let film = FilmFile::read(&folder.join("a.exr.film")).unwrap();
    assert!(film.film.passes() > 0 && folder.join("a.exr").exists());
}

#[test]
fn frames_of_an_animation_are_those_of_one_process() {
    let folder = folder();
    let folder = folder.path();
    let path = "times = [0, 1, 2, 3, 4]\n[[camera]]\ntime = 1\n[[camera]]\ntime = 2\neye = [0.5, 0.6, 3.5]\n";
    fs::write(folder.join("p.toml"), path).unwrap();
    let flags = "--path p.toml --moving-passes 2 --particles 8 --exposure auto";
    succeeds(folder, &format!("animate scene.toml -o a-%d.png {flags}"));
    runs(folder, 3, &format!("animate scene.toml -o b-%d.png {flags} --timings t.json"));
    for frame in 0..5 {
        let [a, b] = ["a", "b"].map(|name| fs::read(folder.join(format!("{name}-{frame}.png"))).unwrap());
        assert!(a == b, "frame {frame} differs");
    }
    let times: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("t.json")).unwrap()).unwrap();
    let passes: Vec<_> = times["frames"].as_array().unwrap().iter().map(|f| f["passes"].as_u64().unwrap()).collect();
    assert_eq!(passes, [2, 4, 2, 4, 6]);
    let output = mpirun(folder, 2, &format!("animate scene.toml -o c-%d.png {flags} --ring images")).output().unwrap();
    assert!(!output.status.success() && text(&output.stderr).contains("--ring"), "{}", text(&output.stderr));
}

#[test]
fn tiles_of_an_animation_have_the_frames_of_one_process() {
    let folder = folder();
    let folder = folder.path();
    let path = "times = [0, 1, 2, 3, 4]\n[[camera]]\ntime = 1\n[[camera]]\ntime = 2\neye = [0.5, 0.6, 3.5]\n";
    fs::write(folder.join("p.toml"), path).unwrap();
    let settings = "--preset interactive --particles 8 --compensation exact";
    let flags = format!("--path p.toml --moving-passes 2 --exposure auto {settings}");
    succeeds(folder, &format!("animate scene.toml -o a-%d.png {flags}"));
    for ranks in [2, 3, 5, 8] {
        let tiles = format!("animate scene.toml -o b-%d.png {flags} --cluster-tasks tiles --timings t.json");
        runs(folder, ranks, &tiles);
        for frame in 0..5 {
            let [a, b] = ["a", "b"].map(|name| fs::read(folder.join(format!("{name}-{frame}.png"))).unwrap());
            assert!(a == b, "{ranks} ranks: frame {frame} differs");
        }
    }
    let times: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("t.json")).unwrap()).unwrap();
    let passes: Vec<_> = times["frames"].as_array().unwrap().iter().map(|f| f["passes"].as_u64().unwrap()).collect();
    assert_eq!(passes, [2, 4, 2, 4, 6]);
    assert_eq!(times["master"]["passes"], 10);
    let bytes = |name: &str| -> f64 {
        let times: serde_json::Value = serde_json::from_slice(&fs::read(folder.join(name)).unwrap()).unwrap();
        times["master"]["bytes"].as_f64().unwrap()
    };
    let packed = format!("animate scene.toml -o b-%d.png {flags} --cluster-tasks packed-tiles --timings p.json");
    runs(folder, 3, &packed);
    assert!(bytes("p.json") < 0.1 * bytes("t.json"), "{} and {} bytes", bytes("p.json"), bytes("t.json"));
    // A level of 255 and a bit, here and there.
    let levels = |name: &str| image::open(folder.join(name)).unwrap().to_rgb8().into_raw();
    let differences = levels("a-4.png").into_iter().zip(levels("b-4.png")).map(|(a, b)| u32::from(a.abs_diff(b)));
    let (sum, count) = differences.fold((0, 0), |(sum, count), difference| (sum + difference, count + 1));
    assert!(f64::from(sum) < 0.5 * f64::from(count), "{sum} levels over {count} values");
    // A part needs frames before it.
    runs(folder, 3, &format!("animate scene.toml -o c-%d.png {flags} --cluster-tasks tiles --frames 3..5"));
    assert!(!folder.join("c-0.png").exists() && !folder.join("c-2.png").exists());
    assert!(fs::read(folder.join("a-4.png")).unwrap() == fs::read(folder.join("c-4.png")).unwrap());
    // Near light from other pixels of the class, which is one task, and a shutter that is open while the camera moves.
    let near = flags.replace("exact", "near --shutter 0.5");
    succeeds(folder, &format!("animate scene.toml -o n-%d.png {near}"));
    runs(folder, 3, &format!("animate scene.toml -o m-%d.png {near} --cluster-tasks tiles"));
    for frame in 0..5 {
        let [a, b] = ["n", "m"].map(|name| fs::read(folder.join(format!("{name}-{frame}.png"))).unwrap());
        assert!(a == b, "near light: frame {frame} differs");
    }
    let tiles = format!("animate scene.toml -o d-%d.png {flags} --cluster-tasks tiles");
    for refused in [format!("{tiles} --soft-shadows splat"), format!("{tiles} --light-choice contribution")] {
        let output = mpirun(folder, 2, &refused).output().unwrap();
        let said = text(&output.stderr);
        assert!(!output.status.success() && said.contains("--cluster-tasks"), "{refused}: {said}");
    }
}

#[test]
fn a_bake_has_the_files_of_one_process() {
    let folders = [folder(), folder()];
    let line = "bake scene.toml -o a.glb --passes 3 --particles 8 --light-pool 0 --density 4";
    succeeds(folders[0].path(), line);
    runs(folders[1].path(), 3, line);
    let [one, many] = folders.each_ref().map(|folder| contents(folder.path()));
    assert!(one.len() > 4 && one.keys().eq(many.keys()), "{:?} and {:?}", one.keys(), many.keys());
    for (name, bytes) in &one {
        assert!(many[name] == *bytes, "{name} differs");
    }
    // It goes on from a film of fewer passes.
    let more = line.replace("--passes 3", "--passes 5");
    runs(folders[1].path(), 2, &format!("{line} --resume"));
    runs(folders[1].path(), 4, &format!("{more} --resume"));
    succeeds(folders[0].path(), &more);
    let maps = folders.each_ref().map(|folder| {
        let files = contents(folder.path()).into_iter();
        files.filter(|(name, _)| name.ends_with(".exr")).collect::<Vec<_>>()
    });
    assert!(!maps[0].is_empty() && maps[0] == maps[1]);
}

/// A window on rank 0, whose points the other ranks shade: camera, size, settings, objects and materials as a script changes them.
#[test]
#[cfg(feature = "viewer")]
fn a_window_shows_what_ranks_shade() {
    let (display, folder) = (Display::open(), view::folder());
    let script = |name: &str| {
        format!(
            "window 96x72
panel off
passes 2
screenshot {name}-start.exr
drag right 20,20 32,26          # the view turns
wheel 0.5
set --preset interactive --particles 8 --max-depth 3 --seed 3
window 80x60
passes 4
screenshot {name}-turned.exr
click 40,32                     # the box is chosen
drag left 40,32 52,26           # and moved
passes 3
screenshot {name}-moved.exr
lights on                       # rank 0 renders alone
passes 2
lights off
drop other.toml                 # is refused
passes 3
screenshot {name}-last.png
quit
"
        )
    };
    let flags = "--particles 4 --max-depth 3 --traversal single --preset interactive --validation";
    let show = |name: &str, mut command: Command| {
        let script = if name == "one" { script(name).replace("drop other.toml", "") } else { script(name) };
        fs::write(folder.path().join("script.txt"), script).unwrap();
        command.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY").env("WINIT_X11_SCALE_FACTOR", "1");
        let output = command.output().unwrap();
        let (told, said) = (text(&output.stdout), text(&output.stderr));
        assert!(output.status.success(), "{told}{said}");
        let summary: serde_json::Value = serde_json::from_str(told.lines().last().unwrap()).unwrap();
        assert_eq!((&summary["validation_messages"], &summary["bytes_not_given_back"]), (&0.into(), &0.into()));
        (summary["shared_frames"].as_u64().unwrap(), said)
    };
    let line = format!("view scene.toml --script script.txt {flags}");
    let (shared, _) = show("one", command(folder.path(), &line));
    assert_eq!(shared, 0);
    let same = |name: &str| {
        for part in ["start.exr", "turned.exr", "moved.exr", "last.png"] {
            let [a, b] = ["one", name].map(|name| fs::read(folder.path().join(format!("{name}-{part}"))).unwrap());
            assert!(a == b, "{name}-{part} differs");
        }
    };
    for ranks in [2, 3] {
        let (shared, said) = show("many", mpirun(folder.path(), ranks, &format!("{line} --cluster-tasks tiles")));
        assert!(shared >= 12, "{shared} frames of {ranks} ranks");
        assert!(said.contains("rank 0 renders alone") && said.contains("start again"), "{said}");
        same("many");
    }
    // In few bytes the image is nearly the same.
    let (shared, _) = show("few", mpirun(folder.path(), 3, &line));
    assert!(shared >= 12, "{shared} frames");
    let levels = |name: &str| image::open(folder.path().join(name)).unwrap().to_rgb8().into_raw();
    let differences = levels("one-last.png").into_iter().zip(levels("few-last.png")).map(|(a, b)| a.abs_diff(b));
    let (sum, count) = differences.fold((0, 0), |(sum, count), difference| (sum + u32::from(difference), count + 1));
    assert!(f64::from(sum) < 0.5 * f64::from(count), "{sum} levels over {count} values");
    let output = mpirun(folder.path(), 2, "view").output().unwrap();
    assert!(!output.status.success() && text(&output.stderr).contains("SCENE"), "{}", text(&output.stderr));
}

/// A rank whose device is lost is left out, and others shade its points; after the last one rank 0 goes on alone. Ranks may read files of their own.
#[test]
#[cfg(all(feature = "viewer", target_os = "linux"))]
fn a_window_goes_on_when_ranks_are_lost() {
    let (display, folder, elsewhere) = (Display::open(), view::folder(), view::folder());
    let flags = "--particles 4 --max-depth 3 --traversal single --preset interactive";
    let show = |name: &str, mut command: Command| {
        let script = format!("window 96x72\npanel off\npasses 12\nscreenshot {name}.exr\nquit\n");
        fs::write(folder.path().join("script.txt"), script).unwrap();
        command.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY").env("WINIT_X11_SCALE_FACTOR", "1");
        command.output().unwrap()
    };
    let image = |name: &str| fs::read(folder.path().join(format!("{name}.exr"))).unwrap();
    let line = format!("view scene.toml --script script.txt {flags}");
    assert!(show("one", command(folder.path(), &line)).status.success());
    let line = format!("{line} --cluster-tasks tiles --local-scene");

    // Ranks of which the last one runs under the layer of faults.
    let ranks = |name: &str, sound: usize, faults: &[(usize, i32)]| {
        let log = tempfile::NamedTempFile::new().unwrap();
        let mut command = mpirun(folder.path(), sound, &line);
        command.args([":", "-n", "1"]);
        for (variable, value) in faults::variables(faults, log.path()) {
            command.args(["-x", &format!("{variable}={value}")]);
        }
        command.arg(env!("CARGO_BIN_EXE_lightsum")).args(line.split_whitespace());
        let run = Run::new(show(name, command), log.path());
        let said = text(&run.output.stderr);
        assert!(run.output.status.success() && !said.contains("panicked"), "{said}");
        assert!(image(name) == image("one"), "{name} differs: {said}");
        (run, said)
    };
    let (whole, said) = ranks("all", 1, &[]);
    assert!(!said.contains("lost"), "{said}");
    let submissions = whole.submissions();
    assert!(submissions.len() > 30, "{submissions:?}");
    // The first submissions are uploads; each task has one.
    let lost = [(submissions[11], DEVICE_LOST)];
    let (_, said) = ranks("some", 2, &lost);
    assert!(said.contains("rank 2 on") && said.contains("others shade its points"), "{said}");
    assert!(!said.contains("goes on alone"), "{said}");
    let (_, said) = ranks("none", 1, &lost);
    assert!(said.contains("the device was lost") && said.contains("rank 0 goes on alone"), "{said}");

    // A rank whose files are others is refused.
    let scene = fs::read_to_string(folder.path().join("scene.toml")).unwrap();
    fs::write(elsewhere.path().join("scene.toml"), scene.replace("fov_y = 30.0", "fov_y = 31.0")).unwrap();
    let mut other = mpirun(folder.path(), 1, &line);
    other.args([":", "-n", "1", "-wdir"]).arg(elsewhere.path());
    other.arg(env!("CARGO_BIN_EXE_lightsum")).args(line.split_whitespace());
    let output = show("other", other);
    let said = text(&output.stderr);
    assert!(!output.status.success() && said.contains("error: rank 1 on") && said.contains("--local-scene"), "{said}");
}
