//! `lightsum bake`: light of a scene kept in textures.

use std::time::Instant;

use lightsum::bake::files::{self, Form};
use lightsum::bake::{Bake, Lightmap};
use lightsum::gpu::Context;
use lightsum::output::{self, Layers, Metadata, State};
use lightsum::settings::{RenderDefaults, Settings, Traversal};
use lightsum::standalone::{self, RenderOptions};
use lightsum::{Error, Result, Scene, scene};

use crate::args;
use crate::checkpoint::earlier_traversal;
use crate::parts::{Job, States, View, part_path};
use crate::play;
use crate::progress::{Progress, duration};
use crate::render::{SOFTWARE, pipeline_cache};
use crate::stop::{Clock, Stop, watch_for_interrupt};
use crate::{effect, say, say_aside};

/// Runs the command.
pub fn run(args: &args::Bake) -> Result<()> {
    output::check_writable(&args.output)?;
    let state = State::path_for(&args.output);
    let _claim = output::claim([args.output.as_path(), &state])?;
    let (scene, settings) = prepare(args)?;
    output::check_apart([args.output.as_path(), &state], &scene.files)?;
    let interrupted = watch_for_interrupt();
    let earlier = [state, part_path(&args.output, 0)];
    let options = options(args, if args.stop.resume { earlier_traversal(&earlier)? } else { None });
    let mut opened = standalone::open(settings, &options)?;
    let clock = Clock::start(Stop::choose(&scene.render), &interrupted);
    let (mut states, mut opened_again) = (States::new(args), false);
    loop {
        let (context, settings) = opened;
        let done = match args.adaptive.options() {
            Some(adaptive) => {
                crate::radiosity::run(args, (&context, &scene), &settings, adaptive, (&clock, &mut states))
            }
            None => uniformly(args, (&context, &scene), &settings, (&clock, &mut states)),
        };
        match done {
            Err(error @ Error::DeviceLost { .. }) if !opened_again => {
                log::warn!("{error}; opening it once more, and going on from the latest checkpoints");
            }
            Err(error @ Error::DeviceLost { .. }) => {
                states.tell();
                return Err(error);
            }
            done => return done,
        }
        opened_again = true;
        // Its kernels go with it before another is opened.
        drop(context);
        let options = RenderOptions { traversal: Some(settings.traversal), ..options.clone() };
        opened = standalone::open(settings, &options).inspect_err(|_| states.tell())?;
    }
}

/// Bakes a scene with texels of one size.
fn uniformly(
    args: &args::Bake,
    (context, scene): (&Context, &Scene),
    settings: &Settings,
    (clock, states): (&Clock, &mut States),
) -> Result<()> {
    let start = Instant::now();
    let bake = Bake::new_unless(context, scene, settings.clone(), args.options(), &|| clock.is_over())
        .map_err(|error| clock.tell(error))?;
    let charts = bake.charts();
    let [device, host] = bake.memory()?.map(|bytes| bytes as f64 / f64::from(1 << 20));
    say_aside(&format!(
        "{} charts of {:.3} texels a unit, {} texels on {}, laid out in {}; \
         {device:.0} MiB of the device and {host:.0} MiB for the maps",
        charts.count,
        charts.density,
        bake.texels(),
        maps(&charts.pages),
        duration(start.elapsed()),
    ));

    let start = Instant::now();
    let state_path = |i: usize| match bake.batches().len() {
        1 => State::path_for(&args.output),
        _ => part_path(&args.output, i),
    };
    let views = bake.batches().iter().enumerate();
    let views = views.map(|(i, batch)| View { points: batch.texels(), state: state_path(i) }).collect();
    let mut progress = Progress::new();
    let mut job = Job::new(views, clock, states, &mut progress, 0.0);
    let images = job.run(0, &|i, last| bake.renderer(i, last))?;
    if images.iter().all(Option::is_none) {
        return Err(Error::Interrupted);
    }
    // Unless some have not begun.
    let Some(images) = images.into_iter().collect::<Option<Vec<_>>>() else { return Ok(()) };
    let (passes, error) = (job.passes, job.error);
    let images: Vec<Layers> = images.into_iter().map(|(image, _)| image).collect();
    let light = bake.finish(&images, passes)?;
    write(args, (context, scene), settings, &light, (passes, error), start)?;
    if !clock.is_interrupted() {
        states.remove();
    }
    Ok(())
}

/// Reads the scene, and checks the flags.
pub fn prepare(args: &args::Bake) -> Result<(Scene, Settings)> {
    let mut scene = scene::load_with(&args.scene, &args.reading.options())?;
    play::pose(&mut scene, &args.scene, args.pose.animation.as_deref(), args.pose.at)?;
    let given = args.keys.override_scene(&mut scene, "bake")?;
    let settings = bake_settings(args, &scene, &given);
    effect::warn(&args.keys.typed(), &settings, &scene);
    settings.validate()?;
    args.options().validate()?;
    Ok((scene, settings))
}

/// How to render. `traversal`: the kernel where the flags leave it open; `None`: the faster one.
pub fn options(args: &args::Bake, traversal: Option<Traversal>) -> RenderOptions {
    RenderOptions {
        traversal,
        device: args.device.device.clone().unwrap_or_default(),
        validation: args.device.validation,
        max_memory: args.device.max_device_memory,
        pipeline_cache: pipeline_cache(),
        ..RenderOptions::default()
    }
}

/// Provenance of the maps of a bake, without device and passes.
pub fn metadata(scene: &Scene, settings: &Settings) -> Metadata {
    Metadata {
        software: SOFTWARE.into(),
        scene: scene.name.clone(),
        settings: serde_json::to_string(settings).unwrap_or_default(),
        seed: settings.seed,
        ..Metadata::default()
    }
}

/// Writes the files of a bake that began at `start`.
pub fn write(
    args: &args::Bake,
    (context, scene): (&Context, &Scene),
    settings: &Settings,
    light: &Lightmap,
    (passes, error): (u32, Option<f32>),
    start: Instant,
) -> Result<()> {
    let info = context.info();
    let metadata = Metadata {
        passes,
        device: info.name.clone(),
        driver: format!("{} {}", info.driver, info.driver_version),
        ..metadata(scene, settings)
    };
    let form = match args.unlit {
        true => Form::Unlit {
            exposure: args.exposure.or(scene.render.exposure).unwrap_or_default(),
            tonemap: args.tonemap.into(),
        },
        false => Form::Lit,
    };
    let written = files::write(&args.output, scene, light, (args.parts.into(), form), &metadata)?;
    let error = error.map(|e| format!(", estimated error {e:.4}")).unwrap_or_default();
    let names: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
    let texels: u64 = light.pages.iter().map(|page| page.direct.len() as u64).sum();
    say(&format!(
        "{}: maps of {texels} texels, {passes} passes{error}, baked in {} -> {}",
        scene.name,
        duration(start.elapsed()),
        names.join(", ")
    ));
    Ok(())
}

fn maps(sizes: &[[u32; 2]]) -> String {
    let most = |axis: usize| sizes.iter().map(|size| size[axis]).max().unwrap_or_default();
    let (width, height) = (most(0), most(1));
    match sizes.len() {
        1 => format!("a map of {width}x{height}"),
        count if sizes.iter().all(|size| *size == [width, height]) => format!("{count} maps of {width}x{height}"),
        count => format!("{count} maps of up to {width}x{height}"),
    }
}

/// Particles of a pass: all texels share them, where an image has as many for each class of its pixels. More have less error in the
/// same time (128 to 1024 two thirds of that of 32 in the Cornell box), but passes then take minutes in large scenes.
const PARTICLES: u32 = 64;

/// Lights on the emitters beside these, where neither a flag nor the scene gives particles.
const DIRECT_LIGHTS: u32 = 16;

/// Particles of the pool of a pass, from which each block of texels chooses its lights. At equal passes 4000 have about half the error of
/// none in Sponza, and two thirds in the Cornell box; 1200 have nearly as much as 4000.
const LIGHT_POOL: u32 = 4000;

/// The flags over settings for texels: all of them share their particles. Trees split where neighbours differ, so that their points share
/// their lights too.
fn bake_settings(args: &args::Bake, scene: &Scene, by_command: &RenderDefaults) -> Settings {
    let keys = &scene.render;
    let mut chosen = Settings::default().with_scene_defaults(keys);
    let given = keys.preset.is_some();
    if !given && keys.particles.is_none() {
        chosen.particles = PARTICLES;
        chosen.direct_lights = keys.direct_lights.unwrap_or(Some(DIRECT_LIGHTS));
    }
    let classes = chosen.classes();
    let default = if given || args.adaptive.options().is_some() { 0 } else { LIGHT_POOL };
    let mut chosen = Settings { light_pool: keys.light_pool.unwrap_or(default), ..chosen };
    if by_command.interleave.is_none() && !given {
        chosen.photons *= classes;
        chosen.pattern = [1, 1];
    }
    lightsum::bake::settings(chosen)
}
