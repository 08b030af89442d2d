//! Shading points at the ends of the second and third components of eye paths that split (`eye_paths`), as `eye_points` makes
//! them of the first components. They are listed after those, tile by tile of the tiles that show mirrors or glass, the third after the second.
//!
//! A component without throughput is none: its shading point is not lit and has met nothing.
//!
//! Cost: as `eye_points`, for the pixels of those tiles, and in scenes with glass twice.

use super::eye_points::Inputs;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, List};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, shaders};

/// The pass.
pub struct SplitPoints {
    kernel: BoundKernel,
    work: Buffer,
}

impl SplitPoints {
    /// Writes the `points` of second and third components in `tiles`.
    pub fn new(kit: &Kit, inputs: &Inputs, tiles: &List) -> Result<Self> {
        let shaders = [&shaders::SPLIT_POINTS, &shaders::SPLIT_POINTS_UNTEXTURED];
        let sets = [&inputs.resources(kit)?, &tiles.as_tiles()];
        Ok(SplitPoints { kernel: kit.bind_surface(shaders, &sets)?, work: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.work, LIST_GROUPS)
    }
}
