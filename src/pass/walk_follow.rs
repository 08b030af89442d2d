//! Continues particles of the walk at mirrors and glass until they meet another surface, where they leave a light: the
//! paths L S+ D and L D ... S+ D to a virtual light, which lights the visible points.
//!
//! At a mirror or glass one component is chosen at random by Fresnel's equations, as for photons; at a mirror over a
//! diffuse base also the base, where the particle stays. A path counts the mirrors and glass between light and lit point
//! as segments, as the path tracer does, so at most `max_depth - 2 - j` are followed before the j-th reflection. Beyond
//! that mirrors show their base, and glass ends the path.
//!
//! Each path is counted once: photons carry light that reaches a visible point straight from mirrors or glass, virtual
//! lights all light whose last segment to a visible point is straight from another surface.
//!
//! Cost: that of `eye_points` for particles that hit mirrors or glass.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::surface::SurfacePoint;
use super::{BoundKernel, Kit, List, Rays, groups, layout, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::Normals;
use crate::bsdf::ideal::{Media, specular_samples};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::sampling::dimensions::WALK_COMPONENT;
use crate::sampling::random::{key, random_f32};
use crate::scene::Scene;

/// One step before a reflection.
pub struct WalkFollow {
    kernel: BoundKernel,
    work_in: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Traced rays; replaced by the next ones.
    pub particles: &'a Rays,
    /// Flux; w: number of mirrors and glass so far.
    pub flux: &'a Buffer,
    /// Glass media around the particles.
    pub media: &'a Buffer,
    /// Particles to continue, for steps after the first.
    pub list_in: &'a List,
    /// Particles to trace.
    pub list_out: &'a List,
}

impl WalkFollow {
    /// Replaces the rays of particles that met a mirror or glass and appends them to `list_out`.
    pub fn new(kit: &Kit, inputs: &Inputs, steps: &Resources) -> Result<Self> {
        let Inputs { particles, flux, media, list_in, list_out } = *inputs;
        let own = Resources::of([("flux", flux), ("media", media)]);
        let sets = [&particles.resources(), &list_in.as_input(), &list_out.as_output(), &own, steps];
        let shaders = [&shaders::WALK_FOLLOW, &shaders::WALK_FOLLOW_UNTEXTURED];
        Ok(WalkFollow { kernel: kit.bind_surface(shaders, &sets)?, work_in: list_in.work.clone() })
    }

    /// Records the step over the particles of the list; `count`: over this number of particles, for the first step.
    pub fn record(&self, rec: &mut Recorder, step: u32, count: Option<u32>) -> Result<()> {
        match count {
            Some(count) => self.kernel.run(rec, &push(step), groups(count)),
            None => self.kernel.run_listed(rec, &push(step), &self.work_in, LIST_GROUPS),
        }
    }
}

/// Result of a step for a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// The surface is neither mirror nor glass.
    Unchanged,
    /// It ends here, or stays on the base of a mirror, with this flux.
    Stays(Vec3),
    /// It continues with this ray, flux and glass media.
    Flies(Ray, Vec3, Media),
}

/// Oracle: a particle after `j - 1` reflections and `specular` mirrors and glass, of flux `flux` in `media`, that
/// travelled in direction `d` and hit `surface`.
pub fn reference(
    frame: &layout::FrameParameters,
    scene: &Scene,
    (j, specular): (u32, u32),
    particle: u32,
    (d, flux, media): (Vec3, Vec3, Media),
    surface: &SurfacePoint,
) -> Fate {
    let s = surface;
    let material = &scene.materials[s.material as usize];
    let normals = Normals { geometric: s.geometric, shading: s.shading, front: s.front };
    let eta = media.relative_index(&scene.materials, s.material, s.front);
    let Some(samples) = specular_samples(material, &s.finish, &normals, -d, eta, frame.reflectance()) else {
        return Fate::Unchanged;
    };
    let (reflected, split) = (samples.reflected, samples.split(s.reflectance.kd));
    let base = split.first.is_none();
    if j + specular + 3 > frame.scene[2] {
        return Fate::Stays(if base { flux } else { Vec3::ZERO });
    }
    let xi = random_f32(key(frame.keys[0], WALK_COMPONENT, particle, 16 * j + specular));
    let (sample, chance) = match split.first {
        None if xi < split.probability => return Fate::Stays(flux / split.probability),
        Some(sample) if xi < split.probability => (sample, split.probability),
        _ => (reflected, 1.0 - split.probability),
    };
    let after = flux * sample.weight * (sample.adjoint / chance);
    if after.max_element() <= 0.0 {
        return Fate::Stays(Vec3::ZERO);
    }
    let side = if sample.wi.dot(s.geometric) > 0.0 { s.geometric } else { -s.geometric };
    let origin = offset_origin(s.position, side, frame.eye[3]);
    let media = if sample.crosses { media.crossed(s.material, s.front) } else { media };
    Fate::Flies(Ray { origin, t_max: 3.0e38, direction: sample.wi }, after, media)
}
