//! Adds the spread mirror image of a glossy plane to its pixels, scaled by the plane's reflectance towards the eye
//! (Bastos 1999, equation 4.15 and section 6.7): L += rho(mu) L_spread, with mu the cosine of the viewing angle.
//!
//! ```text
//! rho = F0 (energy(mu) - grazing(mu)) + F90 grazing(mu)      Schlick, as for the lobe's reflection of point lights
//! rho = energy(mu) F(mu)                                     Fresnel, equations 6.10 to 6.14
//! rho = map(mu)                                              the same from a table, F0 the mean of the material
//! ```
//!
//! A frosted pane transmits instead: rho = energy(mu) (1 - R(mu)) tint, R by Fresnel's equations as for a clear pane
//! ([`crate::bsdf::ideal`]), in all three forms.
//!
//! L_spread blends the results of the kernel's core and tail by the core's fraction. energy(mu) and grazing(mu) are the
//! lobe's own albedo and the part of it that F90 weights ([`crate::superposition::kernels`]).
//! [`crate::superposition::reflectance`] describes the table look-up and its error.
//!
//! Differs from the thesis in that: equation 6.9's division by pi (N.L)(N.V) is left out, see there; Schlick's formula
//! is the default, so that a plane has the same reflectance for the mirror image and for virtual lights.
//!
//! Cost: 80 bytes read (144 with the table), 16 written and 60 operations for each pixel that shows a glossy plane.

use glam::Vec3;

use super::mirror_image::{Planes, Tables};
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, List, ShadingPoints};
use crate::bsdf::Reflectance;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::settings;
use crate::superposition::reflectance::{ReflectanceMap, fresnel_fitted_rgb};

/// The pass.
pub struct Superpose {
    kernel: BoundKernel,
    tiles: Buffer,
}

impl Superpose {
    /// Adds the images that tail and core of the kernels have spread to `shown`, at pixels where `planes` has a plane.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        tiles: &List,
        (planes, [tail, core]): (&Planes, [&Buffer; 2]),
        tables: &Tables,
        shown: &Buffer,
    ) -> Result<Self> {
        let own = Resources::of([("spread", tail), ("core", core), ("shown", shown)]);
        let sets = [&points.resources(), &tiles.as_tiles(), &planes.resources(), &tables.resources(), &own];
        Ok(Superpose { kernel: kit.bind(&shaders::SUPERPOSE, &sets)?, tiles: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}

/// Oracle: reflectance of a plane of this finish whose lobe has this energy and grazing part at cosine `mu` of the
/// viewing angle.
pub fn reference(
    form: settings::Reflectance,
    finish: &Reflectance,
    map: &ReflectanceMap,
    [energy, grazing]: [f32; 2],
    mu: f32,
) -> Vec3 {
    match form {
        settings::Reflectance::Schlick => finish.f0 * (energy - grazing) + finish.f90 * grazing,
        settings::Reflectance::Fresnel => energy * fresnel_fitted_rgb(finish.f0, mu),
        settings::Reflectance::Map => map.look_up(mu),
    }
}
