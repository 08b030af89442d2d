//! Motion while the shutter is open, for [`crate::pass::velocity`].

use std::collections::BTreeMap;

use glam::{Affine3A, Vec3};

use super::Engine;
use super::edit::{DynamicScene, refused};
use crate::accel::Bvh;
use crate::error::{Error, Result};
use crate::pass::velocity::Moving;
use crate::scene::Camera;
use crate::scene::path::Motion;

/// Where camera and objects are as the shutter opens or closes.
#[derive(Clone, Debug, PartialEq)]
pub struct ShutterEnd {
    /// The camera; only its place, direction and angle of view, or height, count.
    pub camera: Camera,
    /// The objects that are elsewhere than now.
    pub objects: Vec<PosedObject>,
}

/// Pose of an object, as [`Engine::set_transform`] and [`Engine::set_vertices`] set it.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedObject {
    /// The object.
    pub object: u32,
    /// Maps its initial position, or `vertices`, to where it is.
    pub transform: Affine3A,
    /// Its vertices before the transform; `None`: as they are now.
    pub vertices: Option<Vec<Vec3>>,
}

/// Motion, and whether the device has it.
#[derive(Default)]
pub(super) struct Moves {
    pub ends: Option<[ShutterEnd; 2]>,
    pub staged: bool,
}

impl Engine {
    /// Sets where camera and objects are as the shutter opens and as it closes; `None`: nothing moves meanwhile. It stays so until it is set
    /// again. The scene as it is now is that in the middle of this time: what a pixel shows is blurred by half of the motion to either side.
    /// Without effect while [`Camera::shutter`] is 0. Restarts if it differs. A view that is orthographic where the one before was not, or the other way
    /// round, drops it.
    ///
    /// Errors, which leave everything unchanged: a camera out of range, of another resolution, or orthographic where the view is not; an object that does not exist, with another
    /// number of vertices, or whose vertices would not be finite; objects in an engine of a static scene.
    pub fn set_shutter_ends(&mut self, ends: Option<[ShutterEnd; 2]>) -> Result<()> {
        if ends == self.shutter.ends {
            return Ok(());
        }
        for end in ends.iter().flatten() {
            self.check_end(end)?;
        }
        self.shutter = Moves { ends, staged: false };
        if self.plan.view.has_shutter() {
            self.changed();
        }
        Ok(())
    }

    fn check_end(&self, end: &ShutterEnd) -> Result<()> {
        end.camera
            .check()
            .map_err(|message| Error::Scene(format!("camera at an end of the shutter's time: {message}")))?;
        let whole = self.plan.view.within().size;
        if end.camera.resolution != whole {
            let [width, height] = whole;
            return Err(Error::Setting {
                name: "--resolution",
                message: format!("the cameras at both ends of the shutter's time have {width}x{height} pixels as well"),
            });
        }
        if end.camera.is_orthographic() != self.plan.view.is_orthographic() {
            let message =
                "the cameras at both ends of the shutter's time are orthographic if the camera is, or none is";
            return Err(Error::Setting { name: "camera", message: String::from(message) });
        }
        if end.objects.is_empty() {
            return Ok(());
        }
        let moving = self.dynamic.as_deref().ok_or_else(super::edit::still)?;
        end.objects.iter().try_for_each(|posed| moving.posed(posed).map(drop))
    }

    /// The cameras as the shutter opens and as it closes, and the triangles that move meanwhile; `None`: it is open for an instant.
    pub fn while_open(&self) -> Option<([Camera; 2], Moving)> {
        let camera = *self.plan.view.camera()?;
        if !self.plan.view.has_shutter() {
            return None;
        }
        Some(match (&self.shutter.ends, &self.dynamic) {
            (None, _) => ([camera; 2], Moving::default()),
            (Some(ends), None) => (ends.each_ref().map(|end| end.camera), Moving::default()),
            (Some(ends), Some(dynamic)) => {
                (ends.each_ref().map(|end| end.camera), dynamic.between(ends, &self.scene.bvh))
            }
        })
    }

    /// Stages what moves, if the device does not know it yet.
    pub(super) fn stage_shutter(&mut self) -> Result<()> {
        let (Some(&camera), false) = (self.plan.view.camera(), self.shutter.staged) else { return Ok(()) };
        let (true, Some((cameras, moving))) = (self.frame.velocity.is_some(), self.while_open()) else { return Ok(()) };
        let mut staging = self.take_staging();
        let staged = match &self.frame.velocity {
            None => Ok(()),
            Some(velocity) => velocity.stage(&self.context, &mut staging, (&camera, cameras.each_ref()), &moving),
        };
        self.keep_staging(staging);
        self.shutter.staged = staged.is_ok();
        staged
    }
}

impl ShutterEnd {
    /// The end at a time of a path, in seconds. `vertices`: those that an animation gives to objects at that time.
    pub fn at(motion: &Motion, camera: Camera, vertices: Vec<(u32, Vec<Vec3>)>, time: f64) -> ShutterEnd {
        let posed =
            |(object, vertices)| PosedObject { object, transform: Affine3A::IDENTITY, vertices: Some(vertices) };
        let mut objects: Vec<PosedObject> = vertices.into_iter().map(posed).collect();
        for track in &motion.objects {
            let transform = track.transform(time);
            for &object in &track.objects {
                match objects.iter_mut().find(|posed| posed.object == object) {
                    Some(posed) => posed.transform = transform,
                    None => objects.push(PosedObject { object, transform, vertices: None }),
                }
            }
        }
        ShutterEnd { camera, objects }
    }
}

impl DynamicScene {
    /// Vertices of an object in a pose.
    fn posed(&self, posed: &PosedObject) -> Result<Vec<Vec3>> {
        let name = self.name(posed.object)?;
        let rest = &self.rest_positions[self.vertices[posed.object as usize].clone()];
        let vertices = posed.vertices.as_deref().unwrap_or(rest);
        if vertices.len() != rest.len() {
            let message = format!("it has {} vertices, {} are given", rest.len(), vertices.len());
            return Err(refused(&name, &message));
        }
        let still = posed.transform == Affine3A::IDENTITY;
        let place = |&p: &Vec3| if still { p } else { posed.transform.transform_point3(p) };
        let places: Vec<Vec3> = vertices.iter().map(place).collect();
        match places.iter().find(|p| !p.is_finite()) {
            Some(p) => Err(refused(&name, &format!("as the shutter opens or closes a vertex would be at {p}"))),
            None => Ok(places),
        }
    }

    /// How the triangles of a tree move between two ends.
    fn between(&self, ends: &[ShutterEnd; 2], bvh: &Bvh) -> Moving {
        // The poses were checked when they were set; vertices may have been replaced since, but not their number.
        let places = ends.each_ref().map(|end| -> BTreeMap<u32, Vec<Vec3>> {
            end.objects.iter().filter_map(|posed| Some((posed.object, self.posed(posed).ok()?))).collect()
        });
        let mut moving = Moving { of_triangle: vec![0; bvh.triangle_count() as usize], displacements: Vec::new() };
        for (leaf, number) in (0..).zip(&mut moving.of_triangle) {
            let triangle = &self.scene.triangles[bvh.scene_triangle(leaf) as usize];
            let first = self.vertices[triangle.object as usize].start;
            let moved = places.each_ref().map(|places| {
                let places = places.get(&triangle.object);
                triangle.vertices.map(|v| {
                    places.map_or(Vec3::ZERO, |places| places[v as usize - first] - self.scene.positions[v as usize])
                })
            });
            if moved != [[Vec3::ZERO; 3]; 2] {
                moving.displacements.push(moved);
                *number = moving.displacements.len() as u32;
            }
        }
        moving
    }
}
