//! `walkthrough`: a recorded path through a scene, for each number of glossy reflectors (Bastos 1999, sections 1.4 and 6.6.5).
//!
//! Every frame is rendered for all numbers in turn, so that a busy minute of the machine meets them all. One pass a frame, with the
//! settings of `--preset interactive --superposition variant --moving-passes 1`; the images are those of `lightsum animate`. A frame's
//! time is that of placing camera and objects and of the pass; reading the image back does not count, nor does sampling the images with
//! depth of `--mirror-source images`, which have the sizes of their flags' defaults. Where they are among the sources, all engines hold the
//! scene in one tree, as a scene that stands still; else one tree for each object, as those of `lightsum animate` do.
//!
//! With `--every` the frame before each played one is rendered too and not counted: a jump over many frames may cost what no frame of the
//! path does, such as new lists of lights where the rooms around the eye reflect otherwise.

mod plot;
mod series;

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use cpu_time::ProcessTime;
use lightsum::gpu::{Context, download};
use lightsum::output::{self, Encoding, Metadata, Wanted};
use lightsum::scene::path::Motion;
use lightsum::scene::{Camera, Scene};
use lightsum::settings::{MirrorImages, MirrorSource, Settings, Spread, Superposition};
use lightsum::superposition::depth_images::{DepthImages, Options, Plan};
use lightsum::{Error, Renderer, Result};
use serde_json::{Value, json};

use crate::args::{Source, Walkthrough};
use crate::{report, scene};
use series::{Frame, Series};

/// Runs the command.
pub fn run(args: &Walkthrough) -> Result<()> {
    let files = || args.timings.iter().chain(&args.plot);
    files().try_for_each(|file| output::check_writable(file))?;
    let _claim = output::claim(files().map(|file| file.as_path()))?;
    if let Some(folder) = args.images.as_deref().filter(|folder| !folder.is_dir()) {
        return Err(Error::file(folder, "there is no such folder; make it, or leave out --images"));
    }
    scene::check(std::slice::from_ref(&args.scene))?;
    let scene = scene::load(&args.scene)?;
    let inputs: Vec<_> = scene.files.iter().chain([&args.path]).cloned().collect();
    output::check_apart(files().map(|file| file.as_path()), &inputs)?;
    let still = match scene.camera {
        Some(camera) => Camera { resolution: args.resolution, ..camera },
        None => scene.framed(args.resolution, None),
    };
    let motion = Motion::load(&args.path, &scene, still)?;
    let motion = match args.frames {
        Some(frames) => motion.with_frames(frames),
        None => motion,
    };
    let counts = counts(args, &scene)?;

    let context = scene::open_device(&args.device, false)?;
    let environment = report::environment(context.info());
    if !args.json {
        report::print_environment(&environment)?;
    }
    let mut series = Vec::new();
    let mut renderers = Vec::new();
    let with_images = args.mirror_source.contains(&Source::Images);
    if with_images && !motion.objects.is_empty() {
        let message = "the path moves objects, and images with depth are those of a scene that stands still; take rays";
        return Err(Error::file(&args.path, message));
    }
    for &source in &args.mirror_source {
        let mut scene = scene.clone();
        if source == Source::Images {
            let settings = settings(source, *counts.end());
            let plan = Plan::new(&scene, &settings, Options::default())?;
            scene.mirror_images =
                Some(Arc::new(DepthImages::sample(&context, &scene, &settings, plan, &mut |_| true)?));
        }
        for reflectors in counts.clone() {
            series.push(Series::new(source, reflectors));
            let settings = settings(source, reflectors);
            let new = if with_images { Renderer::with_context } else { Renderer::with_context_dynamic };
            renderers.push(new(context.clone(), scene.clone(), still, settings)?);
        }
    }
    let times: Vec<(usize, f64)> = motion.times.iter().copied().enumerate().step_by(args.every as usize).collect();
    for (i, (renderer, series)) in renderers.iter_mut().zip(&mut series).enumerate() {
        // The first passes of a renderer compile kernels and fill caches.
        for &(_, time) in times.iter().take(1) {
            let camera = motion.camera(time).unwrap_or(still);
            renderer.engine_mut().place(&motion, camera, time)?;
            renderer.pass()?;
            renderer.engine_mut().restart();
        }
        log::info!("renderer {i} of {} reflectors, {}, is warm", series.reflectors, series.source.name());
    }
    let mut seen = Vec::new();
    for &(number, time) in &times {
        let camera = motion.camera(time).unwrap_or(still);
        let before = number.checked_sub(1).filter(|_| args.every > 1).and_then(|before| motion.times.get(before));
        for (renderer, series) in renderers.iter_mut().zip(&mut series) {
            if let Some(&before) = before {
                play(renderer, &motion, motion.camera(before).unwrap_or(still), before)?;
            }
            series.frames.push(play(renderer, &motion, camera, time)?);
            if let Some(folder) = &args.images {
                write_image(folder, renderer, series, number)?;
            }
        }
        seen.push(renderers.last().map_or(Ok(Vec::new()), |renderer| pixels(&context, renderer))?);
    }

    let of_frame = |((number, time), seen): (&(usize, f64), &Vec<u32>)| json!({ "frame": number, "time": time, "reflector_pixels": seen });
    let frames: Vec<Value> = times.iter().zip(&seen).map(of_frame).collect();
    let sources = || series.chunk_by(|a, b| a.source == b.source);
    let without: Vec<bool> = seen.iter().map(|pixels| pixels.iter().sum::<u32>() == 0).collect();
    let common = report::fields(json!({
        "mode": "walkthrough",
        "scene": args.scene,
        "path": args.path,
        "resolution": args.resolution,
        "triangles": scene.triangles.len(),
    }));
    if let Some(file) = &args.timings {
        let mut all = common.clone();
        all.extend(environment.clone());
        all.insert("frames".into(), frames.into());
        let slopes = sources().map(|of| (of[0].source.name().to_owned(), series::slopes(of, &without)));
        all.insert("slope".into(), slopes.collect());
        all.insert("series".into(), series.iter().map(|s| Value::Object(s.all_fields(&without))).collect());
        // Numbers and strings only: serialisation cannot fail.
        let text = serde_json::to_string(&all).unwrap_or_default();
        output::write_file(file, &[text.as_bytes(), b"\n"])?;
    }
    if let Some(file) = &args.plot {
        let numbers: Vec<usize> = times.iter().map(|(number, _)| *number).collect();
        let drawing = plot::draw(&numbers, &series)
            .map_err(|message| Error::file(file, format!("the plot cannot be drawn: {message}")))?;
        output::write_file(file, &[drawing.as_bytes()])?;
    }
    if args.json {
        for of_count in &series {
            let mut line = common.clone();
            line.extend(of_count.fields(&without));
            report::print_json(Value::Object(line), &environment)?;
        }
        return Ok(());
    }
    report::say("")?;
    let [width, height] = args.resolution;
    report::say(&format!(
        "{}: {} triangles, {width}x{height}, {} frames, {} of them without reflectors in view",
        args.scene,
        scene.triangles.len(),
        times.len(),
        without.iter().filter(|without| **without).count(),
    ))?;
    for of_source in sources() {
        report::say("")?;
        report::say(&format!("mirror images from {}", of_source[0].source.name()))?;
        series::print(of_source, &without)?;
    }
    Ok(())
}

/// Settings of a frame.
fn settings(source: Source, reflectors: u32) -> Settings {
    let mirror_source = match source {
        Source::Rays => MirrorSource::Rays,
        Source::Images => MirrorSource::Images(MirrorImages::default()),
    };
    let superposition =
        Superposition { spread: Spread::Variant, reflectors, mirror_source, ..Superposition::default() };
    Settings { superposition: Some(superposition), ..Settings::interactive() }
}

/// The numbers of reflectors to play the path with.
fn counts(args: &Walkthrough, scene: &Scene) -> Result<std::ops::RangeInclusive<u32>> {
    let all = scene.reflectors().len() as u32;
    match &args.reflectors {
        None => Ok(0..=all),
        Some(range) if *range.end() <= all => Ok(range.clone()),
        Some(range) => Err(Error::Setting {
            name: "--reflectors",
            message: format!(
                "{} are asked for, {} has {all} glossy planes that mirror the room",
                range.end(),
                args.scene
            ),
        }),
    }
}

/// Renders a frame.
fn play(renderer: &mut Renderer, motion: &Motion, camera: Camera, time: f64) -> Result<Frame> {
    let (start, processor) = (Instant::now(), ProcessTime::now());
    renderer.engine_mut().place(motion, camera, time)?;
    renderer.pass()?;
    let (seconds, cpu) = (start.elapsed().as_secs_f64(), processor.elapsed().as_secs_f64());
    Ok(Frame { seconds, cpu, gpu_passes: renderer.last_pass().gpu_passes.clone() })
}

/// Pixels that show each reflector in the latest frame, largest reflector first.
fn pixels(context: &Context, renderer: &Renderer) -> Result<Vec<u32>> {
    let engine = renderer.engine();
    let mut counts = vec![0; engine.plan().settings.superposition.map_or(0, |s| s.reflectors as usize)];
    if engine.frame().glossy_planes.is_some() {
        for region in download::<u32>(context, &engine.frame().eye.planes.region)? {
            if let Some(count) = (region as usize).checked_sub(1).and_then(|i| counts.get_mut(i)) {
                *count += 1;
            }
        }
    }
    Ok(counts)
}

fn write_image(folder: &Path, renderer: &Renderer, series: &Series, number: usize) -> Result<()> {
    let path = folder.join(format!("{}-{}-{number:04}.exr", series.source.name(), series.reflectors));
    let encoding = Encoding { color_only: true, ..Encoding::default() };
    output::write(&path, &renderer.image(Wanted::Color)?, &Metadata::default(), &encoding)
}
