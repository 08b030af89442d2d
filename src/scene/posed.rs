//! A scene in the pose that a path gives it.

use glam::{Mat3A, Vec3};

use super::path::Motion;
use super::validate::place;
use super::{Light, Scene};
use crate::error::{Error, Result};

/// Maximum difference between the columns of a similarity and orthogonal vectors of its scale.
const RIGID: f32 = 1e-5;

/// The factor by which a transform scales lengths, if it is the same in all directions.
pub(crate) fn similarity(matrix: &Mat3A) -> Option<f32> {
    let scale = matrix.x_axis.length();
    let product = matrix.transpose() * *matrix;
    let even = (product - Mat3A::from_diagonal(Vec3::splat(scale * scale))).abs();
    let worst = even.x_axis.max(even.y_axis).max(even.z_axis).max_element();
    (worst <= RIGID * scale * scale).then_some(scale)
}

/// The matrix that turns normals of surfaces that a transform moves, up to a factor: its cofactors, the inverse transpose up to one.
pub(crate) fn normal_matrix(m: &Mat3A) -> Mat3A {
    let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
    Mat3A::from_cols(y.cross(z), z.cross(x), x.cross(y))
}

impl Motion {
    /// Gives a scene, whose objects stand where its model has them, the pose of a time in seconds. Vertices are renumbered as by
    /// [`Scene::separate_objects`].
    ///
    /// Errors name the line of the path's file: the surface of a sphere light would be no sphere; a vertex would not be finite.
    pub fn pose(&self, scene: &mut Scene, time: f64) -> Result<()> {
        let ranges = scene.separate_objects();
        for track in &self.objects {
            let transform = track.transform(time);
            let refuse = |object: u32, scene: &Scene, message: &str| {
                let name = &scene.objects[object as usize];
                self.in_file(Some(track.line), Error::Scene(format!("object {name:?}: {message}")))
            };
            let normals = normal_matrix(&transform.matrix3);
            for &object in &track.objects {
                let range = ranges[object as usize].clone();
                for p in &mut scene.positions[range.clone()] {
                    *p = transform.transform_point3(*p);
                }
                for n in &mut scene.normals[range.clone()] {
                    *n = (normals * *n).normalize_or(*n);
                }
                let moved = scene.positions[range].iter().try_for_each(|&p| place("a vertex at", p));
                moved.map_err(|why| refuse(object, scene, &why))?;
                let of_object = |light: &Light| matches!(light, Light::Sphere { object: o, .. } if *o == object);
                let Some(index) = scene.lights.iter().position(of_object) else { continue };
                if let Light::Sphere { center, radius, .. } = &mut scene.lights[index] {
                    let Some(scale) = similarity(&transform.matrix3) else {
                        let message = "it is the surface of a sphere light, and its pose would make it no sphere";
                        return Err(refuse(object, scene, message));
                    };
                    (*center, *radius) = (transform.transform_point3(*center), *radius * scale);
                }
            }
        }
        Ok(())
    }
}
