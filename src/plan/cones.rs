//! Cones around rays, over which textures are averaged (Akenine-Moeller et al. 2019 and 2021, "Texture level of detail strategies for
//! real-time ray tracing" and "Improved shader and texture level of detail using ray cones").
//!
//! A ray stands for those beside it, which are not traced in this pass. The means of more passes have more rays, so the cones of each pass
//! are narrower than those of the one before: k passes have k times as many rays in the same place, and the width of the cones of pass
//! k - 1 is that of the first over the root of k. So the first frame does not glitter, and the mean tends to what rays without cones
//! show.

use crate::view::View;

/// Width of the cone of a gather ray at unit distance: it stands for a part of the hemisphere, and neighbours share what they find.
const GATHER: f32 = 0.25;

/// Maximum width of the cone of a particle at unit distance.
const MOST: f32 = 0.25;

/// Widths of cones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cones {
    /// Width of a pixel at unit depth; of an orthographic camera at any.
    pub pixel: f32,
    /// Width of the cone of a particle at unit distance.
    pub particle: f32,
    /// Width of the cone of a gather ray at unit distance.
    pub gather: f32,
}

impl Cones {
    /// In pass number `pass` (from 0) over a view, with so many particles of a class. A particle's cone is a part of a hemisphere
    /// shared by all. Texels of an atlas have no cones: they are points on surfaces.
    pub fn of(view: &View, particles: u32, pass: u32) -> Cones {
        let narrower = 1.0 / (pass as f32 + 1.0).sqrt();
        let pixel = view.camera().map_or(0.0, |camera| 2.0 * camera.half_extents()[1] / camera.resolution[1] as f32);
        let particle = (1.0 / particles.max(1) as f32).sqrt().min(MOST);
        Cones { pixel: pixel * narrower, particle: particle * narrower, gather: GATHER * narrower }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::scene::Camera;

    #[test]
    fn cones_narrow_with_the_passes() {
        let (eye, target, up) = (Vec3::ZERO, Vec3::NEG_Z, Vec3::Y);
        let camera = Camera {
            eye,
            target,
            up,
            fov_y: 90.0,
            resolution: [200, 100],
            aperture: 0.0,
            focus: None,
            shutter: 0.0,
            height: None,
            frustum: None,
        };
        let view = View::whole(camera);
        let first = Cones::of(&view, 100, 0);
        assert!((first.pixel - 0.02).abs() < 1e-6 && (first.particle - 0.1).abs() < 1e-6, "{first:?}");
        let later = Cones::of(&view, 100, 99);
        assert!((later.pixel - 0.002).abs() < 1e-7 && (later.gather - 0.1 * first.gather).abs() < 1e-7, "{later:?}");
        assert_eq!(Cones::of(&view, 1, 0).particle, MOST);
    }
}
