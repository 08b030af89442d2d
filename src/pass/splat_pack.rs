//! Appends the hits of a batch to those stored, in a fixed order: by number of bounces, then by particle.
//!
//! The hits of each block of slots are counted, the counts summed up, and the hits copied. If they do not all fit, none of the batch is
//! kept and no further batch is traced, so that the particles that count, m of (7.4), are those of whole batches. Hits stored earlier
//! are not touched.
//!
//! Cost: 64 bytes for each slot, and for each hit 64 bytes more.

use super::layout::SplatParameters;
use super::splat_start::SplatState;
use super::{BoundKernel, Kit, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Slots of a block. Shader twin: `BLOCK`.
pub const BLOCK: u32 = 64;

/// The pass.
pub struct SplatPack {
    count: BoundKernel,
    scan: BoundKernel,
    store: BoundKernel,
    blocks: u32,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Hits of the batch in their slots.
    pub fresh: &'a Buffer,
    /// A [`SplatState`].
    pub state: &'a Buffer,
    /// Hits stored.
    pub hits: &'a Buffer,
    /// Hits of each surface.
    pub surface_hits: &'a Buffer,
}

impl SplatPack {
    /// For batches with so many slots.
    pub fn new(kit: &Kit, inputs: &Inputs, slots: u32, own: &Resources) -> Result<Self> {
        let blocks = slots.div_ceil(BLOCK);
        let sums = kit.array("hits of blocks", blocks, 4)?;
        let set = Resources::of([
            ("fresh", inputs.fresh),
            ("block_sums", &sums),
            ("splat_state", inputs.state),
            ("splat_hits", inputs.hits),
            ("surface_hits", inputs.surface_hits),
        ]);
        let bind = |shader| kit.bind(shader, &[&set, own]);
        let [count, scan] = [bind(&shaders::SPLAT_PACK_COUNT)?, bind(&shaders::SPLAT_PACK_SCAN)?];
        Ok(SplatPack { count, scan, store: bind(&shaders::SPLAT_PACK)?, blocks })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.count.run(rec, &[], groups(self.blocks))?;
        self.scan.run(rec, &[], 1)?;
        self.store.run(rec, &[], groups(self.blocks))
    }
}

/// Oracle: appends the hits of a batch; slots without a hit have surface 0 in the last word of their first vector.
pub fn reference(
    parameters: &SplatParameters,
    state: &mut SplatState,
    hits: &mut Vec<[[u32; 4]; 2]>,
    fresh: &[[[u32; 4]; 2]],
) {
    let found: Vec<[[u32; 4]; 2]> = fresh.iter().filter(|hit| hit[0][3] > 0).copied().collect();
    if state.full == 1 || hits.len() + found.len() > parameters.capacity as usize {
        (state.full, state.base) = (1, u32::MAX);
        return;
    }
    state.base = state.hits;
    state.hits += found.len() as u32;
    state.particles += state.count;
    hits.extend(found);
}
