//! One ray for each pixel, through the sample offset of the pass (Keller 1997, 4.1: one Hammersley offset for each
//! image).
//!
//! Cost: some 30 operations and 64 bytes written a pixel.

use glam::Vec3;

use super::{BoundKernel, EyePathState, Kit, Rays, ShadingPoints, groups, layout};
use crate::accel::Ray;
use crate::error::Result;
use crate::gpu::{Recorder, shaders};

/// The pass.
pub struct CameraRays {
    kernel: BoundKernel,
    pixels: u32,
}

impl CameraRays {
    /// Writes `rays.origin` and `rays.direction` of all pixels, and initialises `paths` and the emission of `points`.
    pub fn new(kit: &Kit, rays: &Rays, paths: &EyePathState, points: &ShadingPoints, pixels: u32) -> Result<Self> {
        let sets = [&rays.resources(), &paths.resources(), &points.resources()];
        Ok(CameraRays { kernel: kit.bind(&shaders::CAMERA_RAYS, &sets)?, pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}

/// Oracle: the ray of a pixel.
pub fn reference(frame: &layout::FrameParameters, pixel: u32) -> Ray {
    row(frame, pixel / frame.size[0])(pixel % frame.size[0])
}

/// [`reference`] for the columns of a row.
pub(crate) fn row(frame: &layout::FrameParameters, row: u32) -> impl Fn(u32) -> Ray {
    let xyz = |a: [f32; 4]| Vec3::new(a[0], a[1], a[2]);
    let [x, y, whole_width, whole_height] = frame.within;
    let (offset, shift) = (frame.pixel_offset[0], frame.shift[0]);
    let t = 1.0 - 2.0 * ((row + y) as f32 + frame.pixel_offset[1]) / whole_height as f32 + frame.shift[1];
    let (eye, forward, right, up) = (xyz(frame.eye), xyz(frame.forward), xyz(frame.right), t * xyz(frame.up));
    let orthographic = frame.is_orthographic();
    move |column| {
        let s = 2.0 * ((column + x) as f32 + offset) / whole_width as f32 - 1.0 + shift;
        let across = s * right + up;
        match orthographic {
            true => Ray { origin: eye + across, t_max: 3.0e38, direction: forward },
            false => Ray { origin: eye, t_max: 3.0e38, direction: (forward + across).normalize() },
        }
    }
}
