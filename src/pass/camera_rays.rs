//! One ray for each pixel, through the pass's offset in the pixel (Keller 1997, 4.1: one Hammersley offset for each image).
//!
//! Cost: some 30 operations and 64 bytes written a pixel.

use glam::Vec3;

use super::{Kernels, Paths, Rays, Receivers, groups, layout};
use crate::accel::Ray;
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};

/// The pass.
pub struct CameraRays {
    kernel: Kernel,
    bindings: Bindings,
    pixels: u32,
}

impl CameraRays {
    /// Writes `rays.origin` and `rays.direction` of all pixels, and starts their `paths` and what `receivers` emit.
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        rays: &Rays,
        paths: &Paths,
        receivers: &Receivers,
        pixels: u32,
    ) -> Result<Self> {
        let kernel = kernels.camera_rays.clone();
        let bindings = kernel.bind(&[
            ("frame", frame.into()),
            ("ray_origin", (&rays.origin).into()),
            ("ray_direction", (&rays.direction).into()),
            ("throughput", (&paths.throughput).into()),
            ("emitted", (&receivers.emitted).into()),
        ])?;
        Ok(CameraRays { kernel, bindings, pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.dispatch(&self.kernel, &self.bindings, &[], groups(self.pixels))
    }
}

/// Oracle: the ray of a pixel.
pub fn reference(frame: &layout::Frame, pixel: u32) -> Ray {
    let xyz = |a: [f32; 4]| Vec3::new(a[0], a[1], a[2]);
    let [width, height, ..] = frame.size;
    let s = 2.0 * ((pixel % width) as f32 + frame.pixel_offset[0]) / width as f32 - 1.0;
    let t = 1.0 - 2.0 * ((pixel / width) as f32 + frame.pixel_offset[1]) / height as f32;
    let direction = (xyz(frame.forward) + s * xyz(frame.right) + t * xyz(frame.up)).normalize();
    Ray { origin: xyz(frame.eye), t_max: 3.0e38, direction }
}
