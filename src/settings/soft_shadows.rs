//! Settings of soft shadows by convolution.

use serde::{Deserialize, Serialize};

/// How large emitters cast shadows: value of the key `soft_shadows`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShadowForm {
    /// By many virtual lights, like all emitters.
    Off,
    /// By one ray from each point to the emitter's centre, and a convolution.
    Splat,
}

/// Soft shadows by convolution (Bastos 1999, section 8.2.3.1): direct light of the largest emitters is that of the whole area, times the hard shadow
/// of its centre, convolved with a kernel of the emitter's shape ([`crate::pass::soft_shadow`]). The virtual lights on these emitters
/// light what is seen in mirrors and glass, and show highlights.
///
/// The same in each pass, without noise, and biased. For a camera's image, in scenes where no surface lets part of the light pass. Emitters are parallelograms that
/// emit from one side without a texture; others keep their virtual lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SoftShadows {
    /// Number of emitters, by power. Default 4; 1 to [`SoftShadows::MAX_LIGHTS`]. More: fewer emitters left to virtual lights, and
    /// time in proportion.
    pub lights: u32,
}

impl Default for SoftShadows {
    fn default() -> SoftShadows {
        SoftShadows { lights: 4 }
    }
}

impl SoftShadows {
    /// The settings after a choice of the form and of the number of lights, as of flags or keys; `None` leaves either as it is.
    pub fn chosen(before: Option<SoftShadows>, form: Option<ShadowForm>, lights: Option<u32>) -> Option<SoftShadows> {
        let soft = match form {
            Some(ShadowForm::Off) => None,
            Some(ShadowForm::Splat) => Some(before.unwrap_or_default()),
            None => before,
        };
        soft.map(|soft| SoftShadows { lights: lights.unwrap_or(soft.lights) })
    }

    /// Maximum `lights`.
    pub const MAX_LIGHTS: u32 = 8;
}
