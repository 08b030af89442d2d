//! Turns an image of linear radiance into the colours of a display: exposure, a tone curve, 8 bits for each channel. For a host
//! that shows [`Engine::image`](crate::Engine::image), or a [`layer`](super::layer), in a window.
//!
//! ```text
//! c = curve(2^stops L)        rounded to 1/255
//! ```
//!
//! The curves are those of PNG files ([`Tonemap`]); alpha is 1. Cost: a vec4 read, 4 bytes written and some 60 operations a pixel.

use ash::vk;
use glam::Vec3;

use super::{BoundKernel, groups, layout};
use crate::error::Result;
use crate::gpu::{Context, Image, Kernel, Recorder, Resources, shaders};
use crate::output::Tonemap;

/// From radiance to the displayed colour.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curve {
    /// A curve of PNG files.
    Tone(Tonemap),
    /// The number itself, clipped to [0, 1]: for layers that are no light.
    Linear,
}

impl Curve {
    fn number(self) -> u32 {
        match self {
            Curve::Tone(Tonemap::Srgb) => 0,
            Curve::Tone(Tonemap::Aces) => 1,
            Curve::Tone(Tonemap::Agx) => 2,
            Curve::Linear => 3,
        }
    }
}

/// The pass.
pub struct Display {
    /// The image for a display: R8G8B8A8_UNORM of the size of the image, layout GENERAL after the first [`Display::record`].
    pub shown: Image,
    of: Image,
    kernel: BoundKernel,
    is_new: bool,
}

impl Display {
    /// Shows `image`: RGBA, 32-bit float, layout GENERAL.
    pub fn new(context: &Context, image: &Image) -> Result<Display> {
        let shown = Image::new(context, "display", image.width(), image.height(), vk::Format::R8G8B8A8_UNORM)?;
        let set = Resources::new().with_image("image", image).with_image("display", &shown);
        let kernel = Kernel::new(context, &shaders::DISPLAY)?.bind_from(&[&set], &Resources::new())?;
        Ok(Display { shown, of: image.clone(), kernel: BoundKernel(kernel), is_new: true })
    }

    /// Whether it shows this image.
    pub fn is_of(&self, image: &Image) -> bool {
        self.of.handle() == image.handle()
    }

    /// Records the pass; `stops` of exposure.
    pub fn record(&mut self, rec: &mut Recorder, stops: f32, curve: Curve) -> Result<()> {
        rec.begin();
        if self.is_new {
            rec.image_to_general(&self.shown)?;
        }
        let push = layout::DisplayPush { scale: stops.exp2(), curve: curve.number() };
        let pixels = self.of.width() * self.of.height();
        rec.scope("display", |rec| self.kernel.run(rec, bytemuck::bytes_of(&push), groups(pixels)))?;
        self.is_new = false;
        Ok(())
    }
}

/// Oracle: the colour of a pixel, each channel in [0, 1].
pub fn reference(radiance: Vec3, stops: f32, curve: Curve) -> Vec3 {
    let scaled = radiance * stops.exp2();
    match curve {
        Curve::Tone(tonemap) => tonemap.apply(scaled),
        Curve::Linear => scaled.map(|c| if c > 0.0 { c.min(1.0) } else { 0.0 }),
    }
}
