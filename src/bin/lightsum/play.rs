//! The animations of a model, played frame by frame.

use std::path::Path;

use glam::Vec3;
use lightsum::scene::{Animations, Camera, Scene};
use lightsum::{Engine, Error, Result};

use crate::camera;

/// Maximum number of frames.
pub const MAX_FRAMES: u32 = 1_000_000;

/// Frames per second unless said otherwise.
const FPS: f64 = 24.0;

/// A scene that follows its animations.
pub struct Play {
    /// The scene in the latest pose, without textures.
    scene: Scene,
    chosen: Vec<usize>,
    span: (f64, f64),
    /// The objects that move, with their vertices.
    objects: Vec<(u32, Vec<u32>)>,
}

/// Animations of a scene by name; `None`: the first, with a word about the others.
///
/// Errors: there is none, or none of this name; they name `flag`.
pub fn choose(scene: &Scene, name: Option<&str>, flag: &'static str) -> Result<Vec<usize>> {
    let Some(animations) = &scene.animations else {
        return Err(Error::Setting { name: flag, message: format!("{} has no animation", scene.name) });
    };
    let chosen = animations.choose(name).map_err(|message| Error::Setting { name: "--animation", message })?;
    if name.is_none() && animations.list.len() > 1 {
        log::warn!(
            "{}: its first animation is played, of {}; --animation chooses another, or all",
            scene.name,
            animations.names()
        );
    }
    Ok(chosen)
}

/// Poses a scene for a still image; does nothing without `name` and `at`. `at` in seconds; `None`: where the animation begins.
pub fn pose(scene: &mut Scene, path: &Path, name: Option<&str>, at: Option<f64>) -> Result<()> {
    if name.is_none() && at.is_none() {
        return Ok(());
    }
    let chosen = choose(scene, name, if at.is_some() { "--at" } else { "--animation" })?;
    let start = scene.animations.as_ref().map_or(0.0, |animations| animations.span(&chosen).0);
    scene.set_pose(&chosen, at.unwrap_or(start));
    // The pose may leave triangles without area.
    scene.validate(path)
}

impl Play {
    /// The animation of this name in a scene. Errors: see [`choose`].
    pub fn new(scene: &Scene, name: Option<&str>, flag: &'static str) -> Result<Play> {
        let chosen = choose(scene, name, flag)?;
        let mut moves = vec![false; scene.positions.len()];
        let animations = scene.animations.as_deref();
        let moving = animations.map(Animations::vertices).unwrap_or_default();
        moving.into_iter().for_each(|range| moves[range].fill(true));
        let has_moving = |(_, vertices): &(_, Vec<u32>)| vertices.iter().any(|&v| moves[v as usize]);
        let objects = (0..).zip(scene.vertices_of_objects()).filter(has_moving).collect();
        let span = animations.map_or((0.0, 0.0), |animations| animations.span(&chosen));
        let scene = Scene { textures: Vec::new(), ..scene.clone() };
        Ok(Play { scene, chosen, span, objects })
    }

    /// Times of the frames, seconds. `frames` alone: spread evenly over the animation, both ends included. `fps`: that many each second,
    /// all of the animation, or `frames` of them, which start again after its end.
    pub fn times(&self, frames: Option<u32>, fps: Option<f64>) -> Result<Vec<f64>> {
        let (start, end) = self.span;
        let length = end - start;
        Ok(match (frames, fps) {
            (Some(frames), None) => {
                let step = length / f64::from(frames.saturating_sub(1).max(1));
                (0..frames).map(|i| start + step * f64::from(i)).collect()
            }
            (None, fps) => {
                let fps = fps.unwrap_or(FPS);
                // Rounding must not cost the frame at the end.
                let last = (length * fps + 1e-4).floor();
                if last >= f64::from(MAX_FRAMES) {
                    let message =
                        format!("an animation of {length} s at {fps} frames/s has more than {MAX_FRAMES} frames");
                    return Err(Error::Setting { name: "--frames", message });
                }
                (0..=last as u32).map(|i| (start + f64::from(i) / fps).min(end)).collect()
            }
            (Some(frames), Some(fps)) => (0..frames)
                .map(|i| {
                    let since = f64::from(i) / fps;
                    start + if length > 0.0 { since % length } else { 0.0 }
                })
                .collect(),
        })
    }

    /// Where the animation begins, seconds.
    pub fn start(&self) -> f64 {
        self.span.0
    }

    /// The scene in its latest pose, without textures.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Takes the pose of a time.
    pub fn advance(&mut self, time: f64) {
        self.scene.set_pose(&self.chosen, time);
    }

    /// A camera of the scene: that of the name, or the scene's own.
    pub fn camera(&self, name: Option<&str>) -> Option<Camera> {
        camera::named(&self.scene, name)
    }

    /// Vertices of the objects that move, in the latest pose.
    pub fn vertices(&self) -> Vec<(u32, Vec<Vec3>)> {
        let place = |&v: &u32| self.scene.positions[v as usize];
        self.objects.iter().map(|(object, vertices)| (*object, vertices.iter().map(place).collect())).collect()
    }

    /// Gives an engine of this scene the pose.
    pub fn place(&self, engine: &mut Engine) -> Result<()> {
        for (object, vertices) in &self.objects {
            let take = |of: &[Vec3]| -> Vec<Vec3> { vertices.iter().map(|&v| of[v as usize]).collect() };
            engine.set_vertices(*object, &take(&self.scene.positions), Some(&take(&self.scene.normals)))?;
        }
        let lights = self.scene.animations.iter().flat_map(|animations| animations.lights());
        for light in lights {
            engine.set_light(light as u32, self.scene.lights[light])?;
        }
        Ok(())
    }
}
