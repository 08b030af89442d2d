//! Writes the mean of the passes in the sums (see [`Film::counts`]), less the bias of the filters (see [`gain`](super::gain)), to the
//! image that a host shows or copies: linear radiance; alpha is coverage.
//!
//! Cost: 7 vec4 a pixel and, from [`gain::MIN_PASSES`](super::gain::MIN_PASSES) passes on, 50 of the pixels around it, with 350 operations.

use super::{BoundKernel, Kit, groups};
use crate::error::Result;
use crate::film::Film;
use crate::gpu::{Image, Recorder, Resources, shaders};

/// The pass.
pub struct Resolve {
    kernel: BoundKernel,
    pixels: u32,
}

impl Resolve {
    /// Writes `image` (RGBA, 32-bit float, layout GENERAL) from `film`. Needs no frame parameters, so it may come
    /// before the first pass.
    pub fn new(kit: &Kit, film: &Film, image: &Image) -> Result<Self> {
        let image_set = Resources::new().with_image("image", image);
        Ok(Resolve { kernel: kit.bind(&shaders::RESOLVE, &[&film.as_means(), &image_set])?, pixels: film.pixels() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}
