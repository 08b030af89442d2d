//! `lightsum animate`: loads a scene once and renders frames with a moving camera and moving objects, by a recorded path, by an
//! animation of the model, or by both.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use lightsum::engine::ShutterEnd;
use lightsum::output::{self, Encoding};
use lightsum::scene::{self, Camera, path::Motion};
use lightsum::settings::{Exposure, Settings};
use lightsum::standalone::{RenderOptions, Renderer};
use lightsum::{Error, Result};
use serde_json::{Value, json};

use crate::args::{self, Animate};
use crate::play::Play;
use crate::progress::{Progress, duration};
use crate::render::{Job, metadata, pipeline_cache, watch_for_interrupt};
use crate::{camera, mirrors, say, say_aside};

/// File name pattern with a frame number.
struct Pattern {
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    /// Parses a pattern such as `frame-%04d.png`.
    fn new(path: &Path) -> Result<Pattern> {
        let wrong = |message: &str| {
            let message = format!("{}: {message}, as in frames/%04d.png", path.display());
            Err(Error::Setting { name: "--output", message })
        };
        let Some(text) = path.to_str() else { return wrong("the name must be readable text") };
        let Some((before, rest)) = text.split_once('%') else { return wrong("there must be a %d for the frame") };
        let Some((digits, after)) = rest.split_once('d') else { return wrong("after % there must be a d") };
        let number = digits.strip_prefix('0').unwrap_or(digits);
        let digits = match number {
            "" if digits.is_empty() => 1,
            _ => match number.parse() {
                Ok(digits @ 1..=9) => digits,
                _ => return wrong("between % and d there may be a width from 01 to 09"),
            },
        };
        if after.contains('%') {
            return wrong("there must be one % alone");
        }
        Ok(Pattern { before: before.to_owned(), digits, after: after.to_owned() })
    }

    fn name(&self, frame: usize) -> PathBuf {
        let Pattern { before, digits, after } = self;
        PathBuf::from(format!("{before}{frame:0digits$}{after}"))
    }
}

/// Runs the command.
pub fn run(args: &Animate) -> Result<()> {
    let shown = &args.shown;
    let pattern = args.output.as_deref().map(Pattern::new).transpose()?;
    let first = pattern.as_ref().map(|pattern| pattern.name(0));
    let files: Vec<PathBuf> = first.into_iter().chain(args.timings.clone()).collect();
    files.iter().try_for_each(|file| output::check_writable(file))?;
    let _claim = output::claim(files.iter().map(PathBuf::as_path))?;

    let start = Instant::now();
    let mut scene = scene::load_with(&args.scene, &shown.reading.options())?;
    let mut play = match (&args.path, &args.play.animation) {
        (Some(_), None) => None,
        (None, None) => Some(Play::new(&scene, None, "--path")?),
        (_, Some(name)) => Some(Play::new(&scene, Some(name), "--animation")?),
    };
    if let Some(play) = &mut play {
        // A model that is framed is framed as the animation begins.
        play.advance(play.start());
    }
    let still = camera::choose(play.as_ref().map_or(&scene, Play::scene), &shown.camera, shown.resolution)?;
    let motion = match (&args.path, &play) {
        (Some(path), _) => Motion::load(path, &scene, still)?,
        (None, Some(play)) => Motion::still(play.times(args.play.frames, args.play.fps)?),
        (None, None) => Motion::still(Vec::new()),
    };
    let inputs: Vec<PathBuf> = scene.files.iter().chain(&args.path).cloned().collect();
    let frames = (0..motion.times.len()).filter_map(|frame| Some(pattern.as_ref()?.name(frame)));
    let outputs: Vec<PathBuf> = frames.chain(args.timings.clone()).collect();
    output::check_apart(outputs.iter().map(PathBuf::as_path), &inputs)?;
    let settings = shown.settings(&scene.render, still.resolution)?;
    let mut settings = Settings { moving_passes: args.moving_passes.unwrap_or(settings.moving_passes), ..settings };
    args.mirrors.apply(&mut settings);
    settings.validate()?;
    if args.mirrors.wants_images() && (play.is_some() || !motion.objects.is_empty()) {
        let message = String::from("images show a scene that stands still, and objects move here; use rays");
        return Err(Error::Setting { name: "--mirror-source", message });
    }
    let mut job = Job {
        name: scene.name.clone(),
        camera: still,
        origin: scene.origin,
        settings: settings.clone(),
        outputs: Vec::new(),
        encoding: Encoding {
            float: false,
            color_only: true,
            exposure: shown.exposure.or(scene.render.exposure).unwrap_or_default(),
            tonemap: shown.tonemap.into(),
        },
        denoise: false,
        stages: vec![("load".into(), start.elapsed().as_secs_f64())],
    };
    let interrupted = watch_for_interrupt();
    let options = RenderOptions {
        device: shown.device.device.clone().unwrap_or_default(),
        validation: shown.device.validation,
        checked_shaders: false,
        max_memory: shown.device.max_device_memory,
        pipeline_cache: pipeline_cache(),
        // Where nothing but the camera moves the scene may hold images of itself.
        dynamic: !args.mirrors.wants_images(),
        ..RenderOptions::default()
    };
    mirrors::sample(&mut scene, &settings, &args.mirrors, &options, &interrupted)?;
    let mut renderer = Renderer::new(scene, still, settings, &options)?;

    let mut progress = Progress::new();
    let mut frames = Vec::new();
    let mut next = |(number, time): (usize, f64), frames: &mut Vec<Value>| -> Result<()> {
        let edit = Instant::now();
        job.camera = motion.camera(time).unwrap_or(still);
        if let Some(play) = &mut play {
            play.advance(time);
            if motion.camera(time).is_none() {
                job.camera = camera::follow(play.camera(shown.camera.camera.as_deref()), still, &shown.camera);
            }
            play.place(renderer.engine_mut()).map_err(|error| in_model(&args.scene, time, error))?;
        }
        let placed = renderer.engine_mut().place(&motion, job.camera, time);
        placed.map_err(|error| in_model(&args.scene, time, error))?;
        if job.camera.has_shutter() {
            let ends = ends(&motion, play.as_mut(), (job.camera, &shown.camera), time);
            let set = renderer.engine_mut().set_shutter_ends(Some(ends));
            set.map_err(|error| in_model(&args.scene, time, error))?;
        }
        let edit = edit.elapsed().as_secs_f64();
        let mut frame = render_frame(&mut renderer, job.settings.moving_passes)?;
        let write = Instant::now();
        if let Some(pattern) = &pattern {
            job.outputs = vec![pattern.name(number)];
            let statistics = renderer.statistics();
            let mut metadata = metadata(&job, &statistics.device, statistics.driver);
            metadata.passes = renderer.passes();
            let image = renderer.image(job.wanted())?;
            // Later frames keep the exposure of the first: a picture whose brightness follows its content would flicker.
            job.encoding.exposure = Exposure::Stops(job.encoding.exposure.stops(&image.color));
            job.write_outputs(&image, &metadata)?;
        }
        frame["frame"] = number.into();
        frame["time"] = time.into();
        frame["edit"] = edit.into();
        frame["write"] = write.elapsed().as_secs_f64().into();
        frames.push(frame);
        Ok(())
    };
    let mut failed = None;
    let all = motion.times.len();
    for (number, &time) in motion.times.iter().enumerate() {
        if interrupted.load(Ordering::Relaxed) {
            break;
        }
        if let Err(error) = next((number, time), &mut frames) {
            failed = Some(error);
            break;
        }
        let done = number + 1;
        progress.show(|| format!("frame {done} of {all}"), done as f64 / all as f64);
    }
    progress.finish();
    if frames.is_empty() {
        return Err(failed.unwrap_or(Error::Interrupted));
    }
    let count = frames.len();
    if let Some(path) = &args.timings {
        let written = write_timings(path, &job, &renderer, frames);
        match &failed {
            None => written?,
            Some(_) => written.unwrap_or_else(|error| log::warn!("the timings before the error are lost: {error}")),
        }
    }
    if let Some(error) = failed {
        say_aside(&format!("{count} of {all} frames were done before the error"));
        return Err(error);
    }
    if count < motion.times.len() {
        say_aside(&format!("interrupted after {count} of {} frames", motion.times.len()));
    }
    let place = args.output.iter().chain(&args.timings).map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
    let arrow = if place.is_empty() { "" } else { " -> " };
    let passes = job.settings.moving_passes;
    say(&format!("{}: {count} frames of {passes} passes in {}{arrow}{place}", job.name, duration(progress.elapsed())));
    Ok(())
}

/// Where camera and objects are as the shutter opens and closes around a time.
fn ends(
    motion: &Motion,
    mut play: Option<&mut Play>,
    (camera, flags): (Camera, &args::Camera),
    time: f64,
) -> [ShutterEnd; 2] {
    [-0.5, 0.5].map(|part| {
        let then = time + part * f64::from(camera.shutter);
        let (mut own, mut vertices) = (None, Vec::new());
        if let Some(play) = &mut play {
            play.advance(then);
            own = play.camera(flags.camera.as_deref());
            vertices = play.vertices();
        }
        let camera = motion.camera(then).unwrap_or_else(|| camera::follow(own, camera, flags));
        ShutterEnd::at(motion, camera, vertices, then)
    })
}

/// Attributes an error in the scene at some time of an animation to the model.
fn in_model(model: &Path, time: f64, error: Error) -> Error {
    match error {
        Error::Scene(message) => Error::file(model, format!("at {time} s of its animation: {message}")),
        error => error,
    }
}

/// Renders the passes of a frame; returns their times.
fn render_frame(renderer: &mut Renderer, passes: u32) -> Result<Value> {
    let before = renderer.engine().passes_unchanged();
    let (mut seconds, mut record) = (0.0, 0.0);
    let mut gpu_passes: BTreeMap<String, f64> = BTreeMap::new();
    for _ in 0..passes {
        renderer.pass()?;
        let times = renderer.last_pass();
        seconds += times.seconds;
        record += times.record;
        for (name, seconds) in &times.gpu_passes {
            *gpu_passes.entry(name.clone()).or_default() += seconds;
        }
    }
    let times = renderer.engine().edit_times();
    let parts = (before == 0).then(|| {
        json!({
            "vertices": times.vertices,
            "refit": times.refit,
            "top_level": times.top_level,
            "lights": times.lights,
            "staging": times.staging,
            "bytes": times.bytes,
        })
    });
    Ok(json!({
        "passes": renderer.passes(),
        "edit_parts": parts,
        "render": seconds,
        "record": record,
        "gpu_passes": gpu_passes,
        "mirror_pixels": mirrors::pixels(renderer)?,
    }))
}

fn write_timings(path: &Path, job: &Job, renderer: &Renderer, frames: Vec<Value>) -> Result<()> {
    let statistics = renderer.statistics();
    let value = json!({
        "scene": job.name,
        "device": statistics.device,
        "driver": statistics.driver,
        "resolution": job.camera.resolution,
        "triangles": statistics.triangles,
        "moving_passes": job.settings.moving_passes,
        "frames": frames,
    });
    // Numbers and strings only: serialisation cannot fail.
    let text = serde_json::to_string_pretty(&value).unwrap_or_default();
    output::write_file(path, &[text.as_bytes(), b"\n"])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_have_one_number() {
        for (pattern, name) in [("a/%04d.png", "a/0007.png"), ("f-%d.exr", "f-7.exr"), ("%3d.png", "007.png")] {
            assert_eq!(Pattern::new(Path::new(pattern)).unwrap().name(7), Path::new(name));
        }
        for wrong in ["a.png", "a%.png", "a%xd.png", "%d-%d.png", "%00d.png", "%99d.png"] {
            assert!(Pattern::new(Path::new(wrong)).is_err(), "{wrong}");
        }
    }
}
