//! The light of second components (see `eye_paths`) is added to what their pixels emit:
//! L_e += L_e2 + throughput (kd / pi * (E_direct + E_indirect) + L_specular), all of the second component.
//!
//! So what follows knows of one receiver for each pixel, and the layers of the image show the first component: what is seen
//! through glass rather than what it reflects, the surface rather than its gloss. Cost: 8 vec4 and 20 operations for each pixel
//! of a tile that shows mirrors or glass.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::{Kernels, List, Paths, Receivers, Sums, accumulate};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};

/// The pass.
pub struct Merge {
    kernel: Kernel,
    bindings: Bindings,
    tiles: Buffer,
}

impl Merge {
    /// Adds to `shown`, at the pixels of `tiles`, what their second components, lit by `sums`, send to the eye.
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        receivers: &Receivers,
        paths: &Paths,
        sums: &Sums,
        tiles: &List,
        shown: &Buffer,
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
            ("work", (&tiles.work).into()),
            ("tiles", (&tiles.pixels).into()),
            ("shown", shown.into()),
        ])?;
        Ok(Merge { kernel, bindings, tiles: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.dispatch_indirect(&self.kernel, &self.bindings, &[], &self.tiles, LIST_GROUPS)
    }
}

/// Oracle: what a second component adds to its pixel; `sums` are zero where it is not lit.
pub fn reference(emitted: Vec3, throughput: Vec3, kd: Vec3, sums: [Vec3; 3]) -> Vec3 {
    accumulate::reference(emitted, throughput, kd, sums)
}
