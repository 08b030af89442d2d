//! Unpacks words of pixels in further arrays of tasks that came packed: caustics, near light that spreads, what spreads mirror
//! images. Nothing is rounded. Oracle: [`TaskPoints::unpack`](crate::cluster::points::TaskPoints::unpack).
//!
//! Cost: 4 bytes read and 4 written a word, and 4 read where not all pixels have words.

use super::layout::UnpackMorePush;
use super::{BoundKernel, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Context, Kernel, Recorder, Resources, shaders};

/// The words of a task in an array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Number of the array.
    pub array: usize,
    /// First word of the grid of the task's pixels.
    pub grid: u32,
    /// First word: pixels that have words, if these are listed, then their words.
    pub first: u32,
    /// Pixels that have words.
    pub count: u32,
    /// Words of each.
    pub words: u32,
    /// Whether not all pixels of the task have words.
    pub is_listed: bool,
}

/// The pass, for one array.
pub struct UnpackMore {
    kernel: BoundKernel,
    begin: u32,
}

impl UnpackMore {
    /// Writes words of `packed` into a buffer whose array begins at a byte.
    pub fn new(context: &Context, packed: &Buffer, (further, begin): (&Buffer, u64)) -> Result<UnpackMore> {
        let own = Resources::of([("packed", packed), ("further", further)]);
        let kernel = Kernel::new(context, &shaders::UNPACK_MORE)?.bind_from(&[&own], &Resources::new())?;
        // A storage buffer has fewer bytes than a word can count.
        Ok(UnpackMore { kernel: BoundKernel(kernel), begin: (begin / 4) as u32 })
    }

    /// Records the words of a part, in an image of a width.
    pub fn record(&self, rec: &mut Recorder, part: &Part, width: u32) -> Result<()> {
        let Part { grid, first, count, words, is_listed, .. } = *part;
        if count == 0 {
            return Ok(());
        }
        let push = UnpackMorePush { first, count, words, is_listed: is_listed.into(), grid, width, begin: self.begin };
        self.kernel.run(rec, bytemuck::bytes_of(&push), groups(count * words))
    }
}
