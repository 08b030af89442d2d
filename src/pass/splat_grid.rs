//! Sorts the hits of particles into the cells of a hash table, once for all views.
//!
//! ```text
//! cell = floor(2 x / h)      code = cell . (a, b, c) + surface d  mod 2^32      bucket = hash(code) mod buckets
//! ```
//!
//! As [`super::photon_grid`], with cells half as wide as the kernels of each surface, so that a disc of diameter h meets three of them along
//! each axis: a point looks up as many hits where they are dense as where they are sparse. Hits of a bucket keep their order.
//!
//! Cost for n hits: 160 n bytes plus those of the sort, 24 dispatches.

use ash::vk;
use glam::Vec3;

use super::layout::SplatParameters;
use super::sort::{Sort, SortBuffers, SortSteps};
use super::{BoundKernel, Kit, List, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Image, Recorder, Resources, shaders};
use crate::sampling::random::hash;

/// Maximum number of bits of a bucket number: keys have 24, and places without a hit follow all buckets.
pub const MAX_BUCKET_BITS: u32 = 22;

/// Texels of a row of the image of sorted hits.
const ACROSS: u32 = 4096;

/// Hits in the order of their buckets.
#[derive(Clone)]
pub struct Grid {
    /// Number of hits, as [`super::layout::DispatchCounts::live`], and the order of all places.
    pub list: List,
    /// The hits, two texels each, row by row; in place of the surface the code of the cell. An image, because lavapipe loads texels faster than
    /// elements of buffers.
    pub hits: Image,
    /// First hit and end of each bucket.
    pub buckets: Buffer,
}

impl Grid {
    /// Allocates so many hits and buckets.
    pub fn new(kit: &Kit, hits: u32, buckets: u32) -> Result<Grid> {
        let rows = (2 * hits).div_ceil(ACROSS).max(1);
        Ok(Grid {
            list: List::new(kit, "splat grid", &kit.array("splat order", hits, 4)?)?,
            hits: Image::new(kit.context, "sorted splats", ACROSS, rows, vk::Format::R32G32B32A32_UINT)?,
            buckets: kit.array("splat buckets", buckets, 8)?,
        })
    }

    /// The buffers by their names in shaders, without the list.
    pub fn resources(&self) -> Resources {
        Resources::of([("splat_buckets", &self.buckets)]).with_image("sorted_hits", &self.hits)
    }
}

/// The pass.
pub struct SplatGrid {
    sort: Sort,
    cells: BoundKernel,
    grid: Grid,
    capacity: u32,
}

impl SplatGrid {
    /// Fills `grid` from the stored hits; `grid.list.work` holds the number of places as its total.
    pub fn new(
        kit: &Kit,
        [state, hits, width]: [&Buffer; 3],
        grid: &Grid,
        (steps, own): (&Resources, &Resources),
        capacity: u32,
    ) -> Result<SplatGrid> {
        let buffers = SortBuffers::new(kit, capacity, 1)?;
        let work = Resources::of([("work", &grid.list.work)]);
        let stored = Resources::of([("splat_state", state), ("splat_hits", hits), ("surface_width", width)]);
        let unsorted = Resources::of([("keys", buffers.unsorted())]);
        let keys = kit.bind(&shaders::SPLAT_KEYS, &[&stored, &unsorted, &work, own])?;
        let sort = Sort::by_keys(kit, keys, &grid.list, &buffers, steps)?;
        let sorted = Resources::of([("keys", buffers.sorted())]);
        let cells = kit.bind(&shaders::SPLAT_CELLS, &[&stored, &sorted, &work, &grid.resources(), own])?;
        Ok(SplatGrid { sort, cells, grid: grid.clone(), capacity })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder, steps: &SortSteps) -> Result<()> {
        rec.image_to_general(&self.grid.hits)?;
        rec.fill(&self.grid.buckets, 0)?;
        self.sort.record(rec, steps)?;
        self.cells.run(rec, &[], groups(self.capacity))
    }
}

/// Oracle: the code of a cell of a surface, numbered from 1.
pub fn code_of(cell: [i32; 3], surface: u32) -> u32 {
    super::photon_grid::code_of(cell, surface)
}

/// Oracle: the cell at a position; `width`: h of the surface.
pub fn cell_of(position: Vec3, width: f32) -> [i32; 3] {
    let cell = (position / (0.5 * width).max(1e-37)).clamp(Vec3::splat(-1e9), Vec3::splat(1e9));
    cell.floor().to_array().map(|c| c as i32)
}

/// Oracle: the order of hits at these positions, on these surfaces with kernels of these widths.
pub fn reference(parameters: &SplatParameters, hits: &[(Vec3, u32, f32)]) -> Vec<u32> {
    let bucket = |i: u32| {
        let (position, surface, width) = hits[i as usize];
        hash(code_of(cell_of(position, width), surface)) & parameters.buckets
    };
    let mut order: Vec<u32> = (0..hits.len() as u32).collect();
    order.sort_by_key(|&i| bucket(i));
    order
}
