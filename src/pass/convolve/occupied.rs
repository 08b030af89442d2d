//! Lists the tiles of 8 x 8 texels, at each level of the pyramid, that have texels of a region: sources and targets of a convolution lie
//! there alone, so its steps are dispatched over these tiles. Where no pixel takes part they are dispatched over nothing.
//!
//! Cost: 4 bytes read for each pixel, fewer in tiles that are marked early; then one workgroup for each level.

use super::{bind, run};
use crate::error::Result;
use crate::gpu::{Buffer, Context, Memory, Recorder, Resources, Staging, shaders};
use crate::pass::BoundKernel;
use crate::pass::layout::ConvolveStep;

/// Bytes of the two indirect dispatches of a level.
const LEVEL_BYTES: u64 = 32;

/// The pass, and its lists. They depend on the size of the image and on the regions only, so several convolutions of one image share them.
#[derive(Clone)]
pub struct Occupied {
    counts: Buffer,
    resources: Resources,
    mark: BoundKernel,
    list: BoundKernel,
    levels: usize,
    mark_groups: u64,
}

impl Occupied {
    /// Lists the tiles of `region`, an image of this size; `everywhere`: all tiles, whatever they hold.
    pub fn new(
        context: &Context,
        staging: &mut Staging,
        region: &Buffer,
        size: [u32; 2],
        everywhere: bool,
    ) -> Result<Self> {
        let flags = if everywhere { ConvolveStep::EVERYWHERE } else { 0 };
        let mut steps: Vec<ConvolveStep> = Vec::new();
        let (mut extent, mut first_tile) = (size, 0);
        // One level more than the pyramid's largest, above a single texel, as room for what would rise.
        while steps.len() < 3 || steps[steps.len() - 2].size != [1, 1] {
            let tiles = extent.map(|n| n.div_ceil(8));
            let level = steps.len() as u32;
            steps.push(ConvolveStep { size: extent, tiles, first_tile, level, flags, ..ConvolveStep::default() });
            first_tile += tiles[0] * tiles[1];
            extent = extent.map(|n| n.div_ceil(2));
        }
        let levels = steps.len();
        let array = |name: &str, bytes: u64| Buffer::new(context, name, bytes, Memory::Device);
        let marks = array("convolution tile marks", 4 * u64::from(first_tile))?;
        let occupied = array("convolution tile list", 4 * u64::from(first_tile))?;
        let counts = array("convolution tile counts", LEVEL_BYTES * levels as u64)?;
        let mark_groups = u64::from(steps[0].tiles[0] * steps[0].tiles[1]).div_ceil(crate::pass::GROUP);
        let steps = staging.stage(context, "convolution levels", &steps)?;
        let own = Resources::of([("steps", &steps), ("region", region), ("counts", &counts)]);
        let resources = Resources::of([("marks", &marks), ("occupied", &occupied), ("occupied_counts", &counts)]);
        let mark = bind(context, &shaders::CONVOLVE_MARK, &[&own, &resources])?;
        let list = bind(context, &shaders::CONVOLVE_LIST, &[&own, &resources])?;
        Ok(Occupied { counts, resources, mark, list, levels, mark_groups })
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> &Resources {
        &self.resources
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        run(rec, &self.mark, 0, self.mark_groups)?;
        (0..self.levels).try_for_each(|level| run(rec, &self.list, level, 1))
    }

    /// Records a kernel with a workgroup for each listed tile of a level.
    pub fn run_listed(&self, rec: &mut Recorder, kernel: &BoundKernel, step: usize, level: usize) -> Result<()> {
        kernel.run_listed(rec, &crate::pass::push(step as u32), &self.counts, LEVEL_BYTES * level as u64)
    }

    /// Records a kernel with an invocation for each tile of a level, if any is listed.
    pub fn run_all(&self, rec: &mut Recorder, kernel: &BoundKernel, level: usize) -> Result<()> {
        kernel.run_listed(rec, &crate::pass::push(level as u32), &self.counts, LEVEL_BYTES * level as u64 + 16)
    }
}
