//! `shadow-rays`: shadow rays per second of each kernel.

use crate::args::ShadowRays;
use crate::{report, scene};
use lightsum::gpu::{Context, Staging, Timers, download};
use lightsum::pass::TraversalKernels;
use lightsum::pass::layout::DispatchCounts;
use lightsum::pass::visibility::{self, Counts, Inputs, Visibility, Workload};
use lightsum::plan::shade_steps;
use lightsum::scene::Scene;
use lightsum::settings::{Settings, Traversal};
use lightsum::{Engine, Error, Result};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// A scene with its rays, ready for tracing.
pub struct Bench {
    /// The device.
    pub context: Context,
    /// The rays.
    pub workload: Workload,
    /// Pairs that face each other.
    pub segments: u64,
    timers: Timers,
    engine: Engine,
    lights_per_dispatch: Option<u32>,
    only: Option<String>,
}

/// Result of a kernel.
pub struct Measured {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// Pairs that see each other.
    pub visible: u64,
    /// Number of lights that each point sees.
    pub seen: Vec<u32>,
    /// Seconds of each repeat.
    pub times: Vec<f64>,
}

impl Bench {
    /// Loads the scene, renders its shading points and lights.
    pub fn new(args: &ShadowRays, name: &str) -> Result<Bench> {
        if args.area.is_some() && args.dump_rays.is_some() {
            let message =
                "the arrays that are written for Embree hold rays to point lights only; leave it out for them";
            return Err(Error::Setting { name: "--area", message: message.into() });
        }
        let scene: Scene = scene::load(name)?;
        let camera = scene::camera(&scene, args.common.resolution);
        let context = scene::open(&args.common)?;
        let mut engine = Engine::new(&context, &scene, camera, scene::settings(args.lights, args.interleave))?;
        let workload = scene::workload(&context, &mut engine, args.lights, args.area)?;
        if let Some(dir) = &args.dump_rays {
            dump(dir, &scene, &workload)?;
        }
        let timers = Timers::new(&context, 4)?;
        let segments = workload.segments();
        Ok(Bench {
            context,
            workload,
            segments,
            timers,
            engine,
            lights_per_dispatch: args.lights_per_dispatch,
            only: args.only.clone(),
        })
    }

    /// Whether device and scene support clusters.
    pub fn has_clusters(&self) -> bool {
        TraversalKernels::shade(&self.context, Traversal::Auto, false).is_ok_and(|kernels| kernels.cluster.is_some())
            && self.engine.device_scene().wide_nodes.is_some()
    }

    /// The traversals that this device can run.
    pub fn traversals(&self) -> Vec<Traversal> {
        let cluster = self.has_clusters();
        let all = [(Traversal::Single, true), (Traversal::Cluster, cluster)];
        let wanted = |t: Traversal| self.only.as_deref().is_none_or(|only| only == name(t));
        all.into_iter().filter(|&(t, able)| able && wanted(t)).map(|(t, _)| t).collect()
    }

    /// Traces the workload once to warm up and then `repeats` times.
    pub fn measure(&self, traversal: Traversal, repeats: u32) -> Result<Measured> {
        let kernel = name(traversal);
        let kernels = self.workload.kernels(&self.context, traversal)?;
        self.trace(kernels, kernel, repeats).map(|(measured, _)| measured)
    }

    /// Traversal steps of the clusters of the workload, and the number of pairs dropped before any ray was traced.
    pub fn count(&self) -> Result<(Counts, u32)> {
        let kernels = self.workload.counting_kernels(&self.context)?;
        let (_, pass) = self.trace(kernels, "counters", 0)?;
        let words = download::<u32>(&self.context, &pass.counters)?;
        let culled = download::<DispatchCounts>(&self.context, &pass.work)?[0].culled;
        Ok((Counts::new([words[0], words[1], words[2], words[3], words[4], words[5]]), culled))
    }

    fn trace(&self, kernels: TraversalKernels, kernel: &'static str, repeats: u32) -> Result<(Measured, Visibility)> {
        let mut staging = Staging::new();
        let defaults = Settings::default();
        let lights_per_dispatch = self.lights_per_dispatch.unwrap_or(defaults.lights_per_dispatch);
        let settings = Settings { rounds: 64, lights_per_dispatch, ..defaults };
        let pass = Visibility::new(
            &self.context,
            &mut staging,
            &Inputs { kernels, scene: self.engine.device_scene(), settings: &settings, workload: &self.workload },
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
            let steps = u64::from(settings.rounds) * u64::from(shade_steps(lights_per_dispatch, settings.loop_budget));
            return Err(Error::Unfinished { pass: "visibility", rays: lost, steps });
        }
        let seen = download::<u32>(&self.context, &pass.visible)?;
        let visible = seen.iter().map(|&n| u64::from(n)).sum();
        Ok((Measured { kernel, visible, seen, times }, pass))
    }
}

fn name(traversal: Traversal) -> &'static str {
    match traversal {
        Traversal::Single => "single",
        _ => "cluster",
    }
}

/// Runs the command.
pub fn run(args: &ShadowRays) -> Result<()> {
    scene::check(&args.scenes)?;
    for name in &args.scenes {
        let bench = Bench::new(args, name)?;
        let environment = report::environment(bench.context.info());
        let expected = args.verify.then(|| visibility::reference(bench.engine.bvh(), &bench.workload));
        for traversal in bench.traversals() {
            let measured = bench.measure(traversal, args.common.repeats)?;
            let differing = |seen: &Vec<u32>| seen.iter().zip(&measured.seen).filter(|(a, b)| a != b).count();
            bench.tell(args, name, &measured, expected.as_ref().map(differing), &environment)?;
        }
        if args.counters && bench.has_clusters() {
            bench.tell_counts(args, name, &environment)?;
        }
    }
    Ok(())
}

impl Bench {
    /// Prints a measurement; `differing`: number of points whose number of visible lights differs from the oracle's.
    fn tell(
        &self,
        args: &ShadowRays,
        name: &str,
        measured: &Measured,
        differing: Option<usize>,
        environment: &report::Fields,
    ) -> Result<()> {
        let seconds = report::median(&measured.times);
        let rate = self.segments as f64 / seconds * 1e-6;
        let receivers = self.workload.receivers.len();
        if args.common.json {
            let line = json!({
                "mode": "shadow-rays",
                "scene": name,
                "resolution": args.common.resolution,
                "repeats": measured.times.len(),
                "kernel": measured.kernel,
                "receivers": receivers,
                "lights": self.workload.lights.len(),
                "area": args.area,
                "segments": self.segments,
                "visible": measured.visible,
                "differing_receivers": differing,
                "median_seconds": seconds,
                "spread": report::spread(&measured.times),
                "mega_segments_per_second": rate,
            });
            return report::print_json(line, environment);
        }
        let verified = differing.map_or(String::new(), |n| format!("  {n} of {receivers} receivers differ"));
        report::say(&format!(
            "{name:40} {:8} {:10} segments {:10} visible {seconds:8.4} s  {rate:8.2} M/s  +-{}{verified}",
            measured.kernel,
            self.segments,
            measured.visible,
            report::percent(report::spread(&measured.times))
        ))
    }

    /// Counts the traversal steps of the clusters, and prints them.
    fn tell_counts(&self, args: &ShadowRays, name: &str, environment: &report::Fields) -> Result<()> {
        let (counts, culled) = self.count()?;
        let each = |n: u32| f64::from(n) / f64::from(counts.pairs.max(1));
        if args.common.json {
            let line = json!({
                "mode": "shadow-rays",
                "scene": name,
                "kernel": "counters",
                "pairs": counts.pairs,
                "culled_pairs": culled,
                "rays": counts.rays,
                "nodes_per_pair": each(counts.nodes),
                "children_per_pair": each(counts.children),
                "leaves_per_pair": each(counts.leaves),
                "triangles_per_pair": each(counts.triangles),
            });
            return report::print_json(line, environment);
        }
        report::say(&format!(
            "{name:40} counters {} pairs of a cluster and a light, {culled} more culled; a pair: {:.1} rays, {:.2} nodes, \
             {:.2} children, {:.2} leaves, {:.2} triangles",
            counts.pairs,
            each(counts.rays),
            each(counts.nodes),
            each(counts.children),
            each(counts.leaves),
            each(counts.triangles)
        ))
    }
}

/// Writes the arrays.
fn dump(dir: &Path, scene: &Scene, workload: &Workload) -> Result<()> {
    std::fs::create_dir_all(dir).map_err(Error::io("creating", dir))?;
    let write = |name: &str, bytes: Vec<u8>| lightsum::output::write_file(&dir.join(name), &[&bytes]);
    let floats = |v: &[glam::Vec3]| v.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let indices = scene.triangles.iter().flat_map(|t| t.vertices).flat_map(u32::to_le_bytes).collect();
    write("vertices.f32", floats(&scene.positions))?;
    write("indices.u32", indices)?;
    write("receivers.f32", floats(&workload.receivers))?;
    write("normals.f32", floats(&workload.normals))?;
    write("lights.f32", floats(&workload.lights))
}
