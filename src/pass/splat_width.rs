//! Diameters of the kernels of splats (Bastos 1999, equation 7.6): for n hits on a surface of area A
//!
//! ```text
//! h = C sqrt(A / n)
//! ```
//!
//! so that a kernel holds pi C^2 / 4 hits where they are spread evenly. The thesis does not give C; `docs/splats.md` has errors by C.
//! A surface without hits has no kernels. Cost: one invocation for each surface.

use super::{BoundKernel, Kit, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// The pass.
pub struct SplatWidth {
    kernel: BoundKernel,
    surfaces: u32,
}

impl SplatWidth {
    /// Reads the `surfaces` and their `hits`, writes `width`.
    pub fn new(kit: &Kit, [surfaces, hits, width]: [&Buffer; 3], own: &Resources) -> Result<Self> {
        let set = Resources::of([("surfaces", surfaces), ("surface_hits", hits), ("surface_width", width)]);
        let count = (width.bytes() / 4) as u32;
        Ok(SplatWidth { kernel: kit.bind(&shaders::SPLAT_WIDTH, &[&set, own])?, surfaces: count })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.surfaces))
    }
}

/// Oracle: h of a surface.
pub fn reference(c: f32, area: f32, hits: u32) -> f32 {
    if hits == 0 { 0.0 } else { c * (area / hits as f32).sqrt() }
}
