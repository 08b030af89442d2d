//! Cameras from the matrices of a host: perspective and orthographic projections of any kind.
//!
//! A matrix takes a point to clip space, where x / w and y / w are its place in the image. So the rows of x, y and w tell the eye, where
//! all three vanish, and the direction through each place of the image. The row of depth is not needed, which is why reversed and infinite
//! depth, and depth from -1 or 0, make no difference. Of an orthographic projection w is one number everywhere: x and y stay the same along
//! the direction of view, the eye is where the view has it, and the row of depth tells only which way it looks.

use glam::{DMat3, DMat4, DVec3, Mat4};
use serde::{Deserialize, Serialize};

use super::Camera;
use crate::error::{Error, Result};

/// Relative volume that the rows of a matrix span, below which it is singular.
const SINGULAR: f64 = 1e-9;

/// Distance of the middle of depth from the eye, in ranges of depth, below which an orthographic projection shows as much on both sides.
const LEVEL: f64 = 1e-6;

/// Cosine between the rows and columns of an image, above which it is no rectangle.
const SKEWED: f64 = 1e-4;

/// The image of a camera on the plane at unit distance; of an orthographic one at any.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frustum {
    /// Half width and half height at unit distance, of an orthographic camera at any. A negative width mirrors the image: the view of a left-handed host. Lenses and shutters
    /// take pixels to be square.
    pub half_extents: [f32; 2],
    /// Displacement of the image's centre from the direction of view, to the right and up, in half widths and half heights.
    pub shift: [f32; 2],
}

impl Frustum {
    /// From the tangents of the angles between the direction of view and the edges of the image, as headsets tell them: to the left and down
    /// they are negative.
    pub fn from_tangents(left: f32, right: f32, down: f32, up: f32) -> Frustum {
        let half_extents = [0.5 * (right - left), 0.5 * (up - down)];
        Frustum { half_extents, shift: [(right + left) / (right - left), (up + down) / (up - down)] }
    }

    /// Checks that it has an area; the message does not name the file.
    pub(super) fn check(&self) -> Result<(), String> {
        let [width, height] = self.half_extents;
        if !(width.is_normal() && height.is_normal() && height > 0.0) {
            return Err(format!("half width {width} and half height {height} at unit distance leave no image"));
        }
        match self.shift.iter().all(|s| s.is_finite()) {
            true => Ok(()),
            false => Err(format!("its centre is shifted by {:?}, which is not finite", self.shift)),
        }
    }
}

impl Camera {
    /// The camera of a view matrix (from world to camera) and a projection, as a rasterizer takes them: `projection * view * point` is in
    /// clip space. A pinhole; `target` lies in the direction of view, at no particular distance.
    ///
    /// - Views may be right- or left-handed; the image is that of the matrices in either case.
    /// - Projections may be off-centre, jittered, or of pixels that are not square. Depth is not looked at.
    /// - Orthographic projections: rays start in the plane through the view's eye (`height`), not in the near plane, so that with near below 0
    ///   less is seen than by a rasterizer. The side of the eye on which the middle of the range of depth lies is looked at.
    /// - The top of the image is at y = w, as in OpenGL, Direct3D and WebGPU. For Vulkan's clip space with its y axis downwards (as of
    ///   `glam::camera::rh::proj::vulkan`) give `Mat4::from_scale(vec3(1.0, -1.0, 1.0)) * projection`.
    /// - The world is that of the scene: points relative to [`super::Scene::origin`].
    ///
    /// lightsum spreads the samples of its passes over each pixel itself: a jitter that changes with each frame is not needed, and restarts
    /// the sums.
    ///
    /// Errors: a matrix that is singular or not finite; a skewed projection; an orthographic one with near at -far; a resolution out of range.
    pub fn from_matrices(view: Mat4, projection: Mat4, resolution: [u32; 2]) -> Result<Camera> {
        let camera = of_matrices(view.as_dmat4(), projection.as_dmat4(), resolution);
        let checked = camera.and_then(|camera| camera.check().map(|()| camera));
        checked.map_err(|message| Error::Scene(format!("matrices of a camera: {message}")))
    }

    /// Half width and half height of the image at unit distance, of an orthographic camera at any. A negative width mirrors it.
    pub fn half_extents(&self) -> [f32; 2] {
        if let Some(frustum) = self.frustum {
            return frustum.half_extents;
        }
        let [width, height] = self.resolution.map(|n| n as f32);
        let half = match self.height {
            Some(whole) => 0.5 * whole,
            None => (0.5 * self.fov_y.to_radians()).tan(),
        };
        [half * width / height, half]
    }

    /// Displacement of the image's centre from the direction of view, to the right and up, in half widths and half heights.
    pub fn shift(&self) -> [f32; 2] {
        self.frustum.map_or([0.0; 2], |frustum| frustum.shift)
    }
}

/// Volume that three vectors span, over the product of their lengths; 0 if one of them is 0.
fn relative_volume(rows: [DVec3; 3]) -> f64 {
    let [a, b, c] = rows.map(DVec3::normalize_or_zero);
    a.cross(b).dot(c).abs()
}

fn of_matrices(view: DMat4, projection: DMat4, resolution: [u32; 2]) -> Result<Camera, String> {
    for (name, matrix) in [("view", view), ("projection", projection)] {
        if !matrix.is_finite() {
            return Err(format!("the {name} has a number that is not finite: {matrix}"));
        }
    }
    if relative_volume([0, 1, 2].map(|i| view.row(i).truncate())) < SINGULAR {
        return Err(format!("the view is singular: {view}"));
    }
    let clip = projection * view;
    if projection.row(3).truncate() == DVec3::ZERO {
        return orthographic(view, projection, resolution);
    }
    let rows = [0, 1, 3].map(|i| clip.row(i));
    let [x, y, w] = rows.map(|row| row.truncate());
    if relative_volume([x, y, w]) < SINGULAR {
        return Err(format!("the projection is singular: {projection}"));
    }
    let inverse = DMat3::from_cols(x, y, w).transpose().inverse();
    let eye = -(inverse * DVec3::from(rows.map(|row| row.w)));

    // On the plane at unit distance.
    let (forward, depth) = (w.normalize(), w.length());
    let [right, up, centre] = [inverse.x_axis, inverse.y_axis, inverse.z_axis].map(|v| v * depth);
    let frustum = frustum(forward, [right, up], centre, projection)?;
    let fov_y = 2.0 * frustum.half_extents[1].atan().to_degrees();
    Ok(Camera { fov_y, ..looking(eye, forward, up, frustum, resolution) })
}

/// The camera of an orthographic projection.
fn orthographic(view: DMat4, projection: DMat4, resolution: [u32; 2]) -> Result<Camera, String> {
    let singular = || format!("the projection is singular: {projection}");
    let w = projection.row(3).w;
    let clip = projection * view * (1.0 / w);
    let (x, y) = (clip.row(0), clip.row(1));
    let along = x.truncate().cross(y.truncate());
    if !(clip.is_finite() && along.length() > SINGULAR * x.truncate().length() * y.truncate().length()) {
        return Err(singular());
    }
    // Where the middle of depth is, from 0 or -1 to 1 or reversed, the host sees things.
    let eye = view.inverse().w_axis.truncate();
    let z = clip.row(2);
    let forward = along.normalize();
    let steepness = z.truncate().dot(forward);
    let middle = (0.5 - (z.truncate().dot(eye) + z.w)) / steepness;
    if !(steepness != 0.0 && middle.is_finite()) {
        return Err(singular());
    }
    if middle.abs() * steepness.abs() < LEVEL {
        return Err(String::from(
            "the projection is orthographic, and shows as much on both sides of the eye; take near of 0 or more",
        ));
    }
    let forward = forward * middle.signum();
    // The steps by which x and y change by one, across the direction of view.
    let area = along.length_squared();
    let [right, up] = [y.truncate().cross(along) / area, along.cross(x.truncate()) / area];
    let at = [x, y].map(|row| row.truncate().dot(eye) + row.w);
    let frustum = frustum(forward, [right, up], -(at[0] * right + at[1] * up), projection)?;
    let height = Some(2.0 * frustum.half_extents[1]);
    Ok(Camera { height, ..looking(eye, forward, up, frustum, resolution) })
}

/// The image with these half axes and this centre, relative to the point that lies in the direction of view.
fn frustum(forward: DVec3, [right, up]: [DVec3; 2], centre: DVec3, projection: DMat4) -> Result<Frustum, String> {
    if right.dot(up).abs() > SKEWED * right.length() * up.length() {
        return Err(format!("the rows and columns of the image are not at right angles: {projection}"));
    }
    Ok(Frustum {
        half_extents: [right.dot(forward.cross(up.normalize())) as f32, up.length() as f32],
        shift: [right, up].map(|axis| (centre.dot(axis) / axis.length_squared()) as f32),
    })
}

/// A pinhole camera; its angle of view is not that of the frustum.
fn looking(eye: DVec3, forward: DVec3, up: DVec3, frustum: Frustum, resolution: [u32; 2]) -> Camera {
    // As far as the eye is from the origin, so that rounding does not turn the direction.
    let eye = eye.as_vec3();
    let target = (eye.as_dvec3() + forward * f64::from(eye.abs().max_element().max(1.0))).as_vec3();
    Camera {
        eye,
        target,
        up: up.normalize().as_vec3(),
        fov_y: Camera::default_fov(),
        resolution,
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: Some(frustum),
    }
}

#[cfg(test)]
mod tests {
    use glam::camera::{lh, rh};
    use glam::{Vec2, Vec3, Vec4};

    use super::*;
    use crate::path_trace::eye_ray;

    const SIZE: [u32; 2] = [64, 40];

    fn eyes() -> [(Vec3, Vec3); 3] {
        [
            (Vec3::new(3.0, -2.0, 7.0), Vec3::new(-0.3, 0.4, -1.0)),
            (Vec3::new(1e4, 2e3, -1e4), Vec3::new(0.9, -0.2, 0.3)),
            (Vec3::new(0.0, 1e-3, 0.0), Vec3::NEG_X),
        ]
    }

    /// Fails unless the ray through each place of the image meets the points that the matrices put there.
    fn assert_rays(view: Mat4, projection: Mat4, what: &str) {
        let camera = Camera::from_matrices(view, projection, SIZE).unwrap();
        let world_from_clip = (projection.as_dmat4() * view.as_dmat4()).inverse();
        for (x, y) in [(0.5, 0.5), (0.0, 0.0), (64.0, 0.0), (3.25, 39.5), (50.0, 11.75)] {
            let place = Vec2::new(2.0 * x / 64.0 - 1.0, 1.0 - 2.0 * y / 40.0);
            // Two depths inside any of the ranges.
            let [a, b] = [0.4, 0.6].map(|z| {
                let p = world_from_clip * Vec4::new(place.x, place.y, z, 1.0).as_dvec4();
                p.truncate() / p.w
            });
            let from = eye_ray(&camera, SIZE, x, y);
            let ray = from.direction.as_dvec3();
            for p in [a, b] {
                let to = p - from.origin.as_dvec3();
                let sine = to.normalize().cross(ray).length();
                let rounding = 1e-6 + f64::from(camera.eye.abs().max_element()) * 1e-7 / to.length();
                assert!(sine < rounding && to.dot(ray) > 0.0, "{what}: {x},{y} to {p}: sine {sine}");
            }
        }
    }

    #[test]
    fn rays_go_where_the_matrices_put_points() {
        let off_centre = |m: Mat4| Mat4::from_translation(Vec3::new(0.3, -0.7, 0.0)) * m;
        let jittered = |m: Mat4| Mat4::from_translation(Vec3::new(0.7 / 64.0, -0.2 / 40.0, 0.0)) * m;
        let not_square = |m: Mat4| Mat4::from_scale(Vec3::new(0.6, 1.7, 1.0)) * m;
        let y_down = Mat4::from_scale(Vec3::new(1.0, -1.0, 1.0));
        for (eye, direction) in eyes() {
            let direction = direction.normalize();
            for (fov, near, name) in [(1.0, 0.1, "near"), (1.2, 5.0, "far")] {
                let aspect = 1.6;
                let right = rh::view::look_to_mat4(eye, direction, Vec3::Y);
                let left = lh::view::look_to_mat4(eye, direction, Vec3::Y);
                for (view, projection, kind) in [
                    (right, rh::proj::directx::perspective(fov, aspect, near, 100.0 * near), "right-handed"),
                    (right, rh::proj::opengl::perspective(fov, aspect, near, 100.0 * near), "OpenGL"),
                    (right, rh::proj::directx::perspective_infinite(fov, aspect, near), "infinite"),
                    (right, y_down * rh::proj::vulkan::perspective(fov, aspect, near, 100.0 * near), "Vulkan"),
                    (right, rh::proj::directx::perspective_infinite_reverse(fov, aspect, near), "infinite, reversed"),
                    (left, lh::proj::directx::perspective(fov, aspect, near, 100.0 * near), "left-handed"),
                    (left, lh::proj::directx::perspective_infinite_reverse(fov, aspect, near), "left-handed, reversed"),
                ] {
                    let what = format!("{kind}, {name} from {eye}");
                    assert_rays(view, projection, &what);
                    assert_rays(view, off_centre(projection), &format!("{what}, off-centre"));
                    assert_rays(view, jittered(projection), &format!("{what}, jittered"));
                    assert_rays(view, not_square(off_centre(projection)), &format!("{what}, not square"));
                    let millimetres = Mat4::from_scale(Vec3::splat(1e-3));
                    assert_rays(view * millimetres, projection, &format!("{what}, scaled"));
                }
            }
        }
    }

    #[test]
    fn parallel_rays_go_where_the_matrices_put_points() {
        let off_centre = |m: Mat4| Mat4::from_translation(Vec3::new(0.3, -0.7, 0.0)) * m;
        let scaled = |m: Mat4| Mat4::from_cols(m.x_axis * 3.0, m.y_axis * 3.0, m.z_axis * 3.0, m.w_axis * 3.0);
        let y_down = Mat4::from_scale(Vec3::new(1.0, -1.0, 1.0));
        for (eye, direction) in eyes() {
            let direction = direction.normalize();
            for (half, near, far, name) in
                [(2.0, 0.0, 10.0, "from the eye"), (300.0, 5.0, 900.0, "wide"), (1.0, -1.0, 8.0, "behind")]
            {
                let wide = 1.6 * half;
                let right = rh::view::look_to_mat4(eye, direction, Vec3::Y);
                let left = lh::view::look_to_mat4(eye, direction, Vec3::Y);
                for (view, projection, kind) in [
                    (right, rh::proj::directx::orthographic(-wide, wide, -half, half, near, far), "right-handed"),
                    (right, rh::proj::opengl::orthographic(-wide, wide, -half, half, near, far), "OpenGL"),
                    (right, y_down * rh::proj::vulkan::orthographic(-wide, wide, -half, half, near, far), "Vulkan"),
                    (right, rh::proj::directx::orthographic(-wide, wide, -half, half, far, near), "reversed"),
                    (left, lh::proj::directx::orthographic(-wide, wide, -half, half, near, far), "left-handed"),
                    (
                        left,
                        lh::proj::directx::orthographic(-wide, wide, -half, half, far, near),
                        "left-handed, reversed",
                    ),
                ] {
                    let what = format!("{kind}, {name} from {eye}");
                    assert_rays(view, projection, &what);
                    assert_rays(view, off_centre(projection), &format!("{what}, off-centre"));
                    assert_rays(view, scaled(projection), &format!("{what}, scaled"));
                    let camera = Camera::from_matrices(view, projection, SIZE).unwrap();
                    let whole = camera.height.unwrap();
                    assert!((whole - 2.0 * half).abs() < 1e-5 * half, "{what}: {camera:?}");
                    let off = camera.eye.distance(eye);
                    assert!(off <= 1e-5 * eye.length().max(1.0) && camera.check().is_ok(), "{what}: {camera:?}");
                    assert!(camera.world_from_camera().2.dot(direction) > 0.9999, "{what}: {camera:?}");
                }
            }
        }
    }

    #[test]
    fn matrices_of_a_symmetric_camera_give_that_camera() {
        for (eye, direction) in eyes() {
            let (target, up) = (eye + direction.normalize() * 10.0, Vec3::Y);
            let (aperture, focus, shutter, height, frustum) = (0.0, None, 0.0, None, None);
            let plain =
                Camera { eye, target, up, fov_y: 50.0, resolution: SIZE, aperture, focus, shutter, height, frustum };
            let projection = rh::proj::directx::perspective_infinite_reverse(50f32.to_radians(), 1.6, 0.1);
            let view = rh::view::look_at_mat4(eye, target, up);
            let found = Camera::from_matrices(view, projection, SIZE).unwrap();
            assert!(found.eye.distance(eye) <= 1e-6 * eye.length().max(1.0), "{found:?}");
            assert!((found.fov_y - 50.0).abs() < 1e-4, "{found:?}");
            let (a, b) = (found.world_from_camera(), plain.world_from_camera());
            for (found, expected) in [(a.0, b.0), (a.1, b.1), (a.2, b.2)] {
                assert!(found.distance(expected) < 1e-6, "{found} for {expected}");
            }
            for (found, expected) in found.half_extents().into_iter().zip(plain.half_extents()) {
                assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
            }
            assert!(found.shift().iter().all(|s| s.abs() < 1e-6), "{found:?}");
        }
    }

    #[test]
    fn tangents_are_those_of_a_projection() {
        let frustum = Frustum::from_tangents(-0.9, 0.4, -0.5, 0.7);
        let projection = rh::proj::directx::frustum(-0.09, 0.04, -0.05, 0.07, 0.1, 10.0);
        let found = Camera::from_matrices(Mat4::IDENTITY, projection, SIZE).unwrap().frustum.unwrap();
        let numbers = |f: Frustum| [f.half_extents, f.shift].concat();
        let apart = numbers(frustum).into_iter().zip(numbers(found)).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f32::max) < 1e-5, "{found:?} for {frustum:?}");
    }

    #[test]
    fn matrices_without_an_image_are_refused() {
        let view = rh::view::look_to_mat4(Vec3::ONE, Vec3::NEG_Z, Vec3::Y);
        let projection = rh::proj::directx::perspective(1.0, 1.6, 0.1, 100.0);
        let skewed = Mat4::from_cols(Vec4::X, Vec4::new(0.5, 1.0, 0.0, 0.0), Vec4::Z, Vec4::W) * projection;
        for (view, projection, resolution, part) in [
            (view, projection * f32::NAN, SIZE, "projection has a number that is not finite"),
            (view * f32::INFINITY, projection, SIZE, "view has a number that is not finite"),
            (Mat4::ZERO, projection, SIZE, "view is singular"),
            (view, Mat4::ZERO, SIZE, "projection is singular"),
            (view, Mat4::from_scale(Vec3::new(0.0, 1.0, 1.0)) * projection, SIZE, "projection is singular"),
            (view, rh::proj::directx::orthographic(-1.0, 1.0, -1.0, 1.0, -5.0, 5.0), SIZE, "both sides of the eye"),
            (view, Mat4::from_scale(Vec3::new(1.0, 1.0, 0.0)), SIZE, "projection is singular"),
            (view, skewed, SIZE, "right angles"),
            (view, projection, [0, 5], "resolution 0x5"),
        ] {
            let error = Camera::from_matrices(view, projection, resolution).unwrap_err().to_string();
            assert!(error.contains(part) && error.starts_with("scene: matrices of a camera: "), "{error}");
        }
    }
}
