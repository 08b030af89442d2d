//! The camera by mouse and keys: around what it looks at, or flying.

use glam::{Quat, Vec3};
use lightsum::accel::Ray;
use lightsum::scene::Camera;

/// How the camera moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Around its target.
    #[default]
    Orbit,
    /// Its eye goes where it looks.
    Fly,
}

/// Least angle between the view direction and the vertical.
const POLE: f32 = 0.02;
/// Part of the distance to the target that a step of the wheel goes.
const STEP: f32 = 0.15;

/// Turns the camera by a drag of the mouse, in pixels.
pub fn turn(camera: Camera, mode: Mode, [dx, dy]: [f32; 2]) -> Camera {
    let up = camera.up.normalize();
    let offset = camera.target - camera.eye;
    // Across the image the view flown through turns by its own angle, the view around something by half a turn.
    let full = match mode {
        Mode::Orbit => std::f32::consts::PI,
        Mode::Fly => camera.fov_y.to_radians(),
    };
    let rate = full / camera.resolution[1] as f32;
    let elevation = offset.angle_between(up);
    let wanted = (elevation + dy * rate).clamp(POLE, std::f32::consts::PI - POLE);
    let right = offset.cross(up).normalize_or(Vec3::X);
    let turned = Quat::from_axis_angle(up, -dx * rate) * (Quat::from_axis_angle(right, elevation - wanted) * offset);
    match mode {
        Mode::Orbit => Camera { eye: camera.target - turned, ..camera },
        Mode::Fly => Camera { target: camera.eye + turned, ..camera },
    }
}

/// Moves the camera across its view, so that its target follows the mouse.
pub fn pan(camera: Camera, [dx, dy]: [f32; 2]) -> Camera {
    let (right, top, _) = camera.world_from_camera();
    let unit = pixel(&camera, (camera.target - camera.eye).length());
    let by = (-dx * right + dy * top) * unit;
    Camera { eye: camera.eye + by, target: camera.target + by, ..camera }
}

/// Moves the camera by steps of the wheel: towards its target, or on. An orthographic one shows less instead.
pub fn dolly(camera: Camera, mode: Mode, steps: f32) -> Camera {
    if let Some(height) = camera.height {
        return Camera { height: Some(height * (1.0 - STEP).powf(steps)), ..camera };
    }
    let offset = camera.target - camera.eye;
    match mode {
        Mode::Orbit => Camera { eye: camera.target - offset * (1.0 - STEP).powf(steps), ..camera },
        Mode::Fly => fly(camera, Vec3::Z * (STEP * steps * offset.length())),
    }
}

/// Moves the camera by a vector to the right, up and forward.
pub fn fly(camera: Camera, by: Vec3) -> Camera {
    let (right, _, forward) = camera.world_from_camera();
    let by = by.x * right + by.y * camera.up.normalize() + by.z * forward;
    Camera { eye: camera.eye + by, target: camera.target + by, ..camera }
}

/// The ray through a point of the image, in pixels from its upper left corner.
pub fn ray(camera: &Camera, [x, y]: [f32; 2]) -> Ray {
    let (right, top, forward) = camera.world_from_camera();
    let [width, height] = camera.resolution.map(|n| n as f32);
    let unit = pixel(camera, 1.0);
    let across = (x - 0.5 * width) * unit * right + (0.5 * height - y) * unit * top;
    match camera.is_orthographic() {
        true => Ray::new(camera.eye + across, forward),
        false => Ray::new(camera.eye, forward + across),
    }
}

/// Where a point is in the image, in pixels from its upper left corner; `None`: it is not before the eye.
pub fn project(camera: &Camera, point: Vec3) -> Option<[f32; 2]> {
    let (right, top, forward) = camera.world_from_camera();
    let offset = point - camera.eye;
    let depth = offset.dot(forward);
    let unit = pixel(camera, depth);
    let [width, height] = camera.resolution.map(|n| n as f32);
    let at = [0.5 * width + offset.dot(right) / unit, 0.5 * height - offset.dot(top) / unit];
    (depth > 0.0 && at.iter().all(|x| x.is_finite())).then_some(at)
}

/// Size of a pixel at a depth.
fn pixel(camera: &Camera, depth: f32) -> f32 {
    let whole = camera.height.unwrap_or_else(|| 2.0 * (0.5 * camera.fov_y.to_radians()).tan() * depth);
    whole / camera.resolution[1] as f32
}

/// Where a ray meets a plane, unless it runs along it or away from it.
pub fn on_plane(ray: &Ray, point: Vec3, normal: Vec3) -> Option<Vec3> {
    let along = ray.direction.dot(normal);
    let t = (point - ray.origin).dot(normal) / along;
    (along.abs() > 1e-4 * ray.direction.length() && t > 0.0).then(|| ray.origin + t * ray.direction)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            eye: Vec3::new(0.0, 1.0, 4.0),
            target: Vec3::new(0.0, 1.0, 0.0),
            up: Vec3::Y,
            fov_y: 90.0,
            resolution: [200, 100],
            aperture: 0.0,
            focus: None,
            shutter: 0.0,
            height: None,
            frustum: None,
        }
    }

    fn near(a: Vec3, b: Vec3) -> bool {
        (a - b).length() < 1e-4
    }

    #[test]
    fn orbit_keeps_the_target_and_flight_the_eye() {
        // Half the height of the image to the left: a quarter of a turn to the right, around the target.
        let around = turn(camera(), Mode::Orbit, [-50.0, 0.0]);
        assert!(near(around.eye, Vec3::new(4.0, 1.0, 0.0)) && around.target == camera().target, "{around:?}");
        // In flight by half the angle of view.
        let looked = turn(camera(), Mode::Fly, [-50.0, 0.0]);
        let half = 45f32.to_radians();
        let expected = camera().eye + 4.0 * Vec3::new(-half.sin(), 0.0, -half.cos());
        assert!(near(looked.target, expected) && looked.eye == camera().eye, "{looked:?} {expected}");
    }

    #[test]
    fn the_view_never_tips_over() {
        for mode in [Mode::Orbit, Mode::Fly] {
            for dy in [-1e5, 1e5] {
                let turned = turn(camera(), mode, [0.0, dy]);
                assert!(turned.check().is_ok(), "{turned:?}");
                let again = turn(turned, mode, [30.0, dy]);
                assert!(again.check().is_ok() && again.eye.is_finite(), "{again:?}");
            }
        }
    }

    #[test]
    fn the_wheel_goes_towards_the_target() {
        let near_it = dolly(camera(), Mode::Orbit, 100.0);
        assert!(near_it.eye.z > 0.0 && near_it.eye.z < 1e-3 && near_it.target == camera().target);
        assert!(near(dolly(near_it, Mode::Orbit, -100.0).eye, camera().eye));
        let flown = dolly(camera(), Mode::Fly, 1.0);
        assert!(near(flown.eye, Vec3::new(0.0, 1.0, 4.0 - 0.6)) && near(flown.target, Vec3::new(0.0, 1.0, -0.6)));
    }

    #[test]
    fn rays_go_through_their_pixels() {
        let middle = ray(&camera(), [100.0, 50.0]);
        assert!(near(middle.direction, -Vec3::Z));
        let corner = ray(&camera(), [0.0, 0.0]);
        assert!(near(corner.direction, Vec3::new(-2.0, 1.0, -1.0)), "{corner:?}");
        let back = project(&camera(), corner.origin + 3.0 * corner.direction).unwrap();
        assert!(back.iter().all(|x| x.abs() < 1e-3), "{back:?}");
        assert_eq!(project(&camera(), Vec3::new(0.0, 1.0, 5.0)), None);
        let hit = on_plane(&corner, Vec3::ZERO, Vec3::Z).unwrap();
        assert!(near(hit, Vec3::new(-8.0, 5.0, 0.0)), "{hit}");
        assert_eq!(on_plane(&corner, Vec3::new(0.0, 0.0, 9.0), Vec3::Z), None);
        // A pixel of the drag moves the target by a pixel.
        let panned = pan(camera(), [10.0, 0.0]);
        assert!(near(panned.target, Vec3::new(-0.8, 1.0, 0.0)), "{panned:?}");
    }
}
