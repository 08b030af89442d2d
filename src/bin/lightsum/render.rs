//! `lightsum render`: flags and scene become settings, passes run until a condition is met, files are written.

use crate::args::Render;
use crate::checkpoint::{self, Checkpoints};
use crate::live::Live;
use crate::moment::Moment;
use crate::progress::{Progress, duration};
use crate::stop::{Stop, error_is_due, error_of, watch_for_interrupt};
use crate::{effect, mirrors, reference, say, say_aside, shard, speak, strips};
use glam::{DVec3, Vec3};
use lightsum::engine::ShutterEnd;
use lightsum::film::HostFilm;
use lightsum::output::{self, Encoding, Layers, Metadata, State, Statistics, Surfaces, Wanted};
use lightsum::pass::layout::PointLight;
use lightsum::scene::{self, Camera, RenderDefaults, Scene};
use lightsum::settings::{Settings, Traversal};
use lightsum::standalone::{RenderOptions, Renderer};
use lightsum::view::Region;
use lightsum::{Error, Result, ring};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Inputs known before the first pass.
pub struct Job {
    /// Name of the scene.
    pub name: String,
    /// The camera, flags included, relative to `origin`.
    pub camera: Camera,
    /// World coordinates of the scene's origin.
    pub origin: DVec3,
    /// The settings, flags included.
    pub settings: Settings,
    pub outputs: Vec<PathBuf>,
    pub encoding: Encoding,
    /// Whether a network removes noise from the outputs.
    pub denoise: bool,
    /// The part of the image that is rendered, if it is not all of it.
    pub crop: Option<Region>,
    /// Whether the outputs have layers of objects, materials and texture coordinates.
    pub surfaces: bool,
    /// Seconds of each stage so far.
    pub stages: Vec<(String, f64)>,
}

/// Runs the command.
pub fn run(args: &Render) -> Result<()> {
    let part = shard::Part::of(args)?;
    let has_state = |output: &&PathBuf| part.is_none() && !output::is_standard_output(output);
    let state = args.output.outputs.first().filter(has_state).map(|output| State::path_for(output));
    let mut files = outputs(args, state.as_ref());
    files.iter().try_for_each(|file| output::check_writable(file))?;
    let _claim = output::claim(files.iter().map(PathBuf::as_path))?;
    speak::leave_output_to(files.iter().map(PathBuf::as_path));
    let (job, scene, moment) = prepare(args)?;
    if let Some(path) = &args.output.export_lights {
        files.extend(scene::exported_files(path, &scene));
    }
    output::check_apart(files.iter().map(PathBuf::as_path), &scene.files)?;
    if args.reference.reference {
        reference::run(&job, &scene, &moment, args)
    } else {
        radiosity(job, scene, &moment, args, (state.as_deref(), part))
    }
}

/// The files that the flags name, and that of the state.
pub fn outputs(args: &Render, state: Option<&PathBuf>) -> Vec<PathBuf> {
    let files = args.output.outputs.iter().chain(&args.output.stats).chain(&args.output.export_lights);
    files.chain(state).cloned().collect()
}

/// Reads the scene, and checks the flags.
pub fn prepare(args: &Render) -> Result<(Job, Scene, Moment<'_>)> {
    let Some(path) = &args.scene else {
        // The parser demands a scene unless devices are listed.
        return Err(Error::Setting { name: "SCENE", message: "none is given".into() });
    };
    let start = Instant::now();
    let mut scene = scene::load_with(path, &args.reading.options())?;
    let given = args.keys.override_scene(&mut scene, "render")?;
    let moment = Moment::of(&mut scene, path, args)?;
    let camera = moment.camera;
    args.output.kept.read(&mut scene)?;
    let stages = vec![("load".into(), start.elapsed().as_secs_f64())];
    args.output.crop.map_or(Ok(()), |crop| crop.check(camera.resolution))?;
    let mut settings = Settings::default().with_scene_defaults(&scene.render);
    if args.output.export_lights.is_some() {
        // Exported lights light everything, so there must not be many more of them than a pass can afford.
        settings.light_pool = 0;
        if given.interleave.is_none() {
            settings.pattern = [1, 1];
        }
    }
    settings.validate()?;
    effect::warn(&args.keys.typed(), &settings, &scene);
    effect::warn_display(args.output.exposure, args.output.tonemap, &args.output.outputs);
    effect::warn_render(args, &camera, moment.moves());
    let denoise = args.output.denoise.is_some();
    if denoise {
        output::denoise::check()?;
    }
    let exposure = args.output.exposure.or(scene.render.exposure).unwrap_or_default();
    let encoding = Encoding {
        float: args.output.float,
        color_only: args.output.no_layers,
        exposure,
        tonemap: args.output.tonemap.into(),
    };
    // Numbers and strings alone: serialisation cannot fail.
    let as_json = serde_json::to_string(&settings).unwrap_or_default();
    log::info!("{}: {} triangles, camera {}", path.display(), scene.triangles.len(), camera.world_json(scene.origin));
    log::info!("settings {as_json}");
    let (outputs, crop, surfaces) = (args.output.outputs.clone(), args.output.crop, args.output.surfaces);
    let job = Job {
        name: scene.name.clone(),
        camera,
        origin: scene.origin,
        settings,
        outputs,
        encoding,
        denoise,
        crop,
        surfaces,
        stages,
    };
    Ok((job, scene, moment))
}

/// How to render. `traversal`: the kernel where the flags leave it open; `None`: the faster one.
pub fn options(args: &Render, traversal: Option<Traversal>, ends: Option<&[ShutterEnd; 2]>) -> RenderOptions {
    RenderOptions {
        device: args.device.device.clone().unwrap_or_default(),
        validation: args.device.validation,
        checked_shaders: false,
        max_memory: args.device.max_device_memory,
        pipeline_cache: pipeline_cache(),
        traversal,
        dynamic: ends.into_iter().flatten().any(|end| !end.objects.is_empty()),
        crop: args.output.crop,
        strips: false,
    }
}

/// The settings of a scene with its keys, over those of the command line. Says how much memory a ring takes.
pub fn moving_settings(keys: &RenderDefaults, resolution: [u32; 2]) -> Result<Settings> {
    let settings = Settings::default().with_scene_defaults(keys);
    settings.validate()?;
    let Some(ring) = &settings.ring else { return Ok(settings) };
    ring.check(resolution, settings.max_depth)?;
    let what = match ring.form {
        ring::Form::Images => "images",
        ring::Form::Lights => "paths",
    };
    let mib = ring.bytes(resolution, settings.max_depth) as f64 / (1 << 20) as f64;
    say_aside(&format!("a ring of {} {what} takes {mib:.1} MiB of {}", ring.length, ring.memory));
    Ok(settings)
}

/// Renders by instant radiosity and writes the requested files: images, with their state at `state_path`, or a part of the passes.
fn radiosity(
    mut job: Job,
    mut scene: Scene,
    moment: &Moment,
    args: &Render,
    (state_path, part): (Option<&Path>, Option<shard::Part>),
) -> Result<()> {
    let interrupted = watch_for_interrupt();
    let earlier = match state_path.filter(|_| args.stop.resume) {
        Some(path) => checkpoint::earlier(path)?.map(|state| (path, state)),
        None => None,
    };
    let start = Instant::now();
    let ends = moment.ends(&scene)?;
    let traversal = match &part {
        Some(part) => Some(part.traversal()),
        None => earlier.as_ref().map(|(_, state)| state.provenance.traversal),
    };
    let strips = args.output.crop.is_none() && ends.is_none() && part.is_none();
    let options = RenderOptions { strips, ..options(args, traversal, ends.as_ref()) };
    let stop = Stop::choose(&scene.render);
    let mut live = Live::new(&args.output, &job.name)?;
    mirrors::sample(&mut scene, &job.settings, &options, &interrupted)?;
    let mut renderer = Renderer::new(scene, job.camera, job.settings.clone(), &options)?;
    renderer.set_shutter_ends(ends.clone())?;
    // The renderer counts its own stages.
    let of_renderer: f64 = renderer.statistics().stages.iter().map(|(_, seconds)| seconds).sum();
    job.stages.push(("prepare".into(), (start.elapsed().as_secs_f64() - of_renderer).max(0.0)));

    if let Some(part) = part {
        return part.run(&job, renderer, args, &interrupted);
    }
    if !renderer.strips().is_empty() {
        return strips::run(&job, renderer, args, (&options, &interrupted));
    }
    if let Some(path) = &args.output.export_lights {
        let count = renderer.export_lights(path)?;
        say(&format!("wrote {count} virtual lights to {}", path.display()));
        let has_lobes = renderer.lights()?.iter().any(|light| light.flags() & PointLight::GLOSSY != 0);
        let left_out = [
            (renderer.engine().plan().photons.is_some(), "photons"),
            (renderer.engine().plan().mirrors.is_some(), "mirrored lights"),
            (has_lobes, "specular lobes of the lights"),
        ];
        for (_, what) in left_out.iter().filter(|left_out| left_out.0) {
            log::warn!("{}: {what} are not exported", path.display());
        }
        if job.outputs.is_empty() && args.output.stats.is_none() && args.output.display.is_none() {
            return Ok(());
        }
    }
    if let Some((path, state)) = &earlier {
        checkpoint::go_on(path, state, &mut renderer)?;
    }
    if let Some(path) = state_path {
        let bytes = HostFilm::byte_count(renderer.engine().view().size(), job.settings.summands);
        // Without --resume the state is written only by a run that takes long.
        match checkpoint::check_room(path, bytes as u64) {
            Err(error) if args.stop.resume => return Err(error),
            Err(error) => log::warn!("no checkpoint will be written: {error}"),
            Ok(()) => {}
        }
    }

    let mut checkpoints = Checkpoints::new(state_path, args.stop.checkpoint.0);
    let (mut start, mut stop, mut opened_again) = (Instant::now(), stop, false);
    let (rendered, mut outcome, writing) = loop {
        let rendered = passes(&job, &mut renderer, &stop, &interrupted, (&mut checkpoints, &mut live));
        let writing = Instant::now();
        let written = match &rendered {
            Ok(_) if renderer.passes() > 0 => write_image(&job, &renderer, &renderer.statistics(), tell_if_black),
            _ => Ok(()),
        };
        let lost = rendered.as_ref().err().or(written.as_ref().err());
        match lost.filter(|error| !opened_again && matches!(error, Error::DeviceLost { .. })) {
            None => break (rendered, written, writing),
            Some(error) => log::warn!("{error}; opening it once more"),
        }
        renderer = open_again(renderer, &job, (&options, ends.as_ref()), (&checkpoints, earlier.as_ref()))
            .inspect_err(|_| checkpoints.tell())?;
        stop = stop.with_time(|time| time.saturating_sub(start.elapsed()));
        (start, opened_again) = (Instant::now(), true);
    };
    let (rendering, error) = match rendered {
        Ok(done) => done,
        Err(error) => {
            save_what_there_is(&job, &renderer, &mut checkpoints);
            return Err(error);
        }
    };
    let passes = renderer.passes();
    let broken_off = interrupted.load(Ordering::Relaxed);
    if passes == 0 {
        return Err(Error::Interrupted);
    }
    live.end(&renderer);
    let statistics = Statistics { mirror_pixels: mirrors::pixels(&renderer)?, ..renderer.statistics() };
    mirrors::tell(statistics.mirror_pixels);
    // A failure to write one file must not prevent the others.
    if outcome.is_err() {
        checkpoints.rescue(&renderer);
    } else if args.stop.resume || broken_off {
        outcome = checkpoints.write(&renderer);
    } else {
        checkpoints.remove();
    }
    job.stages.push(("write".into(), writing.elapsed().as_secs_f64()));
    if let Some(path) = &args.output.stats {
        // In between: the renderer's set-up and all its passes, including those of --export-lights.
        let (before, after) = job.stages.split_at(job.stages.len().min(2));
        let stages = before.iter().chain(&statistics.stages).chain(after).cloned().collect();
        let statistics = Statistics {
            scene: job.name.clone(),
            resolution: job.camera.resolution,
            passes,
            error_estimate: error,
            stages,
            ..statistics
        };
        outcome = outcome.and(statistics.write(path));
    }
    outcome?;
    if broken_off {
        checkpoints.tell();
    }
    let error = error.map(|e| format!(", estimated error {e:.4}")).unwrap_or_default();
    job.say_where(&format!("{}{error}, rendered in {}", count(passes), duration(rendering)));
    Ok(())
}

/// Opens a lost device once more, and goes on from the latest checkpoint of this run, from the earlier state, or anew.
fn open_again(
    lost: Renderer,
    job: &Job,
    (options, ends): (&RenderOptions, Option<&[ShutterEnd; 2]>),
    (checkpoints, earlier): (&Checkpoints, Option<&(&Path, State)>),
) -> Result<Renderer> {
    let options = RenderOptions { traversal: Some(lost.provenance().traversal), ..options.clone() };
    let mut renderer = Renderer::new(lost.into_scene(), job.camera, job.settings.clone(), &options)?;
    renderer.set_shutter_ends(ends.cloned())?;
    match (checkpoints.latest()?, earlier) {
        (Some((path, state)), _) => checkpoint::go_on(path, &state, &mut renderer)?,
        (None, Some((path, state))) => checkpoint::go_on(path, state, &mut renderer)?,
        (None, None) => {}
    }
    say_aside(&format!("the device was lost; rendering goes on after {}", count(renderer.passes())));
    Ok(renderer)
}

/// Runs passes until `stop` or an interrupt; returns their time and the last error estimate.
fn passes(
    job: &Job,
    renderer: &mut Renderer,
    stop: &Stop,
    interrupted: &AtomicBool,
    (checkpoints, live): (&mut Checkpoints, &mut Live),
) -> Result<(Duration, Option<f32>)> {
    let before = renderer.passes();
    let mut error = error_of(renderer)?;
    let mut progress = Progress::new();
    loop {
        let (passes, elapsed) = (renderer.passes(), progress.elapsed());
        if interrupted.load(Ordering::Relaxed) || passes > 0 && stop.reached(passes, elapsed, error) {
            break;
        }
        renderer.pass()?;
        let passes = renderer.passes();
        if error_is_due(passes) {
            error = error_of(renderer)?;
        }
        let (rendered, elapsed) = (passes - before, progress.elapsed());
        let text = || {
            let rate = f64::from(rendered) / elapsed.as_secs_f64().max(1e-9);
            let error = error.map(|e| format!(", error {e:.4}")).unwrap_or_default();
            format!("{}, {rate:.2} passes/s{error}", count(passes))
        };
        progress.show(text, stop.fraction(passes, rendered, elapsed, error));
        checkpoints.after_pass(renderer);
        live.after_pass(renderer, || write_image(job, renderer, &renderer.statistics(), |_| ()));
    }
    progress.finish();
    let elapsed = progress.elapsed();
    Ok((elapsed, error_of(renderer)?))
}

/// A number of passes in words.
pub fn count(passes: u32) -> String {
    format!("{passes} {}", if passes == 1 { "pass" } else { "passes" })
}

/// Writes the outputs. `tell` may say something about the image.
fn write_image(job: &Job, renderer: &Renderer, statistics: &Statistics, tell: impl FnOnce(&Layers)) -> Result<()> {
    if job.outputs.is_empty() {
        return Ok(());
    }
    let mut metadata = metadata(job, &statistics.device, statistics.driver.clone());
    metadata.passes = renderer.passes();
    let mut layers = renderer.image(job.wanted())?;
    job.add_surfaces(&mut layers, renderer);
    tell(&layers);
    job.write_outputs(&layers, &metadata)
}

/// Warns of an image without any light.
fn tell_if_black(layers: &Layers) {
    if !layers.color.is_empty() && layers.color.iter().all(|color| *color == Vec3::ZERO) {
        log::warn!(
            "the image is black: no light comes from what the camera sees; --eye and --target move the camera, \
             into a closed room for example"
        );
    }
}

/// After an error in a pass: writes the image and the state of the passes before it, as far as the device still gives them.
fn save_what_there_is(job: &Job, renderer: &Renderer, checkpoints: &mut Checkpoints) {
    if renderer.passes() == 0 {
        return;
    }
    let statistics = renderer.statistics();
    match write_image(job, renderer, &statistics, |_| ()) {
        Ok(()) => say_aside(&format!("{} before the error are in the image", count(renderer.passes()))),
        Err(error) => log::warn!("the image of the passes before the error is lost: {error}"),
    }
    match checkpoints.write(renderer) {
        Ok(()) => {}
        Err(error) => log::warn!("their state is lost: {error}"),
    }
    checkpoints.tell();
}

impl Job {
    /// The layers that the outputs show.
    pub fn wanted(&self) -> Wanted {
        if self.denoise { Wanted::All } else { Wanted::by(&self.outputs, &self.encoding) }
    }

    /// Adds the layers of the surfaces, if they are wanted, for the whole image or its part.
    pub fn add_surfaces(&self, layers: &mut Layers, renderer: &Renderer) {
        if self.surfaces {
            let engine = renderer.engine();
            let whole = Surfaces::of(renderer.scene(), engine.bvh(), &self.camera, engine.while_open().as_ref());
            let [width, height] = self.camera.resolution;
            let whole = Layers { width, height, surfaces: whole, ..Layers::default() };
            layers.surfaces = if let Some(crop) = self.crop { whole.cut(crop) } else { whole }.surfaces;
        }
    }

    /// Writes every output; returns the first error after all have been tried.
    pub fn write_outputs(&self, layers: &Layers, metadata: &Metadata) -> Result<()> {
        write_images(&self.outputs, layers, metadata, (&self.encoding, self.denoise))
    }

    /// The last line: a summary and the names of the files.
    pub fn say_where(&self, what: &str) {
        let names: Vec<String> = self.outputs.iter().map(|path| path.display().to_string()).collect();
        let place = if names.is_empty() { String::new() } else { format!(" -> {}", names.join(", ")) };
        say(&format!("{}: {what}{place}", self.name));
    }
}

/// Writes an image to files; returns the first error after all have been tried. `denoise`: without its noise.
pub fn write_images(
    outputs: &[PathBuf],
    layers: &Layers,
    metadata: &Metadata,
    (encoding, denoise): (&Encoding, bool),
) -> Result<()> {
    let mut denoised = Layers::default();
    let layers = if denoise && !outputs.is_empty() {
        denoised.clone_from(layers);
        output::denoise::denoise(&mut denoised)?;
        &denoised
    } else {
        layers
    };
    outputs.iter().map(|path| output::write(path, layers, metadata, encoding)).fold(Ok(()), Result::and)
}

/// The program and its version, for metadata.
pub const SOFTWARE: &str = concat!("lightsum ", env!("CARGO_PKG_VERSION"));

/// The program, and what changed its image.
pub fn software(denoised: bool) -> String {
    if denoised { format!("{SOFTWARE}, denoised by Open Image Denoise") } else { SOFTWARE.into() }
}

/// Metadata of a job's image, without the number of passes.
pub fn metadata(job: &Job, device: &str, driver: String) -> Metadata {
    let s = &job.settings;
    let settings = serde_json::to_string(s).unwrap_or_default();
    Metadata {
        software: software(job.denoise),
        scene: job.name.clone(),
        settings,
        seed: s.seed,
        passes: 0,
        camera: job.camera.world_json(job.origin),
        device: device.into(),
        driver,
    }
}

/// File that keeps compiled pipelines between runs, in the user's cache folder if there is one.
pub fn pipeline_cache() -> Option<PathBuf> {
    let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let folder = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    Some(folder.join("lightsum").join(concat!("pipelines-", env!("CARGO_PKG_VERSION"), ".bin")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Arguments, Command};
    use clap::Parser;
    use lightsum::settings::keys::{Given, KEYS, Takes};
    use lightsum::settings::{Agreement, Clip, Compensation, Filter, Spread};

    fn chosen(line: &str, render: &RenderDefaults) -> Settings {
        let start = ["lightsum", "render", "a.toml", "-o", "a.exr"];
        let arguments = Arguments::try_parse_from(start.into_iter().chain(line.split_whitespace())).unwrap();
        let Some(Command::Render(args)) = arguments.command else { unreachable!("the line names the command") };
        let mut keys = render.clone();
        keys.override_by(&args.keys.given().unwrap());
        Settings::default().with_scene_defaults(&keys)
    }

    #[test]
    fn flags_come_before_the_scene_and_the_scene_before_the_defaults() {
        let defaults = Settings::default();
        let scene = RenderDefaults {
            particles: Some(7),
            max_specular: Some(3),
            clip: Some(0.5),
            compensation: Some(Compensation::Off),
            seed: Some(9),
            ..RenderDefaults::default()
        };
        assert_eq!(chosen("", &RenderDefaults::default()), defaults);
        let from_scene = chosen("", &scene);
        assert_eq!((from_scene.particles, from_scene.seed, from_scene.compensation), (7, 9, Compensation::Off));
        assert_eq!(from_scene.clip, Clip::Distance(0.5));
        let flags = chosen(
            "--particles 3 --seed 1 --clip-fraction 0.1 --jitter --rounds 8 --max-depth 2 --interleave 2x5",
            &scene,
        );
        assert_eq!((flags.pattern, defaults.pattern), ([2, 5], [3, 3]));
        assert_eq!((flags.photons, chosen("--interleave 1x1", &scene).photons), (2700, 27000));
        assert_eq!(chosen("--interleave 1x1", &scene).filter, None);
        assert_eq!((flags.particles, flags.seed, flags.rounds, flags.max_depth, flags.jitter), (3, 1, 8, 2, true));
        assert_eq!((flags.max_specular, flags.split), (3, true));
        let direct = chosen("--max-specular 0 --no-split", &scene);
        assert_eq!((direct.max_specular, direct.split), (0, false));
        assert_eq!(flags.clip, Clip::Fraction(0.1));
        assert_eq!((flags.filter, chosen("--filter off", &scene).filter), (Some(Filter::default()), None));
        assert_eq!(chosen("--filter auto", &scene).filter, Some(Filter::default()));
        let filter = chosen("--filter 5x3 --no-filter-direct --filter-agreement paper", &scene).filter;
        let expected =
            Filter { window: Some([5, 3]), direct: false, agreement: Agreement::DepthAndNormal, sparse: true };
        assert_eq!(filter, Some(expected));
        // A preset is below the scene's keys.
        let preset = chosen("--preset interactive --particles 4", &scene);
        assert_eq!((preset.particles, preset.clip, preset.compensation), (4, Clip::Distance(0.5), Compensation::Off));
        assert_eq!((preset.seed, preset.photons), (9, 1500));
        assert_eq!(chosen("--preset progressive --no-compensation", &scene).compensation, Compensation::Off);
        assert_eq!(chosen("--preset interactive", &RenderDefaults::default()), Settings::interactive());
        assert_eq!(chosen("--preset interactive --compensation exact", &scene).compensation, Compensation::Exact);
    }

    #[test]
    fn set_is_below_flags_and_above_the_scene() {
        let scene = RenderDefaults { particles: Some(7), seed: Some(9), ..RenderDefaults::default() };
        let settings = chosen("--set particles=5 --set seed=3 --seed 2 --set max_depth=4 --set filter=off", &scene);
        assert_eq!((settings.particles, settings.seed, settings.max_depth), (5, 2, 4));
        assert_eq!(settings.filter, None);
        // The last one counts.
        assert_eq!(chosen("--set particles=5 --set particles=6", &scene).particles, 6);
        assert_eq!(chosen("--particles 5 --particles 6", &scene).particles, 6);
        let sizes =
            chosen("--set interleave=[2,1] --set compensation='exact' --set filter_agreement=depth_and_normal", &scene);
        assert_eq!((sizes.pattern, sizes.filter.map(|f| f.agreement)), ([2, 1], Some(Agreement::DepthAndNormal)));
    }

    #[test]
    fn every_switch_can_be_turned_back() {
        let switches = KEYS.iter().filter(|key| key.takes == Takes::Switch && key.acts_on("render"));
        let mut count = 0;
        for key in switches {
            let (on, off) = (key.flag, key.flag.replacen("--", "--no-", 1));
            let with = |line: &str, set: bool| {
                let superposition = Some(Some(Spread::Variant));
                let mut scene = RenderDefaults { superposition, ..RenderDefaults::default() };
                scene.put(key.name, &Given::Switch(set)).unwrap();
                chosen(line, &scene).keys()
            };
            assert!(with("", true) != with("", false), "{on} changes nothing");
            for set in [true, false] {
                assert_eq!(with(on, set), with("", true), "{on}");
                assert_eq!(with(&off, set), with("", false), "{off}");
                assert_eq!(with(&format!("{on} {off}"), set), with("", false), "{on} {off}");
                assert_eq!(with(&format!("{off} {on}"), set), with("", true), "{off} {on}");
            }
            count += 1;
        }
        assert_eq!(count, 9);
        let compensation = |line: &str| chosen(line, &RenderDefaults::default()).compensation;
        assert_eq!(compensation("--no-compensation --compensation exact"), Compensation::Exact);
        assert_eq!(compensation("--compensation exact --no-compensation"), Compensation::Off);
        let filter = chosen("--preset interactive --no-filter-direct", &RenderDefaults::default()).filter;
        assert_eq!(filter, Some(Filter { direct: false, ..Filter::default() }));
    }
}
