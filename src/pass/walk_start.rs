//! Particles start at the emitters (Keller 1997, 3.2) and leave their first lights there.
//!
//! The emitter is chosen by the composition method in proportion to power, the point by an area-preserving map of
//! (Phi_2, Phi_3), the direction by (Phi_5, Phi_7), distributed as the emission. Particles start from emitters without
//! area too, and leave a black light: these emitters are lights by themselves, once a pass.
//!
//! The lights at the emitters, N_0 in each pass (see [`crate::settings::Settings::direct_lights`]), have points of their own: consecutive segments
//! of an Owen-scrambled (0, 2)-sequence, the Sobol' dimensions 0 and 1, whatever the sequence of the particles. Particles start
//! elsewhere.
//!
//! With interleaved sampling each class of pixels has N particles and a set of lights of its own: the particles from
//! consecutive segments of the sequence (Wald et al. 2002, 4.2 and 4.4), in an order that turns from pass to pass, the lights at the
//! emitters from a scrambling of its own.
//!
//! Jitter (Keller 1997, 4.1): each coordinate moves within its raster cell by 1 / b^n, b^(n-1) < N_j <= b^n, with b the base of its
//! dimension; the paper's approximation 1/N_j would overlap the next cell. Scrambled points are random in their cells anyway.
//!
//! Differs from the paper in that: the sequence is rotated for each of two independent instances, and the particles of
//! a pass start at a point of their segment that moves from pass to pass (see [`crate::plan::Plan::parameters`]).
//! Cost: some 200 operations and 144 bytes a particle.

use super::layout::{self, PointLight};
use super::{BoundKernel, Kit, Rays, groups};
use crate::accel::{Ray, offset_origin};
use crate::bsdf::mean;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::light::cosine;
use crate::light::emitters::{Emitters, Kind};
use crate::sampling::dimensions::{FIRST_LIGHT, JITTER, SIDE};
use crate::sampling::halton::radical_inverse;
use crate::sampling::random::{key, random_f32};
use crate::sampling::sobol::{scrambled, sobol, unit};
use crate::sampling::{grid_resolution, jitter, rotate};
use crate::scene::Texture;
use glam::Vec3;

/// The pass.
pub struct WalkStart {
    kernel: BoundKernel,
    particle_count: u32,
}

impl WalkStart {
    /// Chooses among `emitters`. Writes the lights at the emitters, and `particles` and `flux` of the particles that
    /// continue.
    pub fn new(
        kit: &Kit,
        emitters: &Buffer,
        particles: &Rays,
        [flux, lights]: [&Buffer; 2],
        particle_count: u32,
    ) -> Result<Self> {
        let own = Resources::of([("emitters", emitters), ("flux", flux), ("lights", lights)]);
        let shaders = [&shaders::WALK_START, &shaders::WALK_START_UNTEXTURED];
        Ok(WalkStart { kernel: kit.bind_surface(shaders, &[&particles.resources(), &own])?, particle_count })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.particle_count))
    }
}

/// Slot of a particle's light; `first` is the first slot for lights of this number of reflections. Particle i of class
/// k has number i K + k, so that the survivors of all K classes come before all others.
pub fn light_slot(frame: &layout::FrameParameters, particle: u32, first: u32) -> u32 {
    let [_, _, classes, lights] = frame.pattern;
    particle % classes * lights + first + particle / classes
}

/// Oracle: a coordinate of a point of the sequence, randomised for the instance.
fn sequence_point(frame: &layout::FrameParameters, dimension: usize, index: u32) -> f32 {
    let (j, d) = (dimension / 2, dimension % 2);
    if frame.has(layout::FrameParameters::SOBOL) {
        return unit(sobol(dimension, index) ^ frame.sobol[j][d]);
    }
    rotate(radical_inverse(frame.shifts[j][2 + d].to_bits(), index), frame.shifts[j][d])
}

/// Oracle: the two sample coordinates of the light that a particle leaves on an emitter.
pub fn first_light_numbers(frame: &layout::FrameParameters, particle: u32) -> [f32; 2] {
    let (of_class, class) = (particle / frame.pattern[2], particle % frame.pattern[2]);
    let index = frame.size[3] * frame.depths[0][0] + of_class;
    [0, 1].map(|d| unit(scrambled(sobol(d, index), key(frame.keys[1], FIRST_LIGHT, class, d as u32))))
}

/// Oracle: the two sample coordinates of a particle for its start (j = 0) or for the direction that leaves vertex j -
/// 1.
pub fn walk_numbers(frame: &layout::FrameParameters, j: usize, particle: u32) -> [f32; 2] {
    let [first, paths, rotation, _] = frame.walk;
    let classes = frame.pattern[2];
    let (of_class, segment) = (particle / classes, (particle + frame.keys[0] % classes) % classes);
    let index = first + segment * paths + (of_class + rotation) % paths;
    [0, 1].map(|d| {
        let x = sequence_point(frame, 2 * j + d, index);
        if !frame.has(layout::FrameParameters::JITTER) {
            return x;
        }
        let base = if frame.has(layout::FrameParameters::SOBOL) { 2 } else { frame.shifts[j][2 + d].to_bits() };
        let xi = random_f32(key(frame.keys[0], JITTER, particle, (2 * j + d) as u32));
        jitter(x, xi, grid_resolution(base, frame.depths[j.max(1)][0]))
    })
}

/// Oracle: light, ray and flux of a particle's start; only the first N_0 of a class leave the light.
pub fn reference(
    frame: &layout::FrameParameters,
    (emitters, textures): (&Emitters, &[Texture]),
    particle: u32,
) -> (PointLight, Ray, Vec3) {
    let with = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    let [u0, u1] = walk_numbers(frame, 0, particle);
    let side = random_f32(key(frame.keys[0], SIDE, particle, 0));
    let start = emitters.sample_start(textures, u0, u1, side);
    let kind = emitters.list[start.emitter as usize].kind;
    let leave = walk_numbers(frame, 1, particle);
    let direction = emitters.sample_direction(&start, leave);
    let surface = matches!(kind, Kind::Triangle | Kind::Quad | Kind::Sphere);
    let origin = if surface || kind == Kind::Imported {
        offset_origin(start.position, start.normal, frame.eye[3])
    } else {
        emitters.ray_origin(&start, leave)
    };
    let [u0, u1] = first_light_numbers(frame, particle);
    let place = emitters.sample_start(textures, u0, u1, side);
    let kind = emitters.list[place.emitter as usize].kind;
    let surface = matches!(kind, Kind::Triangle | Kind::Quad | Kind::Sphere);
    let share = if surface { f32::from_bits(frame.depths[0][2]) } else { 0.0 };
    let of_environment = || {
        let e = &emitters.list[place.emitter as usize];
        let density = emitters.environment_pdf(-place.normal);
        let irradiance = place.radiance * (e.area / e.probability * f32::from_bits(frame.depths[0][2]));
        PointLight {
            position: with(place.position, f32::from_bits(PointLight::DIRECTIONAL | PointLight::ENVIRONMENT)),
            normal: with(place.normal, 0.0),
            emit: with(irradiance, 1.0),
            wi: with(place.normal, frame.depths[0][0] as f32 * density),
            ..PointLight::default()
        }
    };
    let exponent = if surface { emitters.list[place.emitter as usize].exponent } else { 1.0 };
    let directed = if exponent == 1.0 { 0 } else { PointLight::DIRECTED };
    let soft = if frame.is_soft(place.emitter) { PointLight::SOFT } else { 0 };
    let on_emitter = || PointLight {
        position: with(
            offset_origin(place.position, place.normal, frame.eye[3]),
            f32::from_bits(PointLight::SURFACE | PointLight::CLIPPED | directed | soft),
        ),
        normal: with(place.normal, exponent - 1.0),
        emit: with(place.flux * (share * std::f32::consts::FRAC_1_PI * cosine::sharpness(exponent)), 1.0),
        wi: with(place.normal, frame.choice[1] * mean(place.radiance)),
        ..PointLight::default()
    };
    let light = if kind == Kind::Environment { of_environment() } else { on_emitter() };
    let flies = particle < frame.depths[0][3] * frame.pattern[2];
    let ray = Ray { origin, t_max: if flies { 3.0e38 } else { 0.0 }, direction };
    (light, ray, if flies { start.flux } else { Vec3::ZERO })
}
