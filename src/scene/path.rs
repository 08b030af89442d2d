//! A recorded path: keyframes of camera and objects.
//!
//! ```toml
//! frames = 24                     # spread evenly from the first key to the last; or times = [0.0, 0.5, 2.0]
//!
//! [[camera]]                      # keys in the order of time; missing values are the scene's
//! time = 0.0                      # seconds
//! eye = [0, 1, 4]
//! target = [0, 1, 0]
//! fov = 40                        # vertical angle of view, degrees; of an orthographic camera: height = 3
//!
//! [[object]]
//! name = "box"                    # all objects of this name
//! axis = [0, 1, 0]                # of the rotation (default)
//! pivot = [0, 0.5, 0]             # fixed point of rotation and scale (default: centre of the object's bounding box)
//! keys = [
//!     { time = 0.0, translation = [0, 0, 0], degrees = 0, scale = 1 },
//!     { time = 2.0, translation = [1, 0, 0], degrees = 90, scale = [1, 2, 1] },
//! ]
//! ```
//!
//! Between keys every number is interpolated linearly; before the first key and after the last it is constant.

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::{Affine3A, DVec3, Quat, Vec3};
use serde::Deserialize;
use toml::Spanned;

use super::{Camera, Scene};
use crate::error::{Error, Result};

/// Maximum number of frames.
const MAX_FRAMES: usize = 1_000_000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    frames: Option<Spanned<usize>>,
    times: Option<Spanned<Vec<f64>>>,
    #[serde(default)]
    camera: Vec<Spanned<CameraKey>>,
    #[serde(default)]
    object: Vec<ObjectEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraKey {
    time: f64,
    eye: Option<DVec3>,
    target: Option<DVec3>,
    fov: Option<f32>,
    height: Option<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectEntry {
    name: Spanned<String>,
    axis: Option<Spanned<Vec3>>,
    pivot: Option<Spanned<DVec3>>,
    keys: Vec<Spanned<ObjectKey>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectKey {
    time: f64,
    #[serde(default)]
    translation: Vec3,
    #[serde(default)]
    degrees: f32,
    scale: Option<Scale>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Scale {
    Even(f32),
    Each(Vec3),
}

/// A path resolved against a scene.
pub struct Motion {
    /// Time of each frame, seconds.
    pub times: Vec<f64>,
    camera: Vec<(f64, Camera)>,
    /// The objects that move.
    pub objects: Vec<Track>,
    /// The file, if it was read from one.
    file: Option<PathBuf>,
}

/// Motion of the objects of one name.
pub struct Track {
    /// Indices of the objects.
    pub objects: Vec<u32>,
    /// Line of the name in the file.
    pub line: usize,
    axis: Vec3,
    pivot: Vec3,
    keys: Vec<(f64, Pose)>,
}

/// Pose of an object relative to where its model has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Translation, scene units.
    pub translation: Vec3,
    /// Angle of the rotation.
    pub degrees: f32,
    /// Factor along each axis.
    pub scale: Vec3,
}

impl Default for Pose {
    fn default() -> Pose {
        Pose { translation: Vec3::ZERO, degrees: 0.0, scale: Vec3::ONE }
    }
}

impl Pose {
    /// The transform, with a rotation about `axis`; `pivot` is the fixed point of rotation and scale.
    pub fn transform(&self, axis: Vec3, pivot: Vec3) -> Affine3A {
        let rotation = Quat::from_axis_angle(axis, self.degrees.to_radians());
        let about_pivot = Affine3A::from_scale_rotation_translation(self.scale, rotation, self.translation + pivot);
        about_pivot * Affine3A::from_translation(-pivot)
    }
}

impl Motion {
    /// No motion, at these times.
    pub fn still(times: Vec<f64>) -> Motion {
        Motion { times, camera: Vec::new(), objects: Vec::new(), file: None }
    }

    /// Reads a path for a scene seen by `camera`, which gives the values that the keys leave out. Errors name the file, the line and the key.
    pub fn load(path: &Path, scene: &Scene, camera: Camera) -> Result<Motion> {
        let text = crate::input::read_text(path)?;
        let line = |span: Range<usize>| text.bytes().take(span.start).filter(|&b| b == b'\n').count() + 1;
        let at = |span: Range<usize>, message: String| Error::at(path, line(span), message);
        let file: File = toml::from_str(&text).map_err(|e| {
            let message = e.message().trim_end().to_string();
            e.span().map_or_else(|| Error::file(path, message.clone()), |span| at(span, message.clone()))
        })?;

        let cameras = keys(&file.camera, "[[camera]]", |key| key.time).map_err(|(span, message)| at(span, message))?;
        let cameras = cameras
            .into_iter()
            .map(|(time, key, span)| {
                let eye = key.eye.map_or(camera.eye, |p| scene.from_world(p));
                let target = key.target.map_or(camera.target, |p| scene.from_world(p));
                let other = match camera.height {
                    Some(_) => {
                        key.fov.map(|_| "`fov` is of a perspective camera, and this one is orthographic; give `height`")
                    }
                    None => key.height.map(
                        |_| "`height` is of an orthographic camera, and this one has an angle of view; give `fov`",
                    ),
                };
                let (fov_y, height) = (key.fov.unwrap_or(camera.fov_y), key.height.or(camera.height));
                let camera = Camera { eye, target, fov_y, height, ..camera };
                let checked = other.map_or_else(|| camera.check(), |other| Err(String::from(other)));
                checked.map_err(|message| at(span, format!("[[camera]]: {message}")))?;
                Ok((time, camera))
            })
            .collect::<Result<Vec<_>>>()?;
        let objects = file
            .object
            .iter()
            .map(|entry| entry.track(scene, line).map_err(|(span, message)| at(span, message)))
            .collect::<Result<Vec<_>>>()?;

        let ends = cameras.iter().map(|(time, _)| *time);
        let ends = ends.chain(objects.iter().flat_map(|track| track.keys.iter().map(|(time, _)| *time)));
        let (start, end) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)));
        let times = match (&file.frames, &file.times) {
            (Some(frames), Some(_)) => {
                return Err(at(frames.span(), String::from("both `frames` and `times` are given; keep one")));
            }
            (None, None) => return Err(Error::file(path, "no `frames`; say how many, or give their `times`")),
            (Some(frames), None) => {
                let count = *frames.get_ref();
                if count == 0 || count > MAX_FRAMES {
                    return Err(at(frames.span(), format!("`frames` {count} is not in 1..={MAX_FRAMES}")));
                }
                if start > end {
                    return Err(at(frames.span(), String::from("no [[camera]] and no [[object]] has a key")));
                }
                let step = (end - start) / count.saturating_sub(1).max(1) as f64;
                (0..count).map(|i| start + step * i as f64).collect()
            }
            (None, Some(times)) => {
                if times.get_ref().is_empty() || times.get_ref().iter().any(|t| !t.is_finite()) {
                    return Err(at(times.span(), String::from("`times` must be finite, and at least one")));
                }
                times.get_ref().clone()
            }
        };
        Ok(Motion { times, camera: cameras, objects, file: Some(path.to_owned()) })
    }

    /// The path with another number of frames, spread evenly from its first frame to its last. At least one.
    pub fn with_frames(self, frames: u32) -> Motion {
        let (first, last) = (self.times.first().copied().unwrap_or(0.0), self.times.last().copied().unwrap_or(0.0));
        let step = (last - first) / f64::from(frames.saturating_sub(1).max(1));
        Motion { times: (0..frames.max(1)).map(|i| first + step * f64::from(i)).collect(), ..self }
    }

    /// Attributes an error in the scene to the file, and to the line of the object whose pose it is.
    pub(crate) fn in_file(&self, line: Option<usize>, error: Error) -> Error {
        match (&self.file, line, error) {
            (Some(file), Some(line), Error::Scene(message)) => Error::at(file, line, message),
            (Some(file), None, Error::Scene(message)) => Error::file(file, message),
            (_, _, error) => error,
        }
    }

    /// The camera at a time; `None` if the path has no camera keys.
    pub fn camera(&self, time: f64) -> Option<Camera> {
        let (a, b, f) = between(&self.camera, time)?;
        Some(Camera {
            eye: a.eye.lerp(b.eye, f),
            target: a.target.lerp(b.target, f),
            fov_y: lerp(a.fov_y, b.fov_y, f),
            height: a.height.zip(b.height).map(|(a, b)| lerp(a, b, f)),
            ..a
        })
    }
}

impl Track {
    /// The transforms of the objects at a time.
    pub fn transform(&self, time: f64) -> Affine3A {
        let Some((a, b, f)) = between(&self.keys, time) else { return Affine3A::IDENTITY };
        let pose = Pose {
            translation: a.translation.lerp(b.translation, f),
            degrees: lerp(a.degrees, b.degrees, f),
            scale: a.scale.lerp(b.scale, f),
        };
        pose.transform(self.axis, self.pivot)
    }
}

impl ObjectEntry {
    fn track(&self, scene: &Scene, line: impl Fn(Range<usize>) -> usize) -> Result<Track, (Range<usize>, String)> {
        let name = self.name.get_ref();
        let what = format!("[[object]] {name:?}");
        let objects = scene.objects_named(name);
        if objects.is_empty() {
            let message = format!("the scene has no object {name:?}; the nearest are {}", scene.objects_like(name));
            return Err((self.name.span(), message));
        }
        let axis = match &self.axis {
            None => Vec3::Y,
            Some(axis) => axis
                .get_ref()
                .try_normalize()
                .ok_or_else(|| (axis.span(), format!("{what}: `axis` {} has no direction", axis.get_ref())))?,
        };
        let pivot = match &self.pivot {
            Some(pivot) if pivot.get_ref().as_vec3().is_finite() => scene.from_world(*pivot.get_ref()),
            Some(pivot) => return Err((pivot.span(), format!("{what}: `pivot` {} is not finite", pivot.get_ref()))),
            None => {
                let own = scene.triangles.iter().filter(|t| objects.contains(&t.object));
                let corners = own.flat_map(|t| t.vertices).map(|v| scene.positions[v as usize]);
                let (low, high) =
                    corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
                if low.cmpgt(high).any() {
                    return Err((self.name.span(), format!("{what}: it has no triangles")));
                }
                0.5 * (low + high)
            }
        };
        if self.keys.is_empty() {
            return Err((self.name.span(), format!("{what}: `keys` is empty")));
        }
        let keys = keys(&self.keys, &what, |key| key.time)?
            .into_iter()
            .map(|(time, key, span)| {
                let scale = match key.scale {
                    None => Vec3::ONE,
                    Some(Scale::Even(scale)) => Vec3::splat(scale),
                    Some(Scale::Each(scale)) => scale,
                };
                if !(scale.is_finite() && scale.min_element() > 0.0) {
                    return Err((span, format!("{what}: `scale` {scale} must be above 0")));
                }
                if !(key.translation.is_finite() && key.degrees.is_finite()) {
                    let message = format!(
                        "{what}: `translation` {} and `degrees` {} must be finite",
                        key.translation, key.degrees
                    );
                    return Err((span, message));
                }
                Ok((time, Pose { translation: key.translation, degrees: key.degrees, scale }))
            })
            .collect::<Result<_, _>>()?;
        Ok(Track { objects, line: line(self.name.span()), axis, pivot, keys })
    }
}

/// Time of a key, the key, and its position in the file.
type Placed<'a, T> = (f64, &'a T, Range<usize>);

/// Keys with their times, which must increase, and their positions in the file.
fn keys<'a, T>(
    keys: &'a [Spanned<T>],
    what: &str,
    time: impl Fn(&T) -> f64,
) -> Result<Vec<Placed<'a, T>>, (Range<usize>, String)> {
    let mut before = f64::NEG_INFINITY;
    let mut found = Vec::with_capacity(keys.len());
    for key in keys {
        let now = time(key.get_ref());
        if !now.is_finite() || now <= before {
            return Err((
                key.span(),
                format!("{what}: `time` {now} must be finite and later than that of the key before"),
            ));
        }
        before = now;
        found.push((now, key.get_ref(), key.span()));
    }
    Ok(found)
}

fn lerp(a: f32, b: f32, f: f32) -> f32 {
    a + (b - a) * f
}

/// The two keys around a time, and the interpolation weight of the second.
fn between<T: Copy>(keys: &[(f64, T)], time: f64) -> Option<(T, T, f32)> {
    let after = keys.partition_point(|(t, _)| *t <= time);
    let (last, first) = (keys.last()?, keys.first()?);
    match (after.checked_sub(1).and_then(|i| keys.get(i)), keys.get(after)) {
        (Some(a), Some(b)) => Some((a.1, b.1, ((time - a.0) / (b.0 - a.0)) as f32)),
        (None, _) => Some((first.1, first.1, 0.0)),
        (_, None) => Some((last.1, last.1, 0.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(degrees: f32) -> Pose {
        Pose { translation: Vec3::new(degrees, 0.0, 0.0), degrees, scale: Vec3::ONE }
    }

    #[test]
    fn numbers_are_interpolated_and_stay_at_the_ends() {
        let pivot = Vec3::new(0.3, 7.0, -2.1);
        let keys = vec![(1.0, pose(0.0)), (2.0, pose(90.0)), (4.0, pose(450.0))];
        let track = Track { objects: vec![0], line: 1, axis: Vec3::Y, pivot, keys };
        for (time, degrees) in
            [(-1.0, 0.0), (1.0, 0.0), (1.5, 45.0), (2.0, 90.0), (3.0, 270.0), (4.0, 450.0), (9.0, 450.0)]
        {
            let transform = track.transform(time);
            let moved = transform.transform_point3(pivot) - pivot;
            assert!((moved - Vec3::new(degrees, 0.0, 0.0)).length() < 1e-4, "at {time}: {moved}");
            let turned = transform.transform_vector3(Vec3::Z);
            let expected = Quat::from_rotation_y(degrees.to_radians()) * Vec3::Z;
            assert!((turned - expected).length() < 1e-5, "at {time}: {turned}");
        }
        assert_eq!(track.transform(0.0), Affine3A::IDENTITY, "exactly");
    }
}
