//! Adds the light of second components (see `eye_paths`) to the emission of their pixels:
//! L_e += L_e2 + throughput (kd / pi * (E_direct + E_indirect) + L_specular), all of the second component.
//!
//! Later passes then handle one shading point for each pixel, and the layers of the image show the first component: the
//! scene behind glass instead of its reflection, the surface of a mirror instead of its gloss. Cost: 8 vec4 and 20
//! operations for each pixel of a tile that shows mirrors or glass.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints, accumulate};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// The pass.
pub struct Merge {
    kernel: BoundKernel,
    tiles: Buffer,
}

impl Merge {
    /// Adds the radiance of second components, lit by `lighting`, to `shown` at the pixels of `tiles`.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        paths: &EyePathState,
        lighting: &Lighting,
        tiles: &List,
        shown: &Buffer,
    ) -> Result<Self> {
        let shown = Resources::of([("shown", shown)]);
        let sets = [&points.resources(), &paths.resources(), &lighting.resources(), &tiles.as_tiles(), &shown];
        Ok(Merge { kernel: kit.bind(&shaders::MERGE, &sets)?, tiles: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}

/// Oracle: radiance that a second component adds to its pixel; `sums` are zero if it is not lit.
pub fn reference(emitted: Vec3, throughput: Vec3, kd: Vec3, sums: [Vec3; 3]) -> Vec3 {
    accumulate::reference(emitted, throughput, kd, sums)
}
