//! Lists the tiles of 8 x 8 pixels in which eye rays hit mirrors, glass, narrow lobes or glossy planes that mirror the room: work at
//! such pixels, and at their second components, is dispatched over these tiles alone.
//!
//! The list is in tile order, so that shading points appended from it are in a fixed order as well.
//! Cost: 24 bytes read for each pixel, fewer in tiles that are marked early; then one workgroup over all tiles.

use super::{BoundKernel, Kit, List, Rays, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Both steps of the pass.
pub struct Tiles {
    /// Of each tile: 1 if it is listed, else 0.
    pub marks: Buffer,
    mark: BoundKernel,
    list: BoundKernel,
    tiles: u32,
}

impl Tiles {
    /// Writes `list` (tiles, and one workgroup for each) from `rays.hits` of an image of `tiles` tiles.
    pub fn new(kit: &Kit, rays: &Rays, list: &List, tiles: u32) -> Result<Self> {
        let marks = kit.array("tile marks", tiles, 4)?;
        let own = Resources::of([("marks", &marks)]);
        Ok(Tiles {
            mark: kit.bind(&shaders::TILES_MARK, &[&rays.resources(), &own])?,
            list: kit.bind(&shaders::TILES_LIST, &[&list.resources(), &own])?,
            marks,
            tiles,
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.mark.run(rec, &[], groups(self.tiles))?;
        self.list.run(rec, &[], 1)
    }
}

/// Oracle: the tiles of such pixels in an image of this size; `ideal`: whether a pixel's eye ray hits a mirror, glass
/// or a glossy plane.
pub fn reference([width, height]: [u32; 2], ideal: &[bool]) -> Vec<u32> {
    let across = width.div_ceil(8);
    let marked = |tile: &u32| {
        let (x, y) = (tile % across * 8, tile / across * 8);
        (y..height.min(y + 8)).any(|y| (x..width.min(x + 8)).any(|x| ideal[(x + y * width) as usize]))
    };
    (0..across * height.div_ceil(8)).filter(marked).collect()
}
