//! Particles of splats are stored where they hit glossy surfaces, and reflected or absorbed (Bastos 1999, 7.3.1).
//!
//! A hit keeps its position and surface, the direction of incidence, the flux and the number of bounces (reflections, mirrors and glass)
//! before it. Hits before any bounce are direct light, which lights bring; they are not stored (7.3.2.1). Nor are hits on surfaces
//! without a lobe: no view asks for them.
//!
//! At a surface a particle takes the diffuse or the specular lobe at random and a direction from it, at mirrors and glass a component;
//! roulette then ends it with the probability of absorption, so that the greatest component of its flux stays the same.
//!
//! ```text
//! Phi' = Phi f cos / (p q)      q = min(max f cos / p, 1)
//! ```
//!
//! Differs from the thesis in that: flux is stored, which is F_i rho of (7.4); there attenuation and source are.
//! Cost: that of `walk_reflect`, and 32 bytes a hit.

use glam::Vec3;

use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::splat_start::numbers;
use super::surface::SurfacePoint;
use super::{BoundKernel, Kit, List, Rays, groups, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::Normals;
use crate::bsdf::ideal::{Media, specular_samples};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::sampling::dimensions::{SPLAT_COMPONENT, SPLAT_LOBE, SPLAT_ROULETTE};
use crate::sampling::random::{key, random_f32};
use crate::scene::Scene;

/// One step of the particles of a batch.
pub struct SplatFollow {
    kernel: BoundKernel,
    work_in: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Traced rays; overwritten by the next ones.
    pub rays: &'a Rays,
    /// Flux.
    pub flux: &'a Buffer,
    /// Glass media around the particles.
    pub media: &'a Buffer,
    /// Hits of the batch, two vectors for each particle and number of bounces.
    pub fresh: &'a Buffer,
    /// Surface + 1 of each triangle.
    pub surface_of: &'a Buffer,
    /// The latest batch.
    pub state: &'a Buffer,
    /// Particles to continue, for steps after the first.
    pub list_in: &'a List,
    /// Particles to trace.
    pub list_out: &'a List,
}

impl SplatFollow {
    /// Replaces `rays` of particles that are not absorbed and appends them to `list_out`.
    pub fn new(kit: &Kit, inputs: &Inputs, own: &Resources) -> Result<Self> {
        let Inputs { rays, flux, media, fresh, surface_of, state, list_in, list_out } = *inputs;
        let set = Resources::of([
            ("flux", flux),
            ("media", media),
            ("fresh", fresh),
            ("surface_of", surface_of),
            ("splat_state", state),
        ]);
        let sets = [&rays.resources(), &list_in.as_input(), &list_out.as_output(), &set, own];
        let shaders = [&shaders::SPLAT_FOLLOW, &shaders::SPLAT_FOLLOW_UNTEXTURED];
        Ok(SplatFollow { kernel: kit.bind_surface(shaders, &sets)?, work_in: list_in.work.clone() })
    }

    /// Records the step over the particles of the list; `count`: over this number of particles, for the first step.
    pub fn record(&self, rec: &mut Recorder, step: u32, count: Option<u32>) -> Result<()> {
        match count {
            Some(count) => self.kernel.run(rec, &push(step), groups(count)),
            None => self.kernel.run_listed(rec, &push(step), &self.work_in, LIST_GROUPS),
        }
    }
}

/// Oracle: the next ray of a particle, its flux and the glass around it; `None`: it is absorbed. The particle, of flux `flux` in
/// `media`, travelled in direction `d` and hits `surface` after `bounces`.
pub fn reference(
    frame: &FrameParameters,
    scene: &Scene,
    (particle, bounces): (u32, u32),
    (d, flux, media): (Vec3, Vec3, Media),
    surface: &SurfacePoint,
) -> Option<(Ray, Vec3, Media)> {
    let s = surface;
    let random = |stream: u32| random_f32(key(frame.keys[1], stream, particle, bounces));
    let by_base = |factor: f32| {
        let r = &s.reflectance;
        let [u, v] = numbers(frame, bounces as usize + 2, particle);
        let (wi, weight) =
            r.sample_lobe(&scene.materials, random(SPLAT_LOBE) < r.diffuse_probability(), s.shading, -d, u, v);
        let (cos_geometric, cos_shading) = (wi.dot(s.geometric), wi.dot(s.shading));
        let skew = (s.shading.dot(d) / s.geometric.dot(d).min(-1e-7)).min(4.0);
        let leave = (cos_geometric / cos_shading.max(1e-7)).min(4.0);
        let leaves = cos_geometric > 0.0 && cos_shading > 0.0;
        (wi, if leaves { weight * (skew * leave * factor) } else { Vec3::ZERO }, media)
    };
    let material = &scene.materials[s.material as usize];
    let normals = Normals { geometric: s.geometric, shading: s.shading, front: s.front };
    let eta = media.relative_index(&scene.materials, s.material, s.front);
    let (wi, weight, media) = match specular_samples(material, &s.finish, &normals, -d, eta, frame.reflectance()) {
        None => by_base(1.0),
        Some(samples) => {
            let reflected = samples.reflected;
            let split = samples.split(s.reflectance.kd);
            let takes_first = random(SPLAT_COMPONENT) < split.probability;
            match split.first {
                None if takes_first => by_base(1.0 / split.probability),
                Some(sample) if takes_first => {
                    let beyond = if sample.crosses { media.crossed(s.material, s.front) } else { media };
                    (sample.wi, sample.weight * (sample.adjoint / split.probability), beyond)
                }
                _ => (reflected.wi, reflected.weight * (reflected.adjoint / (1.0 - split.probability)), media),
            }
        }
    };
    let after = flux * weight;
    let survival = (after.max_element() / flux.max_element().max(1e-37)).clamp(0.0, 1.0);
    (random(SPLAT_ROULETTE) < survival).then(|| {
        let side = if wi.dot(s.geometric) > 0.0 { s.geometric } else { -s.geometric };
        let origin = offset_origin(s.position, side, frame.eye[3]);
        (Ray { origin, t_max: 3.0e38, direction: wi }, after / survival, media)
    })
}
