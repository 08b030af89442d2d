//! The flags of glossy planes.

use super::soft_shadows::SoftFlags;
use super::splats::SplatFlags;
use clap::{Args, ValueEnum};
use lightsum::pass::convolve::Form;
use lightsum::settings::{Reflectance, Settings, Spread, Superposition};

/// Mirror images on glossy planes.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Glossy planes")]
pub struct Glossy {
    /// Show a convolved mirror image of the room on glossy planes, and on curved surfaces with the key `reflector` [default: the scene's, or off].
    ///
    /// Without it eye paths follow their lobes, as of other glossy surfaces, so that a single frame shows separate reflections. Costs
    /// the convolution. No cost in scenes without such surfaces.
    #[arg(long, value_name = "HOW", value_enum)]
    pub superposition: Option<SpreadFlag>,
    /// Reflectance model of mirrors and of the mirror images of glossy planes [default: schlick].
    #[arg(long, value_name = "HOW", value_enum)]
    pub reflectance: Option<ReflectanceFlag>,
    /// Width in pixels of the largest reflector's kernel with --superposition invariant, 0 to 4096 [default: 15]; others are as wide as
    /// their lobes are in proportion.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(0..=4096))]
    pub kernel_width: Option<u32>,
    /// Algorithm of the convolution [default: auto].
    #[arg(long, value_name = "FORM", value_enum)]
    pub convolution: Option<FormFlag>,
    /// Let the blurred image of far surfaces bleed over sharp near ones: a little faster.
    #[arg(long)]
    pub no_occlusion: bool,
    /// Maximum number of glossy planes and curved surfaces that mirror the room, 0 to 255 [default: 255]. Fewer cost less.
    ///
    /// The largest planes come first, then the largest curved surfaces.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=255))]
    pub reflectors: Option<u32>,
    #[command(flatten)]
    pub splats: SplatFlags,
    #[command(flatten)]
    pub soft: SoftFlags,
}

/// Values of `--superposition`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SpreadFlag {
    /// Eye paths follow the lobes of glossy planes
    Off,
    /// No convolution: every glossy plane is a mirror
    Mirror,
    /// One kernel for the whole image, as wide as --kernel-width
    Invariant,
    /// The material's kernel, wider for reflected points farther away
    Variant,
}

/// Values of `--convolution`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FormFlag {
    /// Direct for narrow kernels, else fast
    Auto,
    /// The sum over all pixels of each kernel, whose time grows with the square of its width
    Direct,
    /// A pyramid of images, with an error of 1 to 4 %
    Fast,
}

impl From<FormFlag> for Form {
    fn from(flag: FormFlag) -> Form {
        match flag {
            FormFlag::Auto => Form::Auto,
            FormFlag::Direct => Form::Direct,
            FormFlag::Fast => Form::Fast,
        }
    }
}

/// Values of `--reflectance`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReflectanceFlag {
    /// Schlick's approximation, as for highlights
    Schlick,
    /// A table of the Fresnel term
    Map,
    /// The Fresnel term at each pixel
    Fresnel,
}

impl From<ReflectanceFlag> for Reflectance {
    fn from(flag: ReflectanceFlag) -> Reflectance {
        match flag {
            ReflectanceFlag::Schlick => Reflectance::Schlick,
            ReflectanceFlag::Map => Reflectance::Map,
            ReflectanceFlag::Fresnel => Reflectance::Fresnel,
        }
    }
}

impl Glossy {
    /// Applies the flags to the settings.
    pub fn apply(&self, settings: &mut Settings) {
        self.splats.apply(settings);
        self.soft.apply(settings);
        let spread = match self.superposition {
            Some(SpreadFlag::Off) => None,
            Some(SpreadFlag::Mirror) => Some(Spread::Mirror),
            Some(SpreadFlag::Invariant) => Some(Spread::Invariant),
            Some(SpreadFlag::Variant) => Some(Spread::Variant),
            None => settings.superposition.map(|superposition| superposition.spread),
        };
        if let Some(reflectance) = self.reflectance {
            settings.reflectance = reflectance.into();
        }
        settings.superposition = spread.map(|spread| {
            let defaults = settings.superposition.unwrap_or_default();
            Superposition {
                spread,
                occlusion: defaults.occlusion && !self.no_occlusion,
                kernel_width: self.kernel_width.unwrap_or(defaults.kernel_width),
                form: self.convolution.map_or(defaults.form, Form::from),
                reflectors: self.reflectors.unwrap_or(defaults.reflectors),
                mirror_source: defaults.mirror_source,
            }
        });
    }
}
