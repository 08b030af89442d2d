//! `walkthrough`: a recorded path through a scene, for each number of glossy reflectors (Bastos 1999, sections 1.4 and 6.6.5).
//!
//! Every frame is rendered for all numbers in turn, so that a busy minute of the machine meets them all. One pass a frame, with the
//! settings of `--preset interactive --superposition variant --moving-passes 1`; the images are those of `lightsum animate`. A frame's
//! time is that of placing camera and objects and of the pass; reading the image back does not count.
//!
//! With `--every` the frame before each played one is rendered too and not counted: a jump over many frames may cost what no frame of the
//! path does, such as new lists of lights where the rooms around the eye reflect otherwise.

mod plot;
mod series;

use std::path::Path;
use std::time::Instant;

use cpu_time::ProcessTime;
use lightsum::gpu::{Context, download};
use lightsum::output::{self, Encoding, Metadata, Wanted};
use lightsum::scene::path::Motion;
use lightsum::scene::{Camera, Scene};
use lightsum::settings::{Settings, Spread, Superposition};
use lightsum::{Error, Renderer, Result};
use serde_json::{Value, json};

use crate::args::Walkthrough;
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

    let context = scene::open_device(&args.device)?;
    let environment = report::environment(context.info());
    if !args.json {
        report::print_environment(&environment)?;
    }
    let mut series = Vec::new();
    let mut renderers = Vec::new();
    for reflectors in counts {
        let superposition = Superposition { spread: Spread::Variant, reflectors, ..Superposition::default() };
        let settings = Settings { superposition: Some(superposition), ..Settings::interactive() };
        series.push(Series::new(reflectors));
        renderers.push(Renderer::with_context_dynamic(context.clone(), scene.clone(), still, settings)?);
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
        log::info!("renderer {i} of {} reflectors is warm", series.reflectors);
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
                write_image(folder, renderer, series.reflectors, number)?;
            }
        }
        seen.push(renderers.last().map_or(Ok(Vec::new()), |renderer| pixels(&context, renderer))?);
    }

    let of_frame = |((number, time), seen): (&(usize, f64), &Vec<u32>)| json!({ "frame": number, "time": time, "reflector_pixels": seen });
    let frames: Vec<Value> = times.iter().zip(&seen).map(of_frame).collect();
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
        all.insert("slope".into(), series::slopes(&series, &without));
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
    series::print(&series, &without)
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

fn write_image(folder: &Path, renderer: &Renderer, reflectors: u32, number: usize) -> Result<()> {
    let path = folder.join(format!("{reflectors}-{number:04}.exr"));
    let encoding = Encoding { color_only: true, ..Encoding::default() };
    output::write(&path, &renderer.image(Wanted::Color)?, &Metadata::default(), &encoding)
}
