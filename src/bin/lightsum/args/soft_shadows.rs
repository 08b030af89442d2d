//! The flags of soft shadows by convolution.

use clap::{Args, ValueEnum};
use lightsum::settings::{Settings, ShadowForm, SoftShadows};

/// Shadows of large emitters.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Soft shadows")]
pub struct SoftFlags {
    /// How the largest flat emitters cast shadows [default: the scene's, or off].
    #[arg(long, value_name = "HOW", value_enum)]
    pub soft_shadows: Option<SoftFlag>,
    /// Number of these emitters, by power, 1 to 8 [default: 4]. Time grows in proportion.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(SoftShadows::MAX_LIGHTS)))]
    pub soft_shadow_lights: Option<u32>,
}

/// Values of `--soft-shadows`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SoftFlag {
    /// By many virtual lights
    Off,
    /// By one ray to the emitter's centre for each pixel, and a convolution: no noise, but biased
    Splat,
}

impl SoftFlags {
    /// Applies the flags to the settings.
    pub fn apply(&self, settings: &mut Settings) {
        let form = self.soft_shadows.map(|flag| match flag {
            SoftFlag::Off => ShadowForm::Off,
            SoftFlag::Splat => ShadowForm::Splat,
        });
        settings.soft_shadows = SoftShadows::chosen(settings.soft_shadows, form, self.soft_shadow_lights);
    }
}
