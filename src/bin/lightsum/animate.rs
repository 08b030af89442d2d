//! `lightsum animate`: loads a scene once and renders frames with a moving camera and moving objects, by a recorded path, by an
//! animation of the model, or by both.

mod pattern;
mod script;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use lightsum::output::{self, Layers, Metadata, Statistics};
use lightsum::scene::Scene;
use lightsum::settings::{Exposure, Traversal};
use lightsum::standalone::{RenderOptions, Renderer};
use lightsum::{Error, Result};
use serde_json::{Value, json};

use crate::args::Animate;
use crate::progress::Progress;
use crate::render::{Job, metadata, pipeline_cache};
use crate::stop::watch_for_interrupt;
use crate::{mirrors, say_aside, speak};
pub use script::Script;

/// Runs the command.
pub fn run(args: &Animate) -> Result<()> {
    let (script, scene) = Script::new(args)?;
    let part = script.part();
    let outputs = script.outputs(part.clone());
    let files = || outputs.iter().take(1).chain(&args.timings).chain(&args.stats);
    files().try_for_each(|file| output::check_writable(file))?;
    let claimed: Vec<&Path> = files().map(PathBuf::as_path).collect();
    let _claim = output::claim(claimed)?;
    speak::leave_output_to(files().map(PathBuf::as_path));
    output::remove_leftovers(outputs.iter().map(PathBuf::as_path));
    let interrupted = watch_for_interrupt();
    let mut player = Player::new(script, scene, None, &interrupted)?;

    let mut progress = Progress::new();
    let (mut frames, mut failed, mut opened_again) = (Vec::new(), None, false);
    let all = part.len();
    let before_error = |count: usize| say_aside(&format!("{count} of {all} frames were done before the error"));
    for number in part {
        if interrupted.load(Ordering::Relaxed) {
            break;
        }
        let mut written = player.write(number);
        if let (Err(error @ Error::DeviceLost { .. }), false) = (&written, opened_again) {
            log::warn!("{error}; opening it once more");
            opened_again = true;
            if !frames.is_empty() {
                keep_times(&player, &frames);
            }
            player = player.open_again().inspect_err(|_| before_error(frames.len()))?;
            say_aside(&format!("the device was lost; the animation goes on with frame {number}"));
            written = player.write(number);
        }
        match written {
            Ok(frame) => frames.push(frame),
            Err(error) => {
                failed = Some(error);
                break;
            }
        }
        let done = frames.len();
        progress.show(|| format!("frame {done} of {all}"), done as f64 / all as f64);
    }
    progress.finish();
    let count = frames.len();
    if count == 0 {
        return Err(failed.unwrap_or(Error::Interrupted));
    }
    if let Some(error) = failed {
        keep_times(&player, &frames);
        before_error(count);
        return Err(error);
    }
    write_timings(&player, &frames)?;
    write_statistics(&player, &frames)?;
    if count < all {
        say_aside(&format!("interrupted after {count} of {all} frames"));
    }
    player.script.say_where(count, progress.elapsed());
    Ok(())
}

/// After an error: writes the times of the frames before it.
fn keep_times(player: &Player, frames: &[Value]) {
    write_timings(player, frames).unwrap_or_else(|error| log::warn!("the timings before the error are lost: {error}"));
    write_statistics(player, frames)
        .unwrap_or_else(|error| log::warn!("the statistics before the error are lost: {error}"));
}

/// Writes the times of frames, if they are wanted.
fn write_timings(player: &Player, frames: &[Value]) -> Result<()> {
    let Some(path) = &player.script.args.timings else { return Ok(()) };
    let statistics = player.renderer.statistics();
    let of_device = (statistics.device.as_str(), statistics.driver.as_str(), statistics.triangles);
    write_json(path, &timings(&player.script.job, of_device, frames.to_vec()))
}

/// Writes the statistics, if they are wanted: since the device was opened.
fn write_statistics(player: &Player, frames: &[Value]) -> Result<()> {
    let Some(path) = &player.script.args.stats else { return Ok(()) };
    let writing: f64 = frames.iter().filter_map(|frame| frame["write"].as_f64()).sum();
    let job = &player.script.job;
    let statistics = player.renderer.statistics();
    let stages = job.stages.iter().chain(&statistics.stages).cloned();
    let stages = stages.chain([(String::from("write"), writing)]).collect();
    Statistics { resolution: job.camera.resolution, stages, ..statistics }.write(path)
}

/// Renders the frames of a script.
pub struct Player<'a> {
    pub script: Script<'a>,
    pub renderer: Renderer,
    /// The frame that follows what was rendered.
    next: usize,
}

/// A frame.
pub struct Frame {
    /// Its times as JSON.
    pub timings: Value,
    /// The image, if one is written, and its provenance.
    pub image: Option<(Layers, Metadata)>,
}

impl<'a> Player<'a> {
    /// Opens the device. `traversal`: the kernel where the flags leave it open; `None`: the faster one, for the whole animation.
    pub fn new(
        script: Script<'a>,
        mut scene: Scene,
        traversal: Option<Traversal>,
        interrupted: &AtomicBool,
    ) -> Result<Player<'a>> {
        // Frames that several machines render shall not differ by what each of them measured.
        let traversal = traversal.or(script.is_part_of_many().then_some(Traversal::Auto));
        let options = options(&script, &scene, traversal);
        mirrors::sample(&mut scene, &script.job.settings, &options, interrupted)?;
        let renderer = Renderer::new(scene, script.still, script.job.settings.clone(), &options)?;
        Ok(Player { script, renderer, next: 0 })
    }

    /// Opens a lost device once more. Any frame may follow.
    fn open_again(self) -> Result<Player<'a>> {
        let Player { script, renderer, .. } = self;
        let traversal = renderer.provenance().traversal;
        let scene = renderer.into_scene();
        let options = options(&script, &scene, Some(traversal));
        let renderer = Renderer::new(scene, script.still, script.job.settings.clone(), &options)?;
        Ok(Player { script, renderer, next: 0 })
    }

    /// Renders a frame and writes its image; returns its times.
    fn write(&mut self, number: usize) -> Result<Value> {
        let Frame { mut timings, image } = self.frame(number)?;
        let write = Instant::now();
        if let Some((layers, metadata)) = image {
            self.script.job.outputs = self.script.output(number).into_iter().collect();
            self.script.job.write_outputs(&layers, &metadata)?;
        }
        timings["write"] = write.elapsed().as_secs_f64().into();
        Ok(timings)
    }

    /// Renders a frame, with what it needs of the frames before: the exposure of the first, and the passes of those between which nothing
    /// moves.
    pub fn frame(&mut self, number: usize) -> Result<Frame> {
        if number != self.next {
            if number > 0 && self.script.job.encoding.exposure == Exposure::Auto && self.script.is_for_display() {
                self.start(0);
                self.in_turn(0)?;
            }
            // A ring carries light from frame to frame.
            let first = match self.script.job.settings.ring {
                Some(_) => 0,
                None => self.script.first_of_still(number),
            };
            self.start(first);
            for before in first..number {
                self.in_turn(before)?;
            }
        }
        self.in_turn(number)
    }

    /// Starts anew with a frame.
    fn start(&mut self, number: usize) {
        self.renderer.engine_mut().restart();
        self.next = number;
    }

    /// Renders the next frame.
    fn in_turn(&mut self, number: usize) -> Result<Frame> {
        let edit = self.place(number)?;
        let mut timings = render_frame(&mut self.renderer, self.script.job.settings.moving_passes)?;
        timings["edit"] = edit.into();
        self.finish(number, timings)
    }

    /// Moves camera and objects to where they are in a frame; returns the seconds that it took.
    pub fn place(&mut self, number: usize) -> Result<f64> {
        let edit = Instant::now();
        let script = &mut self.script;
        let time = script.motion.times[number];
        let in_model = |error| in_model(&script.args.scene, time, error);
        script.job.camera = script.camera(time);
        let engine = self.renderer.engine_mut();
        if let Some(play) = &script.play {
            play.place(engine).map_err(in_model)?;
        }
        engine.place(&script.motion, script.job.camera, time).map_err(in_model)?;
        if script.job.camera.has_shutter() {
            let ends = script.ends(script.job.camera, time);
            engine.set_shutter_ends(Some(ends)).map_err(in_model)?;
        }
        Ok(edit.elapsed().as_secs_f64())
    }

    /// The frame whose passes are rendered. `timings`: of them.
    pub fn finish(&mut self, number: usize, mut timings: Value) -> Result<Frame> {
        let script = &mut self.script;
        timings["frame"] = number.into();
        timings["time"] = script.motion.times[number].into();
        let mut image = None;
        if let Some(output) = script.output(number) {
            script.job.outputs = vec![output];
            let statistics = self.renderer.statistics();
            let mut metadata = metadata(&script.job, &statistics.device, statistics.driver);
            metadata.passes = self.renderer.passes();
            let mut layers = self.renderer.image(script.job.wanted())?;
            script.job.add_surfaces(&mut layers, &self.renderer);
            // Later frames keep the exposure of the first: a picture whose brightness follows its content would flicker.
            script.job.encoding.exposure = Exposure::Stops(script.job.encoding.exposure.stops(&layers.color));
            image = Some((layers, metadata));
        }
        self.next = number + 1;
        Ok(Frame { timings, image })
    }
}

/// How to render. `traversal`: the kernel where the flags leave it open; `None`: the faster one.
fn options(script: &Script, scene: &Scene, traversal: Option<Traversal>) -> RenderOptions {
    let device = &script.args.shown.device;
    RenderOptions {
        device: device.device.clone().unwrap_or_default(),
        validation: device.validation,
        max_memory: device.max_device_memory,
        pipeline_cache: pipeline_cache(),
        traversal,
        // Where nothing but the camera moves the scene may hold images of itself, and light that was kept.
        dynamic: !mirrors::wanted(&scene.render) && scene.kept_light.is_none(),
        ..RenderOptions::default()
    }
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

/// The times of frames as JSON. `device`, `driver`: what rendered them; `triangles`: those of the scene.
pub fn timings(job: &Job, (device, driver, triangles): (&str, &str, u64), frames: Vec<Value>) -> Value {
    json!({
        "scene": job.name,
        "device": device,
        "driver": driver,
        "resolution": job.camera.resolution,
        "triangles": triangles,
        "moving_passes": job.settings.moving_passes,
        "frames": frames,
    })
}

/// Writes JSON to a file.
pub fn write_json(path: &Path, value: &Value) -> Result<()> {
    // Numbers and strings only: serialisation cannot fail.
    let text = serde_json::to_string_pretty(value).unwrap_or_default();
    output::write_file(path, &[text.as_bytes(), b"\n"])
}
