//! The camera: the scene's, or one made up for a bare model, with the flags laid over it.

use crate::args;
use glam::Vec3;
use lightsum::scene::{Camera, Scene};
use lightsum::{Error, Result};

/// Vertical angle of view of a camera that is made up, degrees.
const FOV: f32 = 45.0;

/// The camera to render with.
pub fn choose(scene: &Scene, flags: &args::Camera, resolution: Option<[u32; 2]>) -> Result<Camera> {
    let mut camera = match scene.camera {
        Some(camera) => camera,
        None => {
            let size = resolution.unwrap_or([640, 480]);
            if flags.eye.is_none() || flags.target.is_none() {
                log::warn!("{} has no camera: it is seen from its front; set --eye, --target and --fov", scene.name);
            }
            in_front_of(scene.bounds(), size)
        }
    };
    camera.eye = flags.eye.unwrap_or(camera.eye);
    camera.target = flags.target.unwrap_or(camera.target);
    camera.up = flags.up.unwrap_or(camera.up);
    camera.fov_y = flags.fov.unwrap_or(camera.fov_y);
    camera.resolution = resolution.unwrap_or(camera.resolution);
    args::check_resolution(camera.resolution).map_err(|message| Error::Setting { name: "--resolution", message })?;
    camera.check().map_err(|message| Error::Setting { name: "--eye, --target, --up, --fov", message })?;
    Ok(camera)
}

/// A camera on the side of positive z (a model's front in glTF) that sees the whole box.
fn in_front_of((low, high): (Vec3, Vec3), resolution: [u32; 2]) -> Camera {
    /// Room around the box.
    const MARGIN: f32 = 1.1;
    let center = 0.5 * (low + high);
    let half = 0.5 * (high - low);
    let aspect = resolution[0] as f32 / resolution[1] as f32;
    let needed = half.y.max(half.x / aspect) * MARGIN;
    // A flat or pointlike box is still looked at from somewhere else than its middle.
    let distance = half.z + (needed / (0.5 * FOV.to_radians()).tan()).max(0.1 * half.length()).max(f32::MIN_POSITIVE);
    Camera { eye: center + distance * Vec3::Z, target: center, up: Vec3::Y, fov_y: FOV, resolution }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_whole_box_is_seen() {
        for (low, high) in [
            (Vec3::new(-1.0, -2.0, -3.0), Vec3::new(5.0, 2.0, 7.0)),
            (Vec3::new(1e4, 0.0, 0.0), Vec3::new(1.5e4, 1.0, 1.0)),
            (Vec3::ZERO, Vec3::new(0.0, 0.01, 3.0)),
        ] {
            for resolution in [[640, 480], [100, 900]] {
                let camera = in_front_of((low, high), resolution);
                let tan_y = (0.5 * camera.fov_y.to_radians()).tan();
                let tan_x = tan_y * resolution[0] as f32 / resolution[1] as f32;
                for corner in 0..8 {
                    let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
                    let to = Vec3::new(pick(0), pick(1), pick(2)) - camera.eye;
                    assert!(to.z < 0.0 && to.x.abs() <= -to.z * tan_x && to.y.abs() <= -to.z * tan_y, "{low} {high}");
                }
            }
        }
    }
}
