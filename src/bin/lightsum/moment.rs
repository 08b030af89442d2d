//! The moment that an image shows, and what moves around it while the shutter is open: a path, an animation of the model, or both.

use std::path::Path;

use glam::{Affine3A, Vec3};
use lightsum::engine::{PosedObject, ShutterEnd};
use lightsum::scene::path::Motion;
use lightsum::scene::{Camera, Scene};
use lightsum::{Error, Result};

use crate::args::{self, Render};
use crate::{camera, play};

/// The moment that an image shows.
pub struct Moment<'a> {
    /// The camera at that moment.
    pub camera: Camera,
    /// Seconds.
    time: f64,
    model: &'a Path,
    flags: &'a args::Camera,
    /// The model as it rests, if something may move it, or the camera.
    rest: Option<Scene>,
    /// Animations that are played.
    chosen: Vec<usize>,
    motion: Option<Motion>,
}

impl<'a> Moment<'a> {
    /// Poses a scene by the flags, and chooses its camera.
    pub fn of(scene: &mut Scene, model: &'a Path, args: &'a Render) -> Result<Moment<'a>> {
        let (name, at) = (args.pose.animation.as_deref(), args.pose.at);
        // Beside a path the time is that of the path, and an animation is played if it is named.
        let plays = name.is_some() || at.is_some() && args.path.is_none();
        let open = args.camera.shutter.or(scene.camera.map(|camera| camera.shutter)).unwrap_or(0.0) > 0.0;
        let mut rest = (args.path.is_some() || open && plays).then(|| scene.clone());
        let (mut chosen, mut time) = (Vec::new(), at);
        if plays {
            chosen = play::choose(scene, name, if at.is_some() { "--at" } else { "--animation" })?;
            let start = scene.animations.as_ref().map_or(0.0, |animations| animations.span(&chosen).0);
            if args.path.is_none() {
                time = time.or(Some(start));
            }
        }
        let motion = match (&args.path, &rest) {
            (Some(path), Some(rest)) => {
                // Its camera gives what the keys leave out, as the model's animation has it.
                let first = camera::choose(scene, &args.camera, args.output.resolution)?;
                let motion = Motion::load(path, rest, first)?;
                time = time.or(motion.times.first().copied());
                Some(motion)
            }
            _ => None,
        };
        let time = time.unwrap_or(0.0);
        if plays {
            scene.set_pose(&chosen, time);
        }
        let mut camera = camera::choose(scene, &args.camera, args.output.resolution)?;
        if let Some(motion) = &motion {
            motion.pose(scene, time)?;
            scene.files.extend(args.path.clone());
            camera = motion.camera(time).unwrap_or(camera);
        }
        if plays || motion.is_some() {
            // The pose may leave triangles without area.
            scene.validate(model)?;
        }
        rest = rest.filter(|_| camera.has_shutter());
        Ok(Moment { camera, time, model, flags: &args.camera, rest, chosen, motion })
    }

    /// Whether something may move while the shutter is open.
    pub fn moves(&self) -> bool {
        self.rest.is_some()
    }

    /// Scene and camera at a part, in [0, 1], of the time for which the shutter is open.
    pub fn at(&self, part: f64) -> Result<(Scene, Camera)> {
        let time = self.time + (part - 0.5) * f64::from(self.camera.shutter);
        let Some(rest) = &self.rest else {
            let message = String::from("nothing moves");
            return Err(Error::Setting { name: "--shutter", message });
        };
        let mut scene = rest.clone();
        if !self.chosen.is_empty() {
            scene.set_pose(&self.chosen, time);
        }
        let camera = match self.motion.as_ref().and_then(|motion| motion.camera(time)) {
            Some(camera) => camera,
            None if self.chosen.is_empty() => self.camera,
            None => camera::follow(camera::named(&scene, self.flags.camera.as_deref()), self.camera, self.flags),
        };
        if let Some(motion) = &self.motion {
            motion.pose(&mut scene, time)?;
        }
        scene.validate(self.model)?;
        Ok((scene, camera))
    }

    /// Motion of `scene` for an engine in the pose of the moment; `None`: nothing moves.
    pub fn ends(&self, scene: &Scene) -> Result<Option<[ShutterEnd; 2]>> {
        if !self.moves() {
            return Ok(None);
        }
        let now = positions(scene);
        let end = |part: f64| -> Result<ShutterEnd> {
            let (then, camera) = self.at(part)?;
            let moved = (0..).zip(positions(&then)).zip(&now).filter(|((_, then), now)| then != *now);
            let posed = |((object, vertices), _)| PosedObject {
                object,
                transform: Affine3A::IDENTITY,
                vertices: Some(vertices),
            };
            Ok(ShutterEnd { camera, objects: moved.map(posed).collect() })
        };
        Ok(Some([end(0.0)?, end(1.0)?]))
    }
}

/// Vertices of each object.
fn positions(scene: &Scene) -> Vec<Vec<Vec3>> {
    let of = |vertices: Vec<u32>| vertices.into_iter().map(|v| scene.positions[v as usize]).collect();
    scene.vertices_of_objects().into_iter().map(of).collect()
}
