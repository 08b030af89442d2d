//! Keys of camera and objects, recorded one by one and written as the path file that `animate` plays.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use glam::{DVec3, Vec3};
use lightsum::output::write_file;
use lightsum::scene::path::Pose;
use lightsum::scene::{Camera, Scene};
use lightsum::{Error, Result};

/// Seconds between two keys.
const STEP: f64 = 1.0;
/// Frames for each second.
const RATE: f64 = 24.0;

/// An object that was moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Axis of its rotation.
    pub axis: Vec3,
    /// Fixed point of rotation and scale.
    pub pivot: Vec3,
    /// Where it is.
    pub pose: Pose,
}

/// A moment of the path.
struct Key {
    camera: Camera,
    objects: BTreeMap<u32, Placed>,
}

/// The keys so far.
#[derive(Default)]
pub struct Route(Vec<Key>);

impl Route {
    /// Adds a key.
    pub fn add(&mut self, camera: Camera, objects: &BTreeMap<u32, Placed>) {
        self.0.push(Key { camera, objects: objects.clone() });
    }

    /// Removes the latest key.
    pub fn remove_last(&mut self) {
        self.0.pop();
    }

    /// Number of keys.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Writes the path. Errors: there is no key; an object has no name of its own; the file cannot be written.
    pub fn save(&self, path: &Path, scene: &Scene) -> Result<()> {
        if self.0.is_empty() {
            return Err(Error::file(path, "no key has been recorded; K records one"));
        }
        write_file(path, &[self.text(path, scene)?.as_bytes()])
    }

    fn text(&self, path: &Path, scene: &Scene) -> Result<String> {
        let numbers = |v: DVec3| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
        let short = |v: Vec3| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
        let time = |key: usize| key as f64 * STEP;
        let frames = 1 + (time(self.0.len() - 1) * RATE).round() as usize;
        // Writing to a string cannot fail.
        let mut text = format!("frames = {frames}\n");
        for (i, Key { camera, .. }) in self.0.iter().enumerate() {
            let (eye, target) = (numbers(scene.to_world(camera.eye)), numbers(scene.to_world(camera.target)));
            let shown = match camera.height {
                None => format!("fov = {:?}", camera.fov_y),
                Some(height) => format!("height = {height:?}"),
            };
            let _ = write!(text, "\n[[camera]]\ntime = {:?}\neye = {eye}\ntarget = {target}\n{shown}\n", time(i));
        }
        let moved: BTreeMap<u32, Placed> =
            self.0.iter().flat_map(|key| &key.objects).map(|(&object, &placed)| (object, placed)).collect();
        for (object, Placed { axis, pivot, .. }) in moved {
            let name = &scene.objects[object as usize];
            if scene.objects_named(name).len() > 1 {
                let message = format!(
                    "several objects are named {name:?}, and a path moves all of a name; rename the one that moved"
                );
                return Err(Error::file(path, message));
            }
            let (axis, pivot) = (short(axis), numbers(scene.to_world(pivot)));
            let _ = write!(text, "\n[[object]]\nname = {name:?}\naxis = {axis}\npivot = {pivot}\nkeys = [\n");
            for (i, key) in self.0.iter().enumerate() {
                let still = Pose::default();
                let pose = key.objects.get(&object).map_or(still, |placed| placed.pose);
                let _ = writeln!(
                    text,
                    "    {{ time = {:?}, translation = {}, degrees = {:?}, scale = {} }},",
                    time(i),
                    short(pose.translation),
                    pose.degrees,
                    short(pose.scale)
                );
            }
            text += "]\n";
        }
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightsum::scene::builtin;
    use lightsum::scene::path::Motion;

    #[test]
    fn a_path_that_was_recorded_plays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("walk.toml");
        let mut scene = builtin::room(500);
        scene.origin = DVec3::new(4096.0, 0.25, -3.0);
        let camera = scene.camera.unwrap();
        let mut route = Route::default();
        assert!(route.save(&path, &scene).unwrap_err().to_string().contains("no key"));
        route.add(camera, &BTreeMap::new());
        let object = scene.triangles.last().unwrap().object;
        let pose = Pose { translation: Vec3::new(0.1, 2.0, -1e-3), degrees: 33.3, scale: Vec3::splat(1.5) };
        let placed = Placed { axis: Vec3::Y, pivot: Vec3::new(1.25, 2.0, 3.0), pose };
        let later = Camera { eye: camera.eye + Vec3::new(0.125, 0.5, 0.0), fov_y: 51.7, ..camera };
        route.add(later, &BTreeMap::from([(object, placed)]));
        route.save(&path, &scene).unwrap();
        let motion = Motion::load(&path, &scene, camera).unwrap();
        assert_eq!((motion.times.len(), motion.times[24]), (25, 1.0));
        assert_eq!(motion.camera(0.0), Some(camera));
        assert_eq!(motion.camera(1.0), Some(later));
        assert_eq!(motion.objects.len(), 1);
        assert_eq!(motion.objects[0].objects, [object]);
        assert_eq!(motion.objects[0].transform(1.0), pose.transform(placed.axis, placed.pivot));
        assert_eq!(motion.objects[0].transform(0.0), glam::Affine3A::IDENTITY);
    }
}
