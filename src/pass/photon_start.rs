//! Shoots caustic photons from the emitters and from virtual lights at mirrors and glass (Wald et al. 2002, section 4).
//!
//! A point on an emitter is chosen as for particles, a body of mirrors or glass (a target) roughly in proportion to its
//! solid angle, and a direction in the cone around its bounding sphere or to a point of its area; [`crate::light::targets`] has
//! the densities and the flux. So nearly all photons hit something that makes caustics, and their sum over N is the
//! flux that the emitters send there.
//!
//! The last photons of each class, half of them where paths may be so long, start from the class's virtual lights after one and more
//! reflections, chosen by what they send to the targets (`photon_lights`): caustics of indirect light.
//!
//! Photon i of class k of pixels (Wald et al., 4.2) has number i K + k, with K classes, and takes point first + k N + i
//! of the chosen sequence (4.4), in its own rotation: the points of each class are consecutive, and so are those of all classes of a
//! pass together.
//!
//! Differs from the paper in that: the paper does not say how it aims photons, and shoots them from emitters only.
//! Cost for each photon: two visits of every target (at most 64), some 200 operations and 80 bytes.

use super::layout;
use super::{BoundKernel, Kit, Rays, groups, photon_lights};
use crate::accel::{Ray, offset_origin};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::light::emitters::{Emitters, Kind};
use crate::light::targets::Targets;
use crate::sampling::dimensions::{PHOTON, PHOTON_DIMENSIONS, PHOTON_SIDE};
use crate::sampling::halton::halton;
use crate::sampling::random::{hash, key, random_f32};
use crate::sampling::rotate;
use crate::sampling::sobol::{sobol, unit};
use crate::scene::Texture;
use glam::Vec3;

/// In place of the bounces of the light that a photon left: it comes from an emitter without area, which no path from the eye meets.
pub const WITHOUT_AREA: f32 = 0.5;

/// The pass.
pub struct PhotonStart {
    kernel: BoundKernel,
    photons: u32,
}

impl PhotonStart {
    /// Writes `rays`, `flux` (w: bits of what it is aimed at) and `position` (marked as not stored) of `photons` photons,
    /// those of all classes.
    pub fn new(
        kit: &Kit,
        (lights, sums): (&Buffer, &Buffer),
        rays: &Rays,
        [flux, position]: [&Buffer; 2],
        photons: u32,
    ) -> Result<Self> {
        let own =
            Resources::of([("lights", lights), ("light_sums", sums), ("flux", flux), ("photon_position", position)]);
        let shaders = [&shaders::PHOTON_START, &shaders::PHOTON_START_UNTEXTURED];
        Ok(PhotonStart { kernel: kit.bind_surface(shaders, &[&rays.resources(), &own])?, photons })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.photons))
    }
}

/// Oracle: the class of a photon.
pub fn class_of(frame: &layout::FrameParameters, photon: u32) -> u32 {
    photon % frame.pattern[2]
}

/// Oracle: the five sample coordinates of a photon.
pub fn photon_numbers(frame: &layout::FrameParameters, photon: u32) -> [f32; 5] {
    let [each, first, ..] = frame.photons;
    let index = first + class_of(frame, photon) * each + photon / frame.pattern[2];
    PHOTON_DIMENSIONS.map(|d| {
        let word = key(frame.keys[1], PHOTON, d as u32, 0);
        if frame.has(layout::FrameParameters::SOBOL) {
            return unit(sobol(d, index) ^ hash(word));
        }
        rotate(halton(d, index), random_f32(word))
    })
}

/// A photon that starts.
#[derive(Clone, Copy, Debug)]
pub struct Started {
    /// Its ray.
    pub ray: Ray,
    /// Flux if its class had this photon only.
    pub flux: Vec3,
    /// See [`Shot::aim`](crate::light::targets::Shot::aim).
    pub aim: u32,
    /// Bounces of the light that it left; 0: an emitter; [`WITHOUT_AREA`].
    pub bounces: f32,
}

/// Oracle: the start of a photon; `lights`: those of all classes, with the sums of `photon_lights`; `None`: it carries no flux.
pub fn reference(
    frame: &layout::FrameParameters,
    (emitters, textures): (&Emitters, &[Texture]),
    (lights, sums): (&[layout::PointLight], &[f32]),
    targets: &Targets,
    photon: u32,
) -> Option<Started> {
    let u = photon_numbers(frame, photon);
    let (each, from_emitters) = (frame.photons[0], frame.photon[3].to_bits());
    let times = |part: u32| each as f32 / part as f32;
    let choice = (u[4], frame.mirrors[2] > 0);
    let (shot, times, bounces) = if photon / frame.pattern[2] < from_emitters {
        let side = random_f32(key(frame.keys[0], PHOTON_SIDE, photon, 0));
        let start = emitters.sample_start(textures, u[2], u[3], side);
        let kind = emitters.list[start.emitter as usize].kind;
        let (origin, left) = match kind {
            Kind::Point | Kind::Spot | Kind::Directional => (start.position, WITHOUT_AREA),
            Kind::Environment => (start.position, 0.0),
            Kind::Triangle | Kind::Quad | Kind::Sphere | Kind::Imported => {
                (offset_origin(start.position, start.normal, frame.eye[3]), 0.0)
            }
        };
        (targets.shoot(emitters, &start, origin, choice, [u[0], u[1]])?, times(from_emitters), left)
    } else {
        let (pick, chance) = photon_lights::choose(frame, sums, class_of(frame, photon), u[2]);
        let light = &lights[pick];
        let shot = targets.shoot_from(light, choice, [u[0], u[1]])?;
        (shot, times(each - from_emitters) / chance, light.f0[3])
    };
    let ray = Ray { origin: shot.origin, t_max: 3.0e38, direction: shot.direction };
    let flux = shot.flux * times;
    (flux.max_element() > 0.0).then_some(Started { ray, flux, aim: shot.aim, bounces })
}
