//! Writes one layer of the film as an image, for a host that shows it: the light of one kind, or what the eye sees of the surfaces.
//!
//! | layer | shown |
//! |---|---|
//! | emission, diffuse, specular | radiance; the last two less the bias of the filters, as in files (see [`gain`](super::gain)) |
//! | direct, indirect | irradiance E as E / pi, the radiance of a white diffuse surface |
//! | albedo | itself |
//! | normal | (1 + n) / 2; black on the background |
//! | depth | u / (u + z) for a depth z, with a unit of length u; black on the background |
//! | classes, clusters | the albedo, in a false colour for each class of pixels or each cluster in screen order ([`clusters`](super::clusters)) |
//!
//! Cost: 2 to 8 vec4 a pixel; for diffuse and specular light 50 more of the pixels around it.

use ash::vk;
use glam::Vec3;

use super::display::Curve;
use super::{BoundKernel, groups, layout};
use crate::bsdf::mean;
use crate::error::{Error, Result};
use crate::film::Film;
use crate::gpu::{Context, Image, Kernel, Recorder, Resources, shaders};
use crate::output::{Layers, Tonemap};

/// Which layer.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Radiance emitted by the visible surface. Like the next two it needs [`Settings::summands`](crate::Settings::summands).
    Emission,
    /// Radiance reflected diffusely.
    Diffuse,
    /// Radiance reflected or transmitted by the specular lobe, a mirror or glass.
    Specular,
    /// Direct irradiance.
    Direct,
    /// Indirect irradiance.
    Indirect,
    /// Albedo.
    Albedo,
    /// Shading normal.
    Normal,
    /// Depth along the view direction.
    Depth,
    /// Classes of pixels of interleaved sampling.
    Classes,
    /// Clusters of pixels that shadow rays are traced for together, where they are in screen order.
    Clusters,
}

impl Layer {
    /// All of them.
    pub const ALL: [Layer; 10] = [
        Layer::Emission,
        Layer::Diffuse,
        Layer::Specular,
        Layer::Direct,
        Layer::Indirect,
        Layer::Albedo,
        Layer::Normal,
        Layer::Depth,
        Layer::Classes,
        Layer::Clusters,
    ];

    /// Whether the film has it only with [`Settings::summands`](crate::Settings::summands).
    pub fn is_summand(self) -> bool {
        matches!(self, Layer::Emission | Layer::Diffuse | Layer::Specular)
    }

    /// Whether it is light, which takes an exposure.
    pub fn is_light(self) -> bool {
        self.is_summand() || matches!(self, Layer::Direct | Layer::Indirect)
    }

    /// The curve by which a display shows it, if light is shown by `tonemap`.
    pub fn curve(self, tonemap: Tonemap) -> Curve {
        match self {
            Layer::Albedo | Layer::Classes | Layer::Clusters => Curve::Tone(Tonemap::Srgb),
            Layer::Normal | Layer::Depth => Curve::Linear,
            _ => Curve::Tone(tonemap),
        }
    }

    fn number(self) -> u32 {
        match self {
            Layer::Emission => 0,
            Layer::Diffuse => 1,
            Layer::Specular => 2,
            Layer::Direct | Layer::Indirect => 3,
            Layer::Albedo => 4,
            Layer::Normal => 5,
            Layer::Depth => 6,
            Layer::Classes => 7,
            Layer::Clusters => 8,
        }
    }
}

/// The pass.
pub struct ShowLayer {
    /// The layer: RGBA, 32-bit float, layout GENERAL after the first [`ShowLayer::record`].
    pub image: Image,
    kernel: BoundKernel,
    layer: Layer,
    is_new: bool,
}

impl ShowLayer {
    /// Shows a layer of `film`, whose image has this size. Errors: the film has no such layer.
    pub fn new(context: &Context, film: &Film, size: [u32; 2], layer: Layer) -> Result<ShowLayer> {
        let image = Image::new(context, "layer", size[0], size[1], vk::Format::R32G32B32A32_SFLOAT)?;
        let own = film.as_layer(layer).ok_or_else(|| Error::Resource {
            name: String::from("film"),
            message: format!("has no layer {layer:?}; set Settings::summands"),
        })?;
        let own = own.with_image("layer", &image);
        let shader = if layer.is_summand() { &shaders::LAYER_SUMMANDS } else { &shaders::LAYER };
        let kernel = Kernel::new(context, shader)?.bind_from(&[&own, &film.as_means()], &Resources::new())?;
        Ok(ShowLayer { image, kernel: BoundKernel(kernel), layer, is_new: true })
    }

    /// Records the pass; `unit` as in the table above, scene units; `pattern`: that of interleaved sampling.
    pub fn record(&mut self, rec: &mut Recorder, unit: f32, pattern: [u32; 2]) -> Result<()> {
        rec.begin();
        if self.is_new {
            rec.image_to_general(&self.image)?;
        }
        let push = layout::LayerPush { kind: self.layer.number(), unit, pattern };
        let pixels = self.image.width() * self.image.height();
        rec.scope("layer", |rec| self.kernel.run(rec, bytemuck::bytes_of(&push), groups(pixels)))?;
        self.is_new = false;
        Ok(())
    }
}

/// Oracle: a layer of a pixel as it is shown, from the layers of files; these must have it.
pub fn reference(layers: &Layers, pixel: usize, layer: Layer, unit: f32, pattern: [u32; 2]) -> Vec3 {
    let classes = pattern[0] * pattern[1];
    let [x, y] = [pixel as u32 % layers.width, pixel as u32 / layers.width];
    let class = x % pattern[0] + pattern[0] * (y % pattern[1]);
    let shaded = |number: u32| false_color(number) * (0.25 + 0.75 * mean(layers.albedo[pixel]).min(1.0));
    match layer {
        Layer::Emission => layers.emission[pixel],
        Layer::Diffuse => layers.diffuse[pixel],
        Layer::Specular => layers.specular[pixel],
        Layer::Direct => layers.direct[pixel] / std::f32::consts::PI,
        Layer::Indirect => layers.indirect[pixel] / std::f32::consts::PI,
        Layer::Albedo => layers.albedo[pixel],
        Layer::Normal => match layers.normal[pixel] {
            Vec3::ZERO => Vec3::ZERO,
            normal => 0.5 * (Vec3::ONE + normal),
        },
        Layer::Depth => match layers.depth[pixel] {
            depth if depth.is_finite() => Vec3::splat(unit / (unit + depth)),
            _ => Vec3::ZERO,
        },
        Layer::Classes => shaded(class),
        Layer::Clusters => {
            let [across, down] = pattern.map(|n| 8 * n);
            shaded((x / across + layers.width.div_ceil(across) * (y / down)) * classes + class)
        }
    }
}

/// Oracle: the colour of a number; those of neighbouring numbers differ by a golden section of all hues.
pub fn false_color(number: u32) -> Vec3 {
    let hue = number.wrapping_mul(0x9e37_79b9) as f32 / 4_294_967_296.0;
    let channel = |turn: f32| 0.2 + 0.8 * (((hue + turn).fract() * 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0);
    Vec3::new(channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0))
}
