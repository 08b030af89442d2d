//! `--reference`: the same scene by path tracing on the CPU.

use crate::args::Render;
use crate::moment::Moment;
use crate::progress::{Progress, duration};
use crate::render::{Job, metadata};
use crate::stop::watch_for_interrupt;
use lightsum::accel::Bvh;
use lightsum::light::emitters::Emitters;
use lightsum::output::Layers;
use lightsum::path_trace::SpecularPaths;
use lightsum::scene::Scene;
use lightsum::{Result, path_trace};
use std::cell::{Cell, RefCell};
use std::sync::atomic::Ordering;

/// Default of `--spp`.
const DEFAULT_SPP: u32 = 64;

/// Renders and writes the outputs; an interrupt writes the mean of the paths so far.
pub fn run(job: &Job, scene: &Scene, moment: &Moment, args: &Render) -> Result<()> {
    let interrupted = watch_for_interrupt();
    let resolution = job.camera.resolution;
    let options = path_trace::Options {
        resolution,
        samples: args.reference.spp.unwrap_or(DEFAULT_SPP),
        max_depth: job.settings.max_depth,
        max_specular: job.settings.max_specular,
        seed: job.settings.seed,
        specular_paths: args.reference.specular_paths.map_or(SpecularPaths::All, Into::into),
        reflectance: job.settings.reflectance,
    };
    let (progress, samples) = (RefCell::new(Progress::new()), Cell::new(0));
    let told = |fraction: f32| {
        samples.set((fraction * options.samples as f32).round() as u32);
        let done = || format!("{} of {} paths a pixel", samples.get(), options.samples);
        progress.borrow_mut().show(done, f64::from(fraction));
        !interrupted.load(Ordering::Relaxed)
    };
    let color = if moment.moves() {
        path_trace::render_open(|part| moment.at(part), &options, told)?
    } else {
        let bvh = Bvh::build(scene)?;
        let emitters = Emitters::of(scene, scene.emitters_are_lights)?;
        path_trace::render(scene, &bvh, &emitters, &job.camera, &options, told)?
    };
    let progress = progress.into_inner();
    progress.finish();
    let [width, height] = resolution;
    let mut layers = Layers { width, height, color, ..Layers::default() };
    if let Some(crop) = args.output.crop {
        layers = layers.cut(crop);
    }
    let mut metadata = metadata(job, "path tracing on the CPU", String::new());
    metadata.passes = samples.get();
    job.write_outputs(&layers, &metadata)?;
    job.say_where(&format!("{} paths a pixel, path traced in {}", samples.get(), duration(progress.elapsed())));
    Ok(())
}
