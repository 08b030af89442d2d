//! The light of second components (see `eye_paths`) is added to what their pixels emit:
//! L_e += L_e2 + throughput (kd / pi * (E_direct + E_indirect) + L_specular), all of the second component.
//!
//! So what follows knows of one receiver for each pixel, and the layers of the image show the first component: what is seen
//! through glass rather than what it reflects, the surface rather than its gloss. Cost: 8 vec4 and 20 operations a pixel.

use glam::Vec3;

use super::{Kernels, Paths, Receivers, Sums, accumulate, groups};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};

/// The pass.
pub struct Merge {
    kernel: Kernel,
    bindings: Bindings,
    pixels: u32,
}

impl Merge {
    /// Adds to `receivers.emitted` of the first `pixels` slots what the others, lit by `sums`, send to the eye.
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        receivers: &Receivers,
        paths: &Paths,
        sums: &Sums,
        pixels: u32,
    ) -> Result<Self> {
        let kernel = kernels.merge.clone();
        let bindings = kernel.bind(&[
            ("frame", frame.into()),
            ("receiver_kd", (&receivers.kd).into()),
            ("receiver_wo", (&receivers.wo).into()),
            ("throughput", (&paths.throughput).into()),
            ("direct", (&sums.direct).into()),
            ("indirect", (&sums.indirect).into()),
            ("specular", (&sums.specular).into()),
            ("emitted", (&receivers.emitted).into()),
        ])?;
        Ok(Merge { kernel, bindings, pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.dispatch(&self.kernel, &self.bindings, &[], groups(self.pixels))
    }
}

/// Oracle: what a second component adds to its pixel; `sums` are zero where it is not lit.
pub fn reference(emitted: Vec3, throughput: Vec3, kd: Vec3, sums: [Vec3; 3]) -> Vec3 {
    accumulate::reference(emitted, throughput, kd, sums)
}
