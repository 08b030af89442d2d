//! Photons go on at mirrors and glass and are stored at the first surface of another kind (Wald et al. 2002, section 4): the
//! paths L S+ D.
//!
//! A photon whose first hit is not the body that it was shot at carries nothing: it is direct light, or another photon's. At
//! glass one component is chosen with probability p, by its share of the weights, and flux goes by the adjoint of how radiance
//! does ([`crate::bsdf::ideal::Way`]):
//!
//! ```text
//! Phi *= f a / p      f as in `eye_paths`, a = eta^2 through a surface of glass, times the correction for shading normals
//! ```
//!
//! A mirror over a diffuse base takes as a share of its photons what its base is of its weights, and stores them; but at the
//! first hit all go on, with what the mirror reflects, since what comes to the base straight is direct light. After
//! `max_specular` of these steps a photon that has met nothing else is dropped.
//!
//! Where there are mirrored lights ([`super::mirror_lights`]), photons whose one mirror before they are stored is a planar one are
//! not stored.
//!
//! Differs from the paper in that: it does not say how components are chosen.
//! Bias: light that takes more mirrors and surfaces of glass is left out. Light that was diffusely reflected before them is as
//! well: those would be photons that start from virtual lights.
//!
//! Cost: for each photon that still flies 220 bytes, 300 operations and one ray of `trace`.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::surface::SurfacePoint;
use super::{BoundKernel, Kit, List, Rays, groups, layout, push};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::Normals;
use crate::bsdf::ideal::{Media, ways};
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

/// What the pass reads and writes.
pub struct Inputs<'a> {
    /// Traced rays; those that go on.
    pub rays: &'a Rays,
    /// Flux; w: bits of the target + 1.
    pub flux: &'a Buffer,
    /// Bodies of glass around the photons.
    pub media: &'a Buffer,
    /// Where photons are stored; w: 1 if they are.
    pub position: &'a Buffer,
    /// Geometric normals there, on the side of their arrival.
    pub normal: &'a Buffer,
    /// Photons to look at, for steps after the first.
    pub list_in: &'a List,
    /// Photons to be traced.
    pub list_out: &'a List,
}

impl PhotonFollow {
    /// Replaces `rays` that met a mirror or glass and puts them on `list_out`; stores the others.
    pub fn new(kit: &Kit, inputs: &Inputs, steps: &Resources) -> Result<Self> {
        let Inputs { rays, flux, media, position, normal, list_in, list_out } = *inputs;
        let own =
            Resources::of([("flux", flux), ("media", media), ("photon_position", position), ("photon_normal", normal)]);
        let sets = [&rays.resources(), &list_in.as_input(), &list_out.as_output(), &own, steps];
        let shaders = [&shaders::PHOTON_FOLLOW, &shaders::PHOTON_FOLLOW_UNTEXTURED];
        Ok(PhotonFollow { kernel: kit.bind_surface(shaders, &sets)?, work_in: list_in.work.clone() })
    }

    /// Records the step over the photons of the list; the first over all, `count`.
    pub fn record(&self, rec: &mut Recorder, step: u32, count: Option<u32>) -> Result<()> {
        match count {
            Some(count) => self.kernel.run(rec, &push(step), groups(count)),
            None => self.kernel.run_listed(rec, &push(step), &self.work_in, LIST_GROUPS),
        }
    }
}

/// What becomes of a photon in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// It is dropped.
    Lost,
    /// It is stored with this flux.
    Stored(Vec3),
    /// It goes on with this ray, flux and bodies of glass around it.
    Flies(Ray, Vec3, Media),
}

/// Oracle, without mirrored lights: a photon of flux `flux` in `media` that travelled in direction `d` and hit `surface`; `aimed` says whether that
/// belongs to the photon's target, `last` whether it may go on no more.
#[allow(clippy::too_many_arguments)]
pub fn reference(
    frame: &layout::Frame,
    scene: &Scene,
    (step, last): (u32, bool),
    photon: u32,
    (d, flux, media): (Vec3, Vec3, Media),
    surface: &SurfacePoint,
    aimed: bool,
) -> Fate {
    let s = surface;
    let material = &scene.materials[s.material as usize];
    let normals = Normals { geometric: s.geometric, shading: s.shading, front: s.front };
    let eta = media.relative_index(&scene.materials, s.material, s.front);
    let first = step == 0;
    let Some(ways) = ways(material, &s.finish, &normals, -d, eta) else {
        return if first { Fate::Lost } else { Fate::Stored(flux) };
    };
    if last || first && !aimed {
        return Fate::Lost;
    }
    let reflected = ways.reflected;
    let fork = ways.fork(s.reflectance.kd);
    let xi = random_f32(key(frame.keys[0], PHOTON_COMPONENT, photon, step));
    let (way, chance) = match fork.first {
        None if first => (reflected, 1.0),
        None if xi < fork.probability => return Fate::Stored(flux / fork.probability),
        Some(way) if xi < fork.probability => (way, fork.probability),
        _ => (reflected, 1.0 - fork.probability),
    };
    let after = flux * way.weight * (way.adjoint / chance);
    if after.max_element() <= 0.0 {
        return Fate::Lost;
    }
    let side = if way.wi.dot(s.geometric) > 0.0 { s.geometric } else { -s.geometric };
    let origin = offset_origin(s.position, side, frame.eye[3]);
    let media = if way.crosses { media.crossed(s.material, s.front) } else { media };
    Fate::Flies(Ray { origin, t_max: 3.0e38, direction: way.wi }, after, media)
}
