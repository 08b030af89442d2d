//! Changes that a ring of paths makes to the settings of a plan.

use crate::error::{Error, Result};
use crate::ring::Ring;
use crate::settings::Settings;
use crate::view::View;

/// The settings of a ring: one set of lights for all pixels, and as many photons as all classes of them had.
pub(super) fn settings(asked: &Settings, ring: &Ring) -> Settings {
    Settings {
        particles: ring.paths(),
        direct_lights: None,
        light_pool: 0,
        pattern: [1, 1],
        filter: None,
        photons: asked.photons.saturating_mul(asked.classes()).min(Settings::MAX_PHOTONS),
        ..asked.clone()
    }
}

/// Checks that the images or lights of a ring fit its memory.
pub(super) fn check(settings: &Settings, view: &View) -> Result<()> {
    let Some(ring) = &settings.ring else { return Ok(()) };
    if view.camera().is_none() {
        let message = String::from("a ring keeps images of a camera, and texels have none; leave it out");
        return Err(Error::Setting { name: "--ring", message });
    }
    ring.check(view.size(), settings.max_depth)
}
