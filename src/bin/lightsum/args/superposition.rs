//! The flags of glossy planes.

use clap::{Args, ValueEnum};
use lightsum::settings::{Reflectance, Settings, Spread, Superposition};

/// How glossy planes mirror the room.
#[derive(Debug, Args)]
#[command(next_help_heading = "Glossy planes")]
pub struct Glossy {
    /// Show the mirror image of the room on glossy planes, spread like this [default: the scene's, or off].
    ///
    /// Without it they show the highlights of the virtual lights alone, which take many passes to become smooth. Costs a ray for each
    /// pixel that shows such a plane, and the convolution. A scene without such planes does not pay.
    #[arg(long, value_name = "HOW", value_enum)]
    pub superposition: Option<SpreadFlag>,
    /// How the reflectance of glossy planes is found [default: schlick].
    #[arg(long, value_name = "HOW", value_enum)]
    pub reflectance: Option<ReflectanceFlag>,
    /// Width in pixels of the kernel of --superposition invariant, 0 to 4096 [default: 15].
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(0..=4096))]
    pub kernel_width: Option<u32>,
    /// Let the blurred image of what is far run over the sharp one of what is near: a little faster.
    #[arg(long)]
    pub no_occlusion: bool,
    /// Glossy planes that mirror the room, the greatest first, 0 to 255 [default: 255]. Fewer cost less.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=255))]
    pub reflectors: Option<u32>,
}

/// Values of `--superposition`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SpreadFlag {
    /// Glossy planes show highlights of virtual lights
    Off,
    /// Not spread: every glossy plane is a mirror
    Mirror,
    /// One kernel for the whole image, as wide as --kernel-width
    Invariant,
    /// The kernel of the material, wider where the reflected point is farther
    Variant,
}

/// Values of `--reflectance`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReflectanceFlag {
    /// By Schlick's formula, as the lobes of all other surfaces
    Schlick,
    /// From a table of Fresnel's term
    Map,
    /// By Fresnel's term at each pixel
    Fresnel,
}

impl Glossy {
    /// Puts what the flags say into the settings.
    pub fn apply(&self, settings: &mut Settings) {
        let spread = match self.superposition {
            Some(SpreadFlag::Off) => None,
            Some(SpreadFlag::Mirror) => Some(Spread::Mirror),
            Some(SpreadFlag::Invariant) => Some(Spread::Invariant),
            Some(SpreadFlag::Variant) => Some(Spread::Variant),
            None => settings.superposition.map(|superposition| superposition.spread),
        };
        settings.superposition = spread.map(|spread| {
            let defaults = settings.superposition.unwrap_or_default();
            Superposition {
                spread,
                reflectance: match self.reflectance {
                    None => defaults.reflectance,
                    Some(ReflectanceFlag::Schlick) => Reflectance::Schlick,
                    Some(ReflectanceFlag::Map) => Reflectance::Map,
                    Some(ReflectanceFlag::Fresnel) => Reflectance::Fresnel,
                },
                occlusion: defaults.occlusion && !self.no_occlusion,
                kernel_width: self.kernel_width.unwrap_or(defaults.kernel_width),
                reflectors: self.reflectors.unwrap_or(defaults.reflectors),
            }
        });
    }
}
