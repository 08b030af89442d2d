//! Adds the light of third components (see `eye_paths`) to the emission of the second ones of their pixels:
//! L_e2 += L_e3 + throughput (kd / pi * (E_direct + E_indirect) + L_specular), all of the third component.
//!
//! Later passes then handle two components. No filter averages the light of third components: reflections of the room within a ball carry some hundredths
//! of the light around them, and reflections of lamps are sharp. Cost: 9 vec4 and 20 operations for each pixel of a tile that shows mirrors or glass, in scenes with glass.

use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, shaders};

/// The pass.
pub struct ThirdLight {
    kernel: BoundKernel,
    tiles: Buffer,
}

impl ThirdLight {
    /// Adds the radiance of third components, lit by `lighting`, to the emission of `points` at the pixels of `tiles`.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        paths: &EyePathState,
        lighting: &Lighting,
        tiles: &List,
    ) -> Result<Self> {
        let sets = [&points.resources(), &paths.resources(), &lighting.resources(), &tiles.as_tiles()];
        Ok(ThirdLight { kernel: kit.bind(&shaders::THIRD_LIGHT, &sets)?, tiles: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}
