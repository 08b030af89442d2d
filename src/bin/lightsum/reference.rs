//! `--reference`: the same scene by path tracing on the CPU.

use crate::args::Render;
use crate::progress::Progress;
use crate::render::{Job, metadata, watch_for_interrupt};
use lightsum::accel::Bvh;
use lightsum::light::emitters::Emitters;
use lightsum::output::Layers;
use lightsum::scene::Scene;
use lightsum::{Result, path_trace};
use std::sync::Mutex;
use std::sync::atomic::Ordering;

/// Paths for each pixel unless `--spp` says otherwise.
const DEFAULT_SPP: u32 = 64;

/// Renders and writes the outputs.
pub fn run(job: &Job, scene: &Scene, args: &Render) -> Result<()> {
    let samples = args.reference.spp.unwrap_or(DEFAULT_SPP);
    let bvh = Bvh::build(scene)?;
    let emitters = Emitters::of(scene, scene.emitters_are_lights)?;
    let options = path_trace::Options {
        resolution: job.camera.resolution,
        samples,
        max_depth: job.settings.max_depth,
        seed: job.settings.seed,
        specular_paths: args.reference.specular_paths,
    };
    let interrupted = watch_for_interrupt();
    let progress = Mutex::new(Progress::new());
    let color = path_trace::render(scene, &bvh, &emitters, &job.camera, &options, |fraction: f32| {
        // A lock that is poisoned or taken only costs one update of the display.
        if let Ok(mut progress) = progress.try_lock() {
            let done = || format!("path tracing, {samples} paths a pixel: {:.0} %", 100.0 * fraction);
            progress.show(done, f64::from(fraction));
        }
        !interrupted.load(Ordering::Relaxed)
    })?;
    if let Ok(progress) = progress.lock() {
        progress.finish();
    }
    let [width, height] = job.camera.resolution;
    let layers = Layers { width, height, color, ..Layers::default() };
    let mut metadata = metadata(job, "path tracing on the CPU", String::new());
    metadata.passes = samples;
    job.write_outputs(&layers, &metadata)?;
    job.say_where(&format!("path traced with {samples} paths a pixel"));
    Ok(())
}
