//! Adaptive sampling of light for `bake`.

use std::sync::atomic::{AtomicBool, Ordering};

use lightsum::bake::Lightmap;
use lightsum::gpu::Context;
use lightsum::radiosity::{self, Options, Radiosity, TextureOptions, compute};
use lightsum::settings::Settings;
use lightsum::{Result, Scene};

use crate::args;
use crate::progress::Progress;
use crate::say_aside;
use crate::stop::Stop;

/// The light map of a scene, and the passes of each round.
pub fn light(
    args: &args::Bake,
    (context, scene): (&Context, &Scene),
    settings: &Settings,
    (options, textures): (Options, TextureOptions),
    interrupted: &AtomicBool,
) -> Result<(Lightmap, u32)> {
    compute::check(&options, &textures, &args.options())?;
    let passes = Stop::choose(&args.stop, scene.render.passes).passes().unwrap_or(1);
    let radiosity = Radiosity::new(context, scene, settings.clone())?;
    say_aside(&format!(
        "{} surfaces, trees of height {} with at most {} elements; up to {:.0} MiB beside the scene",
        radiosity.surfaces().len(),
        options.height,
        options.elements,
        radiosity.memory(&options, &textures, &args.options()) as f64 / f64::from(1 << 20)
    ));
    let mut bar = Progress::new();
    let rounds = usize::from(options.height) + 1;
    let mut progress = |now: radiosity::Progress| {
        let text = || format!("round {}, {} points", now.round + 1, now.points);
        bar.show(text, (now.round as f64 + now.done) / rounds.max(now.round + 1) as f64);
        !interrupted.load(Ordering::Relaxed)
    };
    let (solution, times) = radiosity.refine(&options, passes, &mut progress)?;
    bar.finish();
    let light = radiosity.lightmap(&solution, &textures, &args.options())?;
    say_aside(&format!(
        "{} leaves from {} points in {} rounds: {:.1} s of passes, {:.1} s to prepare them, {:.1} s on the host",
        solution.elements(),
        solution.points(),
        solution.rounds.len(),
        times.passes,
        times.prepare,
        times.host
    ));
    Ok((light, passes))
}
