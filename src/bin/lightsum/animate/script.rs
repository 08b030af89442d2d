//! The frames of an animation, and the objects that move in it.

use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use glam::{Affine3A, Vec3};
use lightsum::engine::ShutterEnd;
use lightsum::output::{self, Encoding, Format};
use lightsum::scene::{self, Camera, Light, Scene, path::Motion};
use lightsum::{Error, Result};

use super::pattern::Pattern;
use crate::args::{self, Animate};
use crate::play::Play;
use crate::progress::duration;
use crate::render::{Job, moving_settings};
use crate::{camera, effect, mirrors, say};

/// The frames of an animation, and the objects that move in it.
pub struct Script<'a> {
    pub args: &'a Animate,
    pub job: Job,
    /// Times of the frames, camera and objects.
    pub(super) motion: Motion,
    pub(super) play: Option<Play>,
    /// The camera where nothing moves it.
    pub(super) still: Camera,
    pattern: Option<Pattern>,
}

impl<'a> Script<'a> {
    /// Reads scene and path, and checks the flags.
    pub fn new(args: &'a Animate) -> Result<(Script<'a>, Scene)> {
        let shown = &args.shown;
        let pattern = args.output.as_deref().map(Pattern::new).transpose()?;
        let count = args.play.frames.as_ref().and_then(|frames| frames.count);
        if count.is_some() && args.path.is_some() {
            let message = String::from("the file of --path has the number of frames; give A..B for a part of them");
            return Err(Error::Setting { name: "--frames", message });
        }
        let start = Instant::now();
        let mut scene = scene::load_with(&args.scene, &shown.reading.options())?;
        shown.keys.override_scene(&mut scene, "animate")?;
        shown.kept.read(&mut scene)?;
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
            (None, Some(play)) => Motion::still(play.times(count, args.play.fps)?),
            (None, None) => Motion::still(Vec::new()),
        };
        let settings = moving_settings(&scene.render, still.resolution)?;
        effect::warn(&shown.keys.typed(), &settings, &scene);
        let moves = play.is_some() || !motion.objects.is_empty();
        shown.kept.check_still(moves)?;
        if mirrors::wanted(&scene.render) && moves {
            let message = String::from("images show a scene that stands still, and objects move here; use rays");
            return Err(Error::Setting { name: "--mirror-source", message });
        }
        let job = Job {
            name: scene.name.clone(),
            camera: still,
            origin: scene.origin,
            settings,
            outputs: Vec::new(),
            encoding: Encoding {
                float: args.float,
                color_only: !args.layers,
                exposure: shown.exposure.or(scene.render.exposure).unwrap_or_default(),
                tonemap: shown.tonemap.into(),
            },
            denoise: false,
            crop: None,
            surfaces: args.surfaces,
            stages: vec![("load".into(), start.elapsed().as_secs_f64())],
        };
        let script = Script { args, job, motion, play, still, pattern };
        effect::warn_display(shown.exposure, shown.tonemap, script.output(0).as_slice());
        let layers = [("--float", args.float), ("--layers", args.layers), ("--surfaces", args.surfaces)];
        effect::warn_layers(&layers, script.output(0).as_slice());
        script.check_part()?;
        let inputs: Vec<PathBuf> = scene.files.iter().chain(&args.path).cloned().collect();
        let outputs: Vec<PathBuf> =
            script.outputs(script.part()).into_iter().chain(args.timings.clone()).chain(args.stats.clone()).collect();
        output::check_apart(outputs.iter().map(PathBuf::as_path), &inputs)?;
        Ok((script, scene))
    }

    /// Whether images are for display, and not of radiance.
    pub fn is_for_display(&self) -> bool {
        self.output(0).is_some_and(|path| Format::of(&path).is_ok_and(|format| format == Format::Png))
    }

    /// Whether others render frames of it too.
    pub(super) fn is_part_of_many(&self) -> bool {
        self.part() != (0..self.motion.times.len())
    }

    /// Refuses frames that there are not, or that need those before them.
    fn check_part(&self) -> Result<()> {
        let Some(part) = self.args.play.frames.as_ref().and_then(|frames| frames.part.clone()) else { return Ok(()) };
        let all = self.motion.times.len();
        let refuse = |message: String| Err(Error::Setting { name: "--frames", message });
        if part.end > all {
            return refuse(format!("{}..{} reach beyond the animation, which has {all} frames", part.start, part.end));
        }
        if part.start > 0 && self.job.settings.ring.is_some() {
            return refuse(String::from(
                "a ring carries light from frame to frame; render from frame 0 on, or without --ring",
            ));
        }
        Ok(())
    }

    /// The frames to render.
    pub fn part(&self) -> Range<usize> {
        let part = self.args.play.frames.as_ref().and_then(|frames| frames.part.clone());
        part.unwrap_or(0..self.motion.times.len())
    }

    /// The image of a frame; `None`: no image is written.
    pub fn output(&self, frame: usize) -> Option<PathBuf> {
        Some(self.pattern.as_ref()?.name(frame))
    }

    /// The images of frames.
    pub fn outputs(&self, frames: Range<usize>) -> Vec<PathBuf> {
        frames.filter_map(|frame| self.output(frame)).collect()
    }

    /// The last line: a summary and the names of the files.
    pub fn say_where(&self, count: usize, elapsed: Duration) {
        let files = self.args.output.iter().chain(&self.args.timings).chain(&self.args.stats);
        let place = files.map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
        let arrow = if place.is_empty() { "" } else { " -> " };
        let (name, passes) = (&self.job.name, self.job.settings.moving_passes);
        say(&format!("{name}: {count} frames of {passes} passes in {}{arrow}{place}", duration(elapsed)));
    }

    /// Camera and poses of all that moves, at a time.
    fn pose(&mut self, time: f64) -> Pose {
        let camera = self.camera(time);
        let objects = self.motion.objects.iter().map(|track| track.transform(time)).collect();
        let (mut vertices, mut normals, mut lights) = Default::default();
        if let Some(play) = &self.play {
            let scene = play.scene();
            (vertices, normals, lights) = (scene.positions.clone(), scene.normals.clone(), scene.lights.clone());
        }
        let ends = camera.has_shutter().then(|| self.ends(camera, time));
        Pose { camera, objects, vertices, normals, lights, ends }
    }

    /// Plays the animation to a time; returns the camera.
    pub(super) fn camera(&mut self, time: f64) -> Camera {
        let own = self.motion.camera(time);
        let Some(play) = &mut self.play else { return own.unwrap_or(self.still) };
        play.advance(time);
        let flags = &self.args.shown.camera;
        own.unwrap_or_else(|| camera::follow(play.camera(flags.camera.as_deref()), self.still, flags))
    }

    /// Where camera and objects are as the shutter opens and closes around a time.
    pub(super) fn ends(&mut self, camera: Camera, time: f64) -> [ShutterEnd; 2] {
        ends(&self.motion, self.play.as_mut(), (camera, &self.args.shown.camera), time)
    }

    /// Whether anything moves between the frame before and this one.
    fn moves_to(&mut self, frame: usize) -> bool {
        let [before, now] = [frame - 1, frame].map(|frame| self.pose(self.motion.times[frame]));
        before != now
    }

    /// The first of the frames up to this one between which nothing moves: they accumulate.
    pub fn first_of_still(&mut self, frame: usize) -> usize {
        (1..=frame).rev().find(|&frame| self.moves_to(frame)).unwrap_or(0)
    }

    /// The end of the first frames of these between which nothing moves.
    #[cfg(feature = "mpi")]
    pub fn end_of_still(&mut self, frames: Range<usize>) -> usize {
        (frames.start + 1..frames.end).find(|&frame| self.moves_to(frame)).unwrap_or(frames.end)
    }
}

/// All that moves.
#[derive(PartialEq)]
struct Pose {
    camera: Camera,
    objects: Vec<Affine3A>,
    vertices: Vec<Vec3>,
    normals: Vec<Vec3>,
    lights: Vec<Light>,
    ends: Option<[ShutterEnd; 2]>,
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
