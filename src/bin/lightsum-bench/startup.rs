//! `startup`: time from process start to the second pass.
//!
//! Each measurement is a process of its own, since a driver keeps everything that it has loaded and compiled until the
//! process ends. Two processes share a folder for caches: the first finds it empty, the second finds the files that the
//! first wrote, the pipeline cache and the driver's own cache on disk. Some drivers, lavapipe among them, compile at
//! the first dispatch rather than when pipelines are made; then the first pass takes that time.

use crate::args::{Startup, StartupOnce};
use crate::report::{self, Fields, Table, milliseconds, percent};
use crate::scene;
use crate::scratch::Scratch;
use lightsum::accel::Bvh;
use lightsum::gpu::{Context, ContextOptions};
use lightsum::settings::Settings;
use lightsum::{Error, Renderer, Result};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// The timed steps in order: key and label in the table.
const STEPS: [(&str, &str); 6] = [
    ("load", "load the scene"),
    ("device", "open the device"),
    ("bvh", "build the BVH"),
    ("prepare", "make the renderer: pipelines, BVH, upload"),
    ("first_pass", "first pass"),
    ("second_pass", "second pass"),
];

/// Variables that tell drivers where to keep their caches: Mesa, NVIDIA, any other.
const CACHE_VARIABLES: [&str; 3] = ["MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH", "XDG_CACHE_HOME"];

/// For each step, its seconds in each repeat.
type Times = [Vec<f64>; STEPS.len()];

/// Runs the command.
pub fn run(args: &Startup) -> Result<()> {
    scene::check(&args.scenes)?;
    let context = scene::open(&args.common)?;
    let device = context.info().index;
    let environment = report::environment(context.info());
    drop(context);
    if !args.common.json {
        report::print_environment(&environment)?;
    }
    for scene in &args.scenes {
        let (mut cold, mut warm) = (Times::default(), Times::default());
        let mut settings = Value::Null;
        for repeat in 0..=args.common.repeats {
            let caches = Scratch::new()?;
            for times in [&mut cold, &mut warm] {
                let (once, used) = start(scene, args.common.resolution, device, caches.path())?;
                settings = used;
                // The first run of all brings program and driver into the system's file cache.
                if repeat > 0 {
                    times.iter_mut().zip(once).for_each(|(all, seconds)| all.push(seconds));
                }
            }
        }
        if args.common.json {
            let line = json!({
                "mode": "startup",
                "scene": scene,
                "resolution": args.common.resolution,
                "settings": settings,
                "repeats": args.common.repeats,
                "cold": summaries(&cold),
                "warm": summaries(&warm),
            });
            report::print_json(line, &environment)?;
        } else {
            print(scene, args.common.resolution, &cold, &warm)?;
        }
    }
    Ok(())
}

/// Runs a process that keeps all its caches in `caches`; returns its times and its settings.
fn start(scene: &str, [width, height]: [u32; 2], device: usize, caches: &Path) -> Result<([f64; STEPS.len()], Value)> {
    let program = std::env::current_exe().map_err(Error::io("finding", Path::new("lightsum-bench")))?;
    let mut command = Command::new(&program);
    command.args(["startup-once", "--scene", scene, "--resolution", &format!("{width}x{height}")]);
    command.args(["--device", &device.to_string(), "--pipeline-cache"]).arg(caches.join("pipelines.bin"));
    CACHE_VARIABLES.iter().for_each(|name| _ = command.env(name, caches));
    let output = command.output().map_err(Error::io("running", &program))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        let message = said.trim().trim_start_matches("error: ").to_owned();
        return Err(Error::Resource { name: format!("start with {scene} ({})", output.status), message });
    }
    if !said.is_empty() {
        report::say_aside(said.trim_end());
    }
    let line: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let mut times = [0.0; STEPS.len()];
    for (time, (step, _)) in times.iter_mut().zip(STEPS) {
        let message = || format!("printed no time of {step}");
        *time = line.get(step).and_then(Value::as_f64).ok_or_else(|| Error::file(&program, message()))?;
    }
    Ok((times, line.get("settings").cloned().unwrap_or_default()))
}

/// Runs the command `startup-once`.
pub fn once(args: &StartupOnce) -> Result<()> {
    let mut times = Fields::new();
    let mut clock = Instant::now();
    let mut done = |step: &str| {
        times.insert(step.into(), clock.elapsed().as_secs_f64().into());
        clock = Instant::now();
    };
    let scene = scene::load(&args.scene)?;
    let camera = scene::camera(&scene, args.resolution);
    let settings = Settings::default().with_scene_defaults(&scene.render);
    let used = report::settings(&settings);
    done("load");
    let context = Context::headless(&ContextOptions {
        device: args.device.clone(),
        pipeline_cache: Some(args.pipeline_cache.clone()),
        ..ContextOptions::default()
    })?;
    done("device");
    drop(Bvh::build(&scene)?);
    done("bvh");
    let mut renderer = Renderer::with_context(context, scene, camera, settings)?;
    done("prepare");
    renderer.pass()?;
    done("first_pass");
    renderer.pass()?;
    done("second_pass");
    times.insert("settings".into(), used);
    report::say(&Value::Object(times).to_string())
}

fn summaries(times: &Times) -> Fields {
    STEPS.iter().zip(times).map(|((step, _), seconds)| ((*step).to_owned(), report::summary(seconds))).collect()
}

fn print(scene: &str, [width, height]: [u32; 2], cold: &Times, warm: &Times) -> Result<()> {
    report::say("")?;
    report::say(&format!("{scene}: {width}x{height}"))?;
    let table = Table::head(&[("step", 42), ("cold ms", 8), ("+-", 5), ("warm ms", 8), ("+-", 5)])?;
    for ((_, title), (cold, warm)) in STEPS.iter().zip(cold.iter().zip(warm)) {
        let cells = [cold, warm].map(|t| [milliseconds(report::median(t)), percent(report::spread(t))]);
        table.row(&[&[(*title).to_owned()], &cells.concat()[..]].concat())?;
    }
    Ok(())
}
