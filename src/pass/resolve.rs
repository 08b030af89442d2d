//! The mean of the passes in the sums (see [`Film::counts`]), written to the image that a host shows or copies: linear
//! radiance, alpha is coverage.
//!
//! Cost: 5 vec4 a pixel.

use super::accumulate::Film;
use super::{Kernels, groups};
use crate::error::Result;
use crate::gpu::{Bindings, Image, Kernel, Recorder};

/// The pass.
pub struct Resolve {
    kernel: Kernel,
    bindings: Bindings,
    pixels: u32,
}

impl Resolve {
    /// Writes `image` (RGBA, 32-bit float, layout GENERAL) from `film`. Needs no frame parameters, so it may come before
    /// the first pass.
    pub fn new(kernels: &Kernels, film: &Film, image: &Image, pixels: u32) -> Result<Self> {
        let kernel = kernels.resolve.clone();
        let bindings = kernel.bind(&[
            ("sum_a", (&film.color[0]).into()),
            ("rest_a", (&film.color_rest[0]).into()),
            ("sum_b", (&film.color[1]).into()),
            ("rest_b", (&film.color_rest[1]).into()),
            ("counts", (&film.counts).into()),
            ("image", image.into()),
        ])?;
        Ok(Resolve { kernel, bindings, pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.dispatch(&self.kernel, &self.bindings, &[], groups(self.pixels))
    }
}
