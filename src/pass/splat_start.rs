//! Particles of splats start on the emitters (Bastos 1999, 7.3.1): in proportion to power, with directions distributed as the emission.
//!
//! Particle i takes point i of an Owen-scrambled Sobol' sequence: two dimensions for the emitter and the point on it, two for the direction,
//! and two for the direction after each hit. So more particles continue those that are there, and any number of them is evenly spread. The
//! sequence depends on the seed alone, not on pass or view.
//!
//! Differs from the thesis in that: there each source has a number m_i of particles in proportion to its power, here one number m of
//! particles chooses among all sources by power, so that flux / m is the power of a hit (7.4) and one m may grow.
//! Cost: some 300 operations and 48 bytes a particle.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::layout::FrameParameters;
use super::{BoundKernel, Kit, Rays, groups, push};
use crate::accel::{Ray, offset_origin};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::light::emitters::{Emitters, Kind};
use crate::sampling::dimensions::{SPLAT, SPLAT_SIDE};
use crate::sampling::random::{key, random_f32};
use crate::sampling::sobol::{scrambled, sobol, unit};
use crate::scene::Texture;

/// Parameters of splats; `shaders/include/splats.wgsl` says what each member is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SplatParameters {
    /// Maximum number of hits.
    pub capacity: u32,
    /// Buckets of the hash table - 1 (buckets are a power of 2).
    pub buckets: u32,
    /// Particles of a batch.
    pub particles: u32,
    /// Slots for the hits of a batch.
    pub slots: u32,
    /// Candidates of a point that one dispatch takes.
    pub chunk: u32,
    /// Dispatches for all candidates that a point may have.
    pub rounds: u32,
    /// C of h = C sqrt(A / n).
    pub width: f32,
    /// Splats show lobes with a greater alpha.
    pub alpha: f32,
}

/// State of the store, as the device counts it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SplatState {
    /// Hits stored.
    pub hits: u32,
    /// Particles of the batches that are stored.
    pub particles: u32,
    /// First particle of the latest batch.
    pub first: u32,
    /// Its particles.
    pub count: u32,
    /// Place of its first hit; all bits: they did not fit.
    pub base: u32,
    /// 1: a batch did not fit.
    pub full: u32,
}

/// The pass.
pub struct SplatStart {
    kernel: BoundKernel,
    particles: u32,
}

impl SplatStart {
    /// Chooses among `emitters`. Writes `rays` and `flux` of a batch of `particles`, and which batch it is to `state`.
    pub fn new(
        kit: &Kit,
        emitters: &Buffer,
        rays: &Rays,
        (flux, particles): (&Buffer, u32),
        (state, own): (&Buffer, &Resources),
    ) -> Result<Self> {
        let set = Resources::of([("emitters", emitters), ("flux", flux), ("splat_state", state)]);
        let shaders = [&shaders::SPLAT_START, &shaders::SPLAT_START_UNTEXTURED];
        Ok(SplatStart { kernel: kit.bind_surface(shaders, &[&rays.resources(), &set, own])?, particles })
    }

    /// Records the pass; the step holds the first particle and one past the last.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.kernel.run(rec, &push(step), groups(self.particles))
    }
}

/// Oracle: coordinates 2j and 2j + 1 of a particle.
pub fn numbers(frame: &FrameParameters, j: usize, particle: u32) -> [f32; 2] {
    [2 * j, 2 * j + 1].map(|d| unit(scrambled(sobol(d, particle), key(frame.keys[1], SPLAT, d as u32, 0))))
}

/// Oracle: ray and flux of a particle's start; flux as if there were no other particle.
pub fn reference(frame: &FrameParameters, (emitters, textures): (&Emitters, &[Texture]), particle: u32) -> (Ray, Vec3) {
    let [u0, u1] = numbers(frame, 0, particle);
    let side = random_f32(key(frame.keys[1], SPLAT_SIDE, particle, 0));
    let start = emitters.sample_start(textures, u0, u1, side);
    let leave = numbers(frame, 1, particle);
    let on_surface = match emitters.list[start.emitter as usize].kind {
        Kind::Triangle | Kind::Quad | Kind::Sphere | Kind::Imported => true,
        Kind::Point | Kind::Spot | Kind::Directional | Kind::Environment => false,
    };
    let origin = if on_surface {
        offset_origin(start.position, start.normal, frame.eye[3])
    } else {
        emitters.ray_origin(&start, leave)
    };
    (Ray { origin, t_max: 3.0e38, direction: emitters.sample_direction(&start, leave) }, start.flux)
}
