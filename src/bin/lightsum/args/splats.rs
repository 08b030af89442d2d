//! The flags of splats.

use clap::{Args, ValueEnum};
use lightsum::settings::{GlossyForm, Settings, Splats};

/// How glossy surfaces are shown that show no convolved mirror image.
#[derive(Clone, Debug, Default, Args)]
pub struct SplatFlags {
    /// How glossy surfaces are shown, but for planes under --superposition [default: the scene's, or paths].
    #[arg(long, value_name = "HOW", value_enum)]
    pub glossy: Option<GlossyFlag>,
    /// Particles of --glossy splats, 1 to 4000000 [default: 100000]. At most as many hits are stored.
    ///
    /// They are traced once, before the first pass. More: sharper reflections with the same noise, 110 bytes each.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(Splats::MAX_PARTICLES)))]
    pub splat_particles: Option<u32>,
    /// C of the diameter of a splat, C sqrt(A / n) for n hits on a surface of area A, 1 to 100 [default: 32].
    ///
    /// Higher: less noise, more blur, and time in proportion to its square.
    #[arg(long, value_name = "C", value_parser = width)]
    pub splat_width: Option<f32>,
    /// Lobes up to this GGX alpha (the square of the roughness) are left to paths, 0 to 1 [default: 0.1].
    #[arg(long, value_name = "ALPHA", value_parser = alpha)]
    pub splat_alpha: Option<f32>,
}

/// Values of `--glossy`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum GlossyFlag {
    /// Highlights of all lights, and eye paths along lobes with alpha up to 0.5
    Paths,
    /// Highlights of direct light, and splats of particles stored on the surfaces
    Splats,
}

fn within(text: &str, low: f32, high: f32) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| String::from("not a number"))?;
    if (low..=high).contains(&value) { Ok(value) } else { Err(format!("not in {low}..={high}")) }
}

fn width(text: &str) -> Result<f32, String> {
    within(text, 1.0, 100.0)
}

fn alpha(text: &str) -> Result<f32, String> {
    within(text, 0.0, 1.0)
}

impl SplatFlags {
    /// Applies the flags to the settings.
    pub fn apply(&self, settings: &mut Settings) {
        let form = self.glossy.map(|flag| match flag {
            GlossyFlag::Paths => GlossyForm::Paths,
            GlossyFlag::Splats => GlossyForm::Splats,
        });
        let numbers = (self.splat_particles, self.splat_width, self.splat_alpha);
        settings.splats = Splats::chosen(settings.splats, form, numbers);
    }
}
