//! Photons continue at mirrors and glass and are stored at the first other surface (Wald et al. 2002, section 4): the
//! paths L S+ D.
//!
//! A photon whose first hit is not what it is aimed at is dropped: it is direct light, or another photon's. At glass one
//! component is chosen with probability p, in proportion to the weights, and flux is scaled by the adjoint of the
//! throughput of radiance ([`crate::bsdf::ideal::BsdfSample`]):
//!
//! ```text
//! Phi *= f a / p      f as in `eye_paths`, a = eta^2 through glass, times the correction for shading normals
//! ```
//!
//! A mirror over a diffuse base stores a fraction of its photons, in proportion to the weight of the base; but at the
//! first hit all photons are reflected, since light that reaches the base straight is direct light. A photon that has
//! met nothing else after `max_specular` of these steps is dropped.
//!
//! If there are mirrored lights ([`super::mirror_lights`]), photons whose only reflection was at a planar mirror are
//! not stored.
//!
//! Differs from the paper in that: the paper does not say how it chooses components.
//! Bias: light over more mirrors and glass surfaces is missing.
//!
//! Cost: for each photon still in flight 220 bytes, 300 operations and one ray of `trace`.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::surface::SurfacePoint;
use super::{BoundKernel, Kit, List, Rays, groups, layout, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::Normals;
use crate::bsdf::ideal::{Media, specular_samples};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::sampling::dimensions::PHOTON_COMPONENT;
use crate::sampling::random::{key, random_f32};
use crate::scene::Scene;

/// One step of all photons.
pub struct PhotonFollow {
    kernel: BoundKernel,
    work_in: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Traced rays; overwritten by the next ones.
    pub rays: &'a Rays,
    /// Flux; w: bits of what it is aimed at ([`Shot::aim`](crate::light::targets::Shot::aim)).
    pub flux: &'a Buffer,
    /// Glass media around the photons.
    pub media: &'a Buffer,
    /// Positions of stored photons; w: 1 if stored.
    pub position: &'a Buffer,
    /// Geometric normals there, on the side of arrival.
    pub normal: &'a Buffer,
    /// Photons to continue, for steps after the first.
    pub list_in: &'a List,
    /// Photons to trace.
    pub list_out: &'a List,
}

impl PhotonFollow {
    /// Replaces `rays` that met a mirror or glass and appends them to `list_out`; stores the other photons.
    pub fn new(kit: &Kit, inputs: &Inputs, steps: &Resources) -> Result<Self> {
        let Inputs { rays, flux, media, position, normal, list_in, list_out } = *inputs;
        let own =
            Resources::of([("flux", flux), ("media", media), ("photon_position", position), ("photon_normal", normal)]);
        let sets = [&rays.resources(), &list_in.as_input(), &list_out.as_output(), &own, steps];
        let shaders = [&shaders::PHOTON_FOLLOW, &shaders::PHOTON_FOLLOW_UNTEXTURED];
        Ok(PhotonFollow { kernel: kit.bind_surface(shaders, &sets)?, work_in: list_in.work.clone() })
    }

    /// Records the step over the photons of the list; `count`: over this number of photons, for the first step.
    pub fn record(&self, rec: &mut Recorder, step: u32, count: Option<u32>) -> Result<()> {
        match count {
            Some(count) => self.kernel.run(rec, &push(step), groups(count)),
            None => self.kernel.run_listed(rec, &push(step), &self.work_in, LIST_GROUPS),
        }
    }
}

/// Result of a step for a photon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// It is dropped.
    Lost,
    /// It is stored with this flux.
    Stored(Vec3),
    /// It continues with this ray, flux and glass media.
    Flies(Ray, Vec3, Media),
}

/// Oracle, without mirrored lights: a photon of flux `flux` in `media` that travelled in direction `d` and hit
/// `surface`; `aimed`: the surface belongs to the photon's target; `last`: the photon may not continue; `bounces`: of the light
/// that it left.
#[allow(clippy::too_many_arguments)]
pub fn reference(
    frame: &layout::FrameParameters,
    scene: &Scene,
    (step, last): (u32, bool),
    photon: u32,
    (d, flux, media): (Vec3, Vec3, Media),
    surface: &SurfacePoint,
    (aimed, bounces): (bool, f32),
) -> Fate {
    // The eye's segment, those of the photon, and those of the light that it left.
    let fits = step + 2 + bounces as u32 <= frame.scene[2];
    let s = surface;
    let material = &scene.materials[s.material as usize];
    let normals = Normals { geometric: s.geometric, shading: s.shading, front: s.front };
    let eta = media.relative_index(&scene.materials, s.material, s.front);
    let first = step == 0;
    let Some(samples) = specular_samples(material, &s.finish, &normals, -d, eta, frame.reflectance()) else {
        return if first || !fits { Fate::Lost } else { Fate::Stored(flux) };
    };
    if last || first && !aimed {
        return Fate::Lost;
    }
    let reflected = samples.reflected;
    let split = samples.split(s.reflectance.kd);
    let xi = random_f32(key(frame.keys[0], PHOTON_COMPONENT, photon, step));
    let (sample, chance) = match split.first {
        None if first => (reflected, 1.0),
        None if xi < split.probability && !fits => return Fate::Lost,
        None if xi < split.probability => return Fate::Stored(flux / split.probability),
        Some(sample) if xi < split.probability => (sample, split.probability),
        _ => (reflected, 1.0 - split.probability),
    };
    let after = flux * sample.weight * (sample.adjoint / chance);
    if after.max_element() <= 0.0 {
        return Fate::Lost;
    }
    let side = if sample.wi.dot(s.geometric) > 0.0 { s.geometric } else { -s.geometric };
    let origin = offset_origin(s.position, side, frame.eye[3]);
    let media = if sample.crosses { media.crossed(s.material, s.front) } else { media };
    Fate::Flies(Ray { origin, t_max: 3.0e38, direction: sample.wi }, after, media)
}
