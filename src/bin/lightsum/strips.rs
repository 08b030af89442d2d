//! An image that is too large for the device, rendered strip by strip.

use std::sync::atomic::{AtomicBool, Ordering};

use lightsum::output::{Layers, Statistics};
use lightsum::standalone::{RenderOptions, Renderer};
use lightsum::{Error, Result, tiles};

use crate::args::Render;
use crate::progress::{Progress, duration};
use crate::render::{Job, count, metadata};
use crate::say_aside;
use crate::stop::Stop;

/// Renders the strips one after the other, and writes the requested files. If the device is lost it is opened once more, and what was rendered
/// of the strip begins anew.
pub fn run(
    job: &Job,
    mut renderer: Renderer,
    args: &Render,
    (options, interrupted): (&RenderOptions, &AtomicBool),
) -> Result<()> {
    let [width, height] = job.camera.resolution;
    let too_large = |name: &'static str| Error::Setting {
        name,
        message: format!("{width}x{height} is too large for the device at once, and strips take --passes alone"),
    };
    let keys = &renderer.scene().render;
    let excluded = [
        (keys.time.is_some(), "--time"),
        (keys.target_error.is_some(), "--target-error"),
        (args.stop.resume, "--resume"),
        (args.output.export_lights.is_some(), "--export-lights"),
        (args.output.preview.is_some(), "--preview"),
        (args.output.display.is_some(), "--display"),
    ];
    if let Some((_, name)) = excluded.into_iter().find(|(given, _)| *given) {
        return Err(too_large(name));
    }
    let passes = Stop::choose(keys).passes().ok_or_else(|| too_large("--passes"))?;
    let strips = renderer.strips().to_vec();
    log::info!("{width}x{height} is rendered in {} strips", strips.len());
    let total = passes * strips.len() as u32;
    let mut progress = Progress::new();
    let (mut layers, mut opened_again) = (Layers::default(), false);
    loop {
        let rendered = tiles::render(&mut renderer, &strips, passes, &mut layers, |done| {
            progress.show(
                || format!("strip {} of {}", done / passes + 1, strips.len()),
                f64::from(done) / f64::from(total),
            );
            !interrupted.load(Ordering::Relaxed)
        });
        match rendered {
            Ok(true) => break,
            Ok(false) => return Err(Error::Interrupted),
            Err(error @ Error::DeviceLost { .. }) if !opened_again => log::warn!("{error}; opening it once more"),
            Err(error) => return Err(error),
        }
        opened_again = true;
        let options = RenderOptions { traversal: Some(renderer.provenance().traversal), ..options.clone() };
        renderer = Renderer::new(renderer.into_scene(), job.camera, job.settings.clone(), &options)?;
        let done = strips.iter().filter(|strip| strip.origin[1] < layers.height).count();
        say_aside(&format!("the device was lost; rendering goes on after {done} of {} strips", strips.len()));
    }
    progress.finish();
    job.add_surfaces(&mut layers, &renderer);
    let statistics = renderer.statistics();
    let mut metadata = metadata(job, &statistics.device, statistics.driver.clone());
    metadata.passes = passes;
    let mut outcome = job.write_outputs(&layers, &metadata);
    if let Some(path) = &args.output.stats {
        let resolution = job.camera.resolution;
        let statistics = Statistics { scene: job.name.clone(), resolution, passes, error_estimate: None, ..statistics };
        outcome = outcome.and(statistics.write(path));
    }
    outcome?;
    let what = format!("{} in {} strips, rendered in {}", count(passes), strips.len(), duration(progress.elapsed()));
    job.say_where(&what);
    Ok(())
}
