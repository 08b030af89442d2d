//! Adaptive sampling of light for `bake`: rounds that grow the trees, then passes over all samples.

use std::time::Instant;

use lightsum::gpu::Context;
use lightsum::output::State;
use lightsum::radiosity::{Growth, Options, Part, ROUND_PASSES, Radiosity, TextureOptions, compute};
use lightsum::settings::Settings;
use lightsum::{Result, Scene};

use crate::args;
use crate::bake::write;
use crate::checkpoint::Checkpoints;
use crate::parts::{Job, States, View, part_path};
use crate::progress::Progress;
use crate::say_aside;
use crate::stop::{Clock, Stop};

/// Bakes a scene adaptively.
pub fn run(
    args: &args::Bake,
    (context, scene): (&Context, &Scene),
    settings: &Settings,
    (options, textures): (Options, TextureOptions),
    (clock, states): (&Clock, &mut States),
) -> Result<()> {
    let start = Instant::now();
    compute::check(&options, &textures, &args.options())?;
    let stop = Stop::choose(&scene.render);
    let passes = stop.passes().map_or(ROUND_PASSES, |passes| passes.min(ROUND_PASSES));
    let radiosity = Radiosity::new_unless(context, scene, settings.clone(), &|| clock.is_over())
        .map_err(|error| clock.tell(error))?;
    say_aside(&format!(
        "{} surfaces, trees of height {} with at most {} elements; up to {:.0} MiB beside the scene",
        radiosity.surfaces().len(),
        options.height,
        options.elements,
        radiosity.memory(&options, &textures, &args.options()) as f64 / f64::from(1 << 20)
    ));
    let mut progress = Progress::new();
    let mut growth = Growth::new(&radiosity, &options, passes)?;
    let path = State::path_for(&args.output);
    if let Some(state) = states.earlier(&path)? {
        state.check(&path, growth.fingerprint(), [state.width, state.height], &radiosity.provenance())?;
        growth.go_on(&state)?;
        log::info!("{}: going on after {} rounds", path.display(), growth.rounds());
    }
    // Of all work, where its end is known.
    let share = stop.passes().map_or(1.0, |all| f64::from(passes) / f64::from(all));
    if let Err(error) = grow(&mut growth, states.of(&path), (clock, share, options.height), &mut progress) {
        states.rescue(&path, &growth, Some(&error));
        return Err(error);
    }
    let broken_off = clock.is_interrupted();
    let mut solution = match growth.solution() {
        Ok(solution) => solution,
        Err(error) => return Err(clock.tell(error)),
    };
    if broken_off {
        states.rescue(&path, &growth, None);
    } else {
        states.keep(&path, &growth)?;
    }
    let times = growth.times();
    say_aside(&format!(
        "{} leaves from {} points in {} rounds{}: {:.1} s of passes, {:.1} s to prepare them, {:.1} s on the host",
        solution.elements(),
        solution.points(),
        solution.rounds.len(),
        if growth.is_done() { "" } else { ", which were broken off" },
        times.passes,
        times.prepare,
        times.host
    ));

    let parts: Vec<Part> = match growth.is_done() && stop.passes().is_none_or(|all| all > passes) {
        true => radiosity.parts(&solution),
        false => Vec::new(),
    };
    let views = parts.iter().enumerate();
    let views = views.map(|(i, part)| View { points: part.len(), state: part_path(&args.output, i) }).collect();
    let mut job = Job::new(views, clock, states, &mut progress, share);
    let images = job.run(passes, &|i, last| radiosity.renderer(&parts[i], passes, last))?;
    let (least, error) = (job.passes, job.error);
    for (part, image) in parts.iter().zip(&images) {
        if let Some((image, more)) = image {
            part.add(&mut solution, passes, image, *more);
        }
    }
    if clock.is_interrupted() && !broken_off {
        states.rescue(&path, &growth, None);
    }
    let all = if parts.is_empty() || images.contains(&None) { passes } else { least };
    let light = radiosity.lightmap(&solution, &textures, &args.options())?;
    write(args, (context, scene), settings, &light, (all, error), start)?;
    if !clock.is_interrupted() {
        states.remove();
    }
    Ok(())
}

/// Runs the rounds until the trees have grown, or until the time is over and there is some light. `share`: of all work.
fn grow(
    growth: &mut Growth,
    states: &mut Checkpoints,
    (clock, share, height): (&Clock, f64, u8),
    progress: &mut Progress,
) -> Result<()> {
    let rounds = usize::from(height) + 1;
    while !growth.is_done() {
        let any = growth.has_light();
        let over = || clock.is_interrupted() || any && clock.is_over();
        if over() || !growth.pass(&over)? {
            break;
        }
        states.after_pass(growth);
        let now = growth.progress();
        let text = || format!("round {}, {} points", now.round + 1, now.points);
        let grown = share * (now.round as f64 + now.done) / rounds.max(now.round + 1) as f64;
        progress.show(text, clock.fraction().map_or(grown, |late| late.max(grown)));
    }
    Ok(())
}
