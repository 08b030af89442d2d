//! `lightsum bake`: light of a scene kept in textures.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use lightsum::bake::files::{self, Form};
use lightsum::bake::{Bake, Lightmap};
use lightsum::gpu::Context;
use lightsum::output::{self, Layers, Metadata, State};
use lightsum::settings::Settings;
use lightsum::standalone::{self, RenderOptions, Renderer};
use lightsum::{Error, Result, Scene, scene};

use crate::args;
use crate::checkpoint::Checkpoints;
use crate::play;
use crate::progress::{Progress, duration};
use crate::render::{SOFTWARE, pipeline_cache, settings, watch_for_interrupt};
use crate::stop::{Stop, error_is_due};
use crate::{say, say_aside};

/// Runs the command.
pub fn run(args: &args::Bake) -> Result<()> {
    output::check_writable(&args.output)?;
    let mut scene = scene::load_with(&args.scene, args.reading.photometric())?;
    play::pose(&mut scene, &args.scene, args.pose.animation.as_deref(), args.pose.at)?;
    let settings = bake_settings(args, &scene);
    settings.validate()?;
    args.options().validate()?;
    let interrupted = watch_for_interrupt();
    let options = RenderOptions {
        device: args.device.device.clone().unwrap_or_default(),
        validation: args.device.validation,
        pipeline_cache: pipeline_cache(),
        ..RenderOptions::default()
    };
    let start = Instant::now();
    let (context, settings) = standalone::open(settings, &options)?;
    if let Some(adaptive) = args.adaptive.options() {
        let (light, passes) = crate::radiosity::light(args, (&context, &scene), &settings, adaptive, &interrupted)?;
        return write(args, (&context, &scene), &settings, &light, (passes, None), start);
    }
    let bake = Bake::new(&context, &scene, settings.clone(), args.options())?;
    let charts = bake.charts();
    let [device, host] = bake.memory().map(|bytes| bytes as f64 / f64::from(1 << 20));
    say_aside(&format!(
        "{} charts of {:.3} texels a unit, {} texels on {}, laid out in {}; \
         {device:.0} MiB of the device and {host:.0} MiB beside the scene",
        charts.count,
        charts.density,
        bake.texels(),
        maps(&charts.pages),
        duration(start.elapsed()),
    ));

    let start = Instant::now();
    let mut job = Job {
        bake: &bake,
        stop: Stop::choose(&args.stop, scene.render.passes),
        resume: args.stop.resume,
        checkpoint: args.stop.checkpoint.0,
        states: Vec::new(),
        output: &args.output,
        interrupted: &interrupted,
        progress: Progress::new(),
        passes: 0,
        error: None,
    };
    let images = job.run()?;
    let Some(images) = images else { return Ok(()) };
    let (passes, error) = (job.passes, job.error);
    let light = bake.finish(&images)?;
    write(args, (&context, &scene), &settings, &light, (passes, error), start)?;
    if !args.stop.resume && !interrupted.load(Ordering::Relaxed) {
        job.states.iter().for_each(Checkpoints::remove);
    }
    Ok(())
}

/// Writes the files of a bake that began at `start`.
fn write(
    args: &args::Bake,
    (context, scene): (&Context, &Scene),
    settings: &Settings,
    light: &Lightmap,
    (passes, error): (u32, Option<f32>),
    start: Instant,
) -> Result<()> {
    let info = context.info();
    let metadata = Metadata {
        software: SOFTWARE.into(),
        scene: scene.name.clone(),
        settings: serde_json::to_string(settings).unwrap_or_default(),
        seed: settings.seed,
        passes,
        device: info.name.clone(),
        driver: format!("{} {}", info.driver, info.driver_version),
        ..Metadata::default()
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

/// The flags over settings for texels: all of them share their lights, and no pool is chosen from.
fn bake_settings(args: &args::Bake, scene: &lightsum::Scene) -> Settings {
    let mut chosen = settings(&args.light, &args::Glossy::default(), &args.device, &scene.render);
    let given = args.light.preset.is_some();
    if !given && args.light.particles.or(scene.render.particles).is_none() {
        chosen.particles = PARTICLES;
    }
    let classes = chosen.classes();
    let mut chosen = Settings { light_pool: 0, ..chosen };
    if args.light.interleave.is_none() && !given {
        chosen.photons *= classes;
        chosen.pattern = [1, 1];
    }
    lightsum::bake::settings(chosen)
}

/// The batches of a bake being rendered.
struct Job<'a> {
    bake: &'a Bake,
    stop: Stop,
    resume: bool,
    /// Time between two checkpoints of a batch.
    checkpoint: Option<Duration>,
    /// The states of the batches that have begun.
    states: Vec<Checkpoints>,
    output: &'a Path,
    interrupted: &'a AtomicBool,
    progress: Progress,
    /// The fewest passes of a batch.
    passes: u32,
    /// The greatest estimated error of a batch.
    error: Option<f32>,
}

impl Job<'_> {
    /// The state of a batch: `OUTPUT.state` if there is one batch, else `OUTPUT.0.state` and so on.
    fn state_path(&self, batch: usize) -> PathBuf {
        if self.bake.batches().len() == 1 {
            return State::path_for(self.output);
        }
        let mut name = OsString::from(self.output);
        name.push(format!(".{batch}"));
        State::path_for(Path::new(&name))
    }

    /// Renders all batches, one after the other. An interrupt keeps their states; `None`: some have not begun.
    fn run(&mut self) -> Result<Option<Vec<Layers>>> {
        let batches = self.bake.batches();
        let total = self.bake.texels().max(1) as f64;
        let (mut images, mut done) = (Vec::new(), 0.0);
        for (i, batch) in batches.iter().enumerate() {
            let share = batch.texels() as f64 / total;
            let mut renderer = self.bake.renderer(i)?;
            let path = self.state_path(i);
            if self.resume && path.exists() {
                let state = State::read(&path)?;
                state.check(&path, renderer.fingerprint(), renderer.engine().view().size())?;
                renderer.load_state(state.passes, &state.accumulators)?;
                log::info!("{}: going on after {} passes", path.display(), state.passes);
            }
            let mut states = Checkpoints::new(Some(&path), self.checkpoint);
            if let Err(error) = self.batch(&mut renderer, &mut states, i, (done, share)) {
                states.rescue(&renderer);
                return Err(error);
            }
            let broken_off = self.interrupted.load(Ordering::Relaxed);
            if renderer.passes() == 0 {
                return if i == 0 { Err(Error::Interrupted) } else { Ok(None) };
            }
            if broken_off {
                states.rescue(&renderer);
            } else if self.resume || batches.len() > 1 {
                states.write(&renderer)?;
            }
            self.states.push(states);
            if broken_off && i + 1 < batches.len() {
                return Ok(None);
            }
            self.passes = if i == 0 { renderer.passes() } else { self.passes.min(renderer.passes()) };
            self.error = renderer.error_estimate().map(|e| self.error.map_or(e, |other| other.max(e)));
            images.push(renderer.layers()?);
            done += share;
        }
        self.progress.finish();
        Ok(Some(images))
    }

    /// Runs the passes of batch `i`, which has `share` of the texels; `done`: the share of those before.
    fn batch(
        &mut self,
        renderer: &mut Renderer,
        states: &mut Checkpoints,
        i: usize,
        (done, share): (f64, f64),
    ) -> Result<()> {
        let (start, before) = (Instant::now(), renderer.passes());
        let stop = self.stop.of_share(share);
        let mut error = renderer.error_estimate();
        loop {
            let (passes, elapsed) = (renderer.passes(), start.elapsed());
            if self.interrupted.load(Ordering::Relaxed) || passes > 0 && stop.reached(passes, elapsed, error) {
                return Ok(());
            }
            renderer.pass()?;
            states.after_pass(renderer);
            let passes = renderer.passes();
            if error_is_due(passes) {
                error = renderer.error_estimate();
            }
            let text = || {
                let rate = f64::from(passes - before) / start.elapsed().as_secs_f64().max(1e-9);
                let error = error.map(|e| format!(", error {e:.4}")).unwrap_or_default();
                let part = match self.bake.batches().len() {
                    1 => String::new(),
                    n => format!("part {} of {n}, ", i + 1),
                };
                format!("{part}{passes} passes, {rate:.2} passes/s{error}")
            };
            let fraction = stop.fraction(passes, passes - before, start.elapsed(), error);
            self.progress.show(text, done + share * fraction);
        }
    }
}

impl Stop {
    /// The conditions for a part of the work: with a part of the time.
    fn of_share(&self, share: f64) -> Stop {
        self.with_time(|time| Duration::from_secs_f64(time.as_secs_f64() * share))
    }
}
