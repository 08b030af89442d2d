//! Writes the mean of the passes in the sums (see [`Film::counts`]), less the bias of the filters (see [`gain`](super::gain)), to the
//! image that a host shows or copies: linear radiance; alpha is coverage.
//!
//! Cost: 7 vec4 a pixel and, from [`gain::MIN_PASSES`](super::gain::MIN_PASSES) passes on, 50 of the pixels around it, with 350 operations.

use ash::vk;

use super::{BoundKernel, groups};
use crate::error::{Error, Result};
use crate::film::Film;
use crate::gpu::{Context, Image, Kernel, Recorder, Resources, shaders};

/// The pass.
pub struct Resolve {
    kernel: BoundKernel,
    pixels: u32,
}

impl Resolve {
    /// Writes `image` (RGBA, 32-bit or 16-bit float, layout GENERAL), of as many pixels as `film`, from `film`. Radiance beyond the
    /// numbers of 16 bits becomes the greatest of them. Needs no frame parameters, so it may come before the first pass.
    ///
    /// Errors: another format, another number of pixels.
    pub fn new(context: &Context, film: &Film, image: &Image) -> Result<Self> {
        let misuse = |message: String| Err(Error::Resource { name: image.name().to_owned(), message });
        let shader = match image.format() {
            vk::Format::R32G32B32A32_SFLOAT => &shaders::RESOLVE,
            vk::Format::R16G16B16A16_SFLOAT => &shaders::RESOLVE_HALF,
            format => {
                return misuse(format!(
                    "light is written as R32G32B32A32_SFLOAT or R16G16B16A16_SFLOAT, not as {format:?}"
                ));
            }
        };
        let (width, height, pixels) = (image.width(), image.height(), film.pixels());
        if u64::from(width) * u64::from(height) != u64::from(pixels) {
            return misuse(format!("has {width}x{height} pixels, but the view has {pixels}"));
        }
        let set = Resources::new().with_image("image", image);
        let kernel = Kernel::new(context, shader)?.bind_from(&[&film.as_means(), &set], &Resources::new())?;
        Ok(Resolve { kernel: BoundKernel(kernel), pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}
