//! Adds the light of paths along specular lobes (see `eye_paths`) to the specular radiance of their pixels.
//!
//! The path along the lobe of a pixel's surface ends at a shading point of its own, in the slot of the second component:
//! L_s += L_e2 + throughput (kd / pi * (E_direct + E_indirect) + L_specular), all of the second component, which is empty
//! afterwards. The filter then takes it as part of the pixel's own reflection.
//!
//! Cost, for each pixel of a tile that shows narrow lobes, mirrors or glass: 14 vec4 and 30 operations.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints, accumulate};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, shaders};

/// The pass.
pub struct GlossyLight {
    kernel: BoundKernel,
    tiles: Buffer,
}

impl GlossyLight {
    /// Adds to `lighting` at the pixels of `tiles`.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        paths: &EyePathState,
        lighting: &Lighting,
        tiles: &List,
    ) -> Result<Self> {
        let sets = [&points.resources(), &paths.resources(), &lighting.resources(), &tiles.as_tiles()];
        Ok(GlossyLight { kernel: kit.bind(&shaders::GLOSSY_LIGHT, &sets)?, tiles: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}

/// Oracle: specular radiance that a path along the lobe adds to its pixel; `sums` are zero if its end is not lit.
pub fn reference(emitted: Vec3, throughput: Vec3, kd: Vec3, sums: [Vec3; 3]) -> Vec3 {
    accumulate::reference(emitted, throughput, kd, sums)
}
