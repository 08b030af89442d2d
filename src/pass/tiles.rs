//! The tiles of 8 x 8 pixels in which eye rays met mirrors, glass or glossy planes that mirror, as a list: work at such pixels, and at their second
//! components, is dispatched over these tiles alone.
//!
//! The list is in the order of the tiles, so that what is appended to the receivers is in a fixed order as well.
//! Cost: 24 bytes read for each pixel but in tiles that are marked early; then one workgroup over all tiles.

use super::{Kernels, List, Rays, groups};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};
use crate::scene_buffers::SceneBuffers;

/// Both steps of the pass.
pub struct Tiles {
    mark: (Kernel, Bindings),
    list: (Kernel, Bindings),
    tiles: u32,
}

impl Tiles {
    /// Writes `list` (tiles, and one workgroup for each) from `rays.hits` of an image of so many `tiles`; `marks` has room for
    /// one number a tile.
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        scene: &SceneBuffers,
        rays: &Rays,
        marks: &Buffer,
        list: &List,
        tiles: u32,
    ) -> Result<Self> {
        let mut named = scene.surface_bindings();
        named.extend([("frame", frame.into()), ("hits", (&rays.hits).into()), ("marks", marks.into())]);
        let mark = kernels.tiles_mark.bind(&named)?;
        let list = kernels.tiles_list.bind(&[
            ("frame", frame.into()),
            ("marks", marks.into()),
            ("list", (&list.pixels).into()),
            ("work", (&list.work).into()),
        ])?;
        Ok(Tiles { mark: (kernels.tiles_mark.clone(), mark), list: (kernels.tiles_list.clone(), list), tiles })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.dispatch(&self.mark.0, &self.mark.1, &[], groups(self.tiles))?;
        rec.dispatch(&self.list.0, &self.list.1, &[], 1)
    }
}

/// Oracle: the tiles of an image of this size with such pixels; `ideal`: what its pixels see is a mirror, glass or a glossy plane.
pub fn reference([width, height]: [u32; 2], ideal: &[bool]) -> Vec<u32> {
    let across = width.div_ceil(8);
    let marked = |tile: &u32| {
        let (x, y) = (tile % across * 8, tile / across * 8);
        (y..height.min(y + 8)).any(|y| (x..width.min(x + 8)).any(|x| ideal[(x + y * width) as usize]))
    };
    (0..across * height.div_ceil(8)).filter(marked).collect()
}
