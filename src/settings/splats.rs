//! Settings of splats: glossy surfaces shown by particles stored on them.

use serde::{Deserialize, Serialize};

/// How glossy surfaces are shown that show no convolved mirror image: value of the key `glossy`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GlossyForm {
    /// Highlights of all lights, and eye paths along narrow lobes.
    Paths,
    /// Highlights of direct light, and splats of particles.
    Splats,
}

/// Splats (Bastos 1999, section 7.3): glossy surfaces that show no mirror image reflect the light of particles that are stored where they
/// arrived, and direct light by the virtual lights on the emitters. The particles are traced before the first pass, and again when the
/// scene, the size of the image or settings change; another camera costs none.
///
/// Biased: reflections are blurred over the kernels. In place of `glossy_paths`, whose paths still follow lobes with alpha up to `alpha`.
/// Not in an atlas or a ring, nor with kept light or imported lights that replace all others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Splats {
    /// Particles that leave the emitters. Default 100,000; 1 to [`Splats::MAX_PARTICLES`]. At most as many hits are stored: then fewer
    /// particles count. More: sharper reflections with the same noise; some 110 bytes and 3 microseconds each, once.
    pub particles: u32,
    /// C of the diameter of a kernel, h = C sqrt(A / n) for n hits on a surface of area A. Default 32; 1 to 100. Higher: less noise, more
    /// blur, and time in proportion to its square.
    pub width: f32,
    /// Lobes up to this GGX alpha are left to eye paths, or to virtual lights where `glossy_paths` is off: few particles arrive from
    /// within them. Default 0.1; 0 to 1.
    pub alpha: f32,
}

impl Default for Splats {
    fn default() -> Splats {
        Splats { particles: 100_000, width: 32.0, alpha: 0.1 }
    }
}

impl Splats {
    /// The settings after a choice of the form and of particles, width and alpha, as of flags or keys; `None` leaves each as it is.
    pub fn chosen(
        before: Option<Splats>,
        form: Option<GlossyForm>,
        (particles, width, alpha): (Option<u32>, Option<f32>, Option<f32>),
    ) -> Option<Splats> {
        let splats = match form {
            Some(GlossyForm::Paths) => None,
            Some(GlossyForm::Splats) => Some(before.unwrap_or_default()),
            None => before,
        };
        splats.map(|splats| Splats {
            particles: particles.unwrap_or(splats.particles),
            width: width.unwrap_or(splats.width),
            alpha: alpha.unwrap_or(splats.alpha),
        })
    }

    /// Maximum `particles`: their hits fit one storage binding of the smallest devices.
    pub const MAX_PARTICLES: u32 = 4_000_000;
}
