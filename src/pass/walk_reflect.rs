//! The j-th reflection of the walk: particles that hit a surface leave a light there, and the first N_(j+1) continue
//! (fractional absorption, Keller 1997, 3.2 and figure 6).
//!
//! A light at a reflection keeps the particle's direction of incidence and the whole reflectance: its intensity towards
//! wo is Phi / N_j f_r(wi, wo) cos. A particle that continues takes the diffuse or the specular lobe at random.
//!
//! In a ring ([`crate::ring`]) nothing is absorbed by number: a particle that roulette ends leaves no light, others are brighter.
//!
//! Differs from the paper in that: figure 6 multiplies by N / floor(rho^j N) at every reflection, although the text's
//! factor is the ratio to the N that started, so each light here is divided by N_j once; surfaces may be glossy; and
//! the adjoint of shading normals is accounted for (Veach 1997, 5.3). Lobes of lights are widened
//! ([`crate::plan::MIN_LIGHT_ALPHA`]), with the same energy, and centred on the geometric normal. Ideal reflection and transmission come before
//! (`walk_follow`). Cost: that of `eye_points`, and some 200
//! operations, a particle; where a lobe is widened 6,000 more.

use super::layout::{self, PointLight};
use super::surface::SurfacePoint;
use super::walk_start::walk_numbers;
use super::{BoundKernel, Kit, Rays, groups, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::Reflectance;
use crate::bsdf::anisotropic::turned;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::ring::survives;
use crate::sampling::dimensions::LOBE;
use crate::sampling::random::{key, random_f32};
use crate::scene::Material;
use glam::Vec3;

/// The pass.
pub struct WalkReflect {
    kernel: BoundKernel,
}

impl WalkReflect {
    /// Reads `particles.hits`, writes lights, and `particles` and `flux` of the particles that continue.
    pub fn new(kit: &Kit, particles: &Rays, [flux, lights]: [&Buffer; 2], steps: &Resources) -> Result<Self> {
        let own = Resources::of([("flux", flux), ("lights", lights)]);
        let shaders = [&shaders::WALK_REFLECT, &shaders::WALK_REFLECT_UNTEXTURED];
        Ok(WalkReflect { kernel: kit.bind_surface(shaders, &[&particles.resources(), &own, steps])? })
    }

    /// Records the pass over at most `count` particles.
    pub fn record(&self, rec: &mut Recorder, step: u32, count: u32) -> Result<()> {
        self.kernel.run(rec, &push(step), groups(count))
    }
}

/// Oracle: light, next ray and flux of a particle of flux `flux` that travels in direction `d` and hits `surface`, after
/// `specular` mirrors and glass.
pub fn reference(
    frame: &layout::FrameParameters,
    materials: &[Material],
    j: usize,
    (particle, specular): (u32, u32),
    d: Vec3,
    flux: Vec3,
    surface: Option<&SurfacePoint>,
) -> (PointLight, Ray, Vec3) {
    let with = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    let nothing = (PointLight::default(), Ray { origin: Vec3::ZERO, t_max: 0.0, direction: d }, Vec3::ZERO);
    let Some(s) = surface.filter(|_| survives(frame, particle, j as u32)) else { return nothing };
    let r = &s.reflectance;
    let weight = if frame.cones[3] > 0.0 { 1.0 / frame.cones[3] } else { 1.0 };
    let arriving = flux * weight * (s.shading.dot(d) / s.geometric.dot(d).min(-1e-7)).min(4.0);
    let fits = j as u32 + specular + 2 <= frame.scene[2];
    let share = if fits { f32::from_bits(frame.depths[j][2]) } else { 0.0 };
    let origin = offset_origin(s.position, s.geometric, frame.eye[3]);
    let glossy = if r.f90 > 0.0 { PointLight::GLOSSY } else { 0 };
    let lobe = Reflectance { alpha: turned(r.alpha, s.shading, s.geometric), ..*r };
    let wide = lobe.widened(materials, s.geometric, -d, frame.pixel_offset[2]);
    let light = PointLight {
        position: with(origin, f32::from_bits(PointLight::SURFACE | PointLight::CLIPPED | glossy)),
        normal: with(s.geometric, 0.0),
        emit: with(arriving * share * r.eval_diffuse(), 1.0),
        wi: with(-d, wide.alpha),
        flux: with(arriving * share, wide.f90),
        f0: with(wide.f0, (j as u32 + specular) as f32),
    };
    let diffuse = random_f32(key(frame.keys[0], LOBE, particle, j as u32)) < r.diffuse_probability();
    let [u, v] = walk_numbers(frame, j + 1, particle);
    let (wi, weight) = r.sample_lobe(materials, diffuse, s.shading, -d, u, v);
    let (cos_geometric, cos_shading) = (wi.dot(s.geometric), wi.dot(s.shading));
    let flies = particle < frame.depths[j][3] * frame.pattern[2] && cos_geometric > 0.0 && cos_shading > 0.0;
    let flux = if flies { arriving * weight * (cos_geometric / cos_shading.max(1e-7)).min(4.0) } else { Vec3::ZERO };
    (light, Ray { origin, t_max: if flies { 3.0e38 } else { 0.0 }, direction: wi }, flux)
}
