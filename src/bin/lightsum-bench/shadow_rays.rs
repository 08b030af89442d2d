//! `shadow-rays`: how many shadow rays a second each kernel traces.

use crate::args::ShadowRays;
use crate::{report, scene};
use lightsum::accel::Bvh;
use lightsum::gpu::{Context, Staging, Timers, download};
use lightsum::light::emitters::Emitters;
use lightsum::pass::visibility::{Visibility, Workload};
use lightsum::pass::{Forms, Kernels};
use lightsum::scene::Scene;
use lightsum::scene_buffers::SceneBuffers;
use lightsum::settings::{Settings, Traversal};
use lightsum::{Engine, Error, Result};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// A scene with its rays, ready to be traced.
pub struct Bench {
    /// The device.
    pub context: Context,
    /// The rays.
    pub workload: Workload,
    /// Pairs that face each other.
    pub segments: u64,
    timers: Timers,
    scene_buffers: SceneBuffers,
    bvh: Bvh,
    kernels: Kernels,
}

/// What a kernel did.
pub struct Measured {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// Pairs that see each other.
    pub visible: u64,
    /// Seconds of each repeat.
    pub times: Vec<f64>,
}

impl Bench {
    /// Loads the scene, renders its receivers and lights.
    pub fn new(args: &ShadowRays, name: &str) -> Result<Bench> {
        let scene: Scene = scene::load(name)?;
        let camera = scene::camera(&scene, args.common.resolution);
        let context = scene::open(&args.common)?;
        let mut engine = Engine::new(&context, &scene, camera, scene::settings(args.lights))?;
        let workload = scene::workload(&context, &mut engine, args.lights)?;
        if let Some(dir) = &args.dump_rays {
            dump(dir, &scene, &workload)?;
        }
        let bvh = Bvh::build(&scene)?;
        let emitters = Emitters::of(&scene, scene.emitters_are_lights)?;
        let kernels = Kernels::new(&context, Traversal::Auto)?;
        let mut staging = Staging::new();
        let scene_buffers =
            SceneBuffers::new(&context, &mut staging, &scene, &bvh, &emitters, kernels.shade.cluster.is_some())?;
        context.submit_and_wait("uploading the scene", None, |rec| staging.record(rec))?;
        let timers = Timers::new(&context, 4)?;
        let segments = workload.segments();
        Ok(Bench { context, workload, segments, timers, scene_buffers, bvh, kernels })
    }

    /// The kernels that this device can run.
    pub fn traversals(&self) -> Vec<Traversal> {
        let cluster = self.kernels.shade.cluster.is_some() && self.scene_buffers.wide_nodes.is_some();
        if cluster { vec![Traversal::Single, Traversal::Cluster] } else { vec![Traversal::Single] }
    }

    /// Traces the workload once to warm up and then `repeats` times.
    pub fn measure(&self, traversal: Traversal, repeats: u32) -> Result<Measured> {
        let kernel = match traversal {
            Traversal::Single => "single",
            _ => "cluster",
        };
        let forms = Forms::visibility(&self.context, traversal)?;
        let mut staging = Staging::new();
        let settings = Settings { rounds: 64, ..Settings::default() };
        let pass = Visibility::new(
            &self.context,
            &self.kernels,
            &forms,
            &mut staging,
            &self.scene_buffers,
            &self.bvh,
            &settings,
            &self.workload,
        )?;
        self.context.submit_and_wait("uploading the rays", None, |rec| staging.record(rec))?;
        let mut times = Vec::new();
        for repeat in 0..=repeats {
            let start = Instant::now();
            self.context
                .submit_and_wait("tracing", Some(&self.timers), |rec| rec.scope("rays", |rec| pass.record(rec)))?;
            let wall = start.elapsed().as_secs_f64();
            let seconds = self.timers.read()?.first().map_or(wall, |(_, seconds)| *seconds);
            if repeat > 0 {
                times.push(seconds);
            }
        }
        let lost = download::<u32>(&self.context, &pass.status)?[0];
        if lost > 0 {
            return Err(Error::Unfinished { pass: "visibility", rays: lost, steps: 0 });
        }
        let visible = download::<u32>(&self.context, &pass.visible)?.iter().map(|&n| u64::from(n)).sum();
        Ok(Measured { kernel, visible, times })
    }
}

/// Runs the command.
pub fn run(args: &ShadowRays) -> Result<()> {
    scene::check(&args.scenes)?;
    for name in &args.scenes {
        let bench = Bench::new(args, name)?;
        let environment = report::environment(bench.context.info());
        for traversal in bench.traversals() {
            let measured = bench.measure(traversal, args.common.repeats)?;
            let seconds = report::median(&measured.times);
            let rate = bench.segments as f64 / seconds * 1e-6;
            if args.common.json {
                let line = json!({
                    "mode": "shadow-rays",
                    "scene": name,
                    "resolution": args.common.resolution,
                    "repeats": measured.times.len(),
                    "kernel": measured.kernel,
                    "receivers": bench.workload.receivers.len(),
                    "lights": bench.workload.lights.len(),
                    "segments": bench.segments,
                    "visible": measured.visible,
                    "median_seconds": seconds,
                    "spread": report::spread(&measured.times),
                    "mega_segments_per_second": rate,
                });
                report::print_json(line, &environment)?;
            } else {
                report::say(&format!(
                    "{name:40} {:8} {:10} segments {:10} visible {seconds:8.4} s  {rate:8.2} M/s  +-{}",
                    measured.kernel,
                    bench.segments,
                    measured.visible,
                    report::percent(report::spread(&measured.times))
                ))?;
            }
        }
    }
    Ok(())
}

/// Writes the arrays, each beside its place first.
fn dump(dir: &Path, scene: &Scene, workload: &Workload) -> Result<()> {
    std::fs::create_dir_all(dir).map_err(Error::io("creating", dir))?;
    let write = |name: &str, bytes: Vec<u8>| {
        let (path, beside) = (dir.join(name), dir.join(format!("{name}.tmp")));
        std::fs::write(&beside, bytes).map_err(Error::io("writing", &beside))?;
        std::fs::rename(&beside, &path).map_err(Error::io("renaming", &path))
    };
    let floats = |v: &[glam::Vec3]| v.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let indices = scene.triangles.iter().flat_map(|t| t.vertices).flat_map(u32::to_le_bytes).collect();
    write("vertices.f32", floats(&scene.positions))?;
    write("indices.u32", indices)?;
    write("receivers.f32", floats(&workload.receivers))?;
    write("normals.f32", floats(&workload.normals))?;
    write("lights.f32", floats(&workload.lights))
}
