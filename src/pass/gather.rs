//! One short ray from each shading point: the compensation of Kollig and Keller 2004 (*Illumination in the Presence of Weak
//! Singularities*).
//!
//! Clipping the distance to virtual lights takes from the integral over surfaces the share 1 - d^2 / clip^2 where d < clip.
//! That share is estimated by a path: a direction by the reflectance (diffuse lobe by the cosine law, specular lobe by
//! visible normals), traced no farther than clip. Its hit becomes a shading point of the next bounce with that weight,
//! lit by the same clipped lights and gathered from in turn until the path is as long as allowed, or until it ends by Russian roulette:
//! from the second ray on it goes on with the greatest channel of the weight of its reflection as probability, and is divided by it.
//! Of emitters the ray brings what rays aimed at them ([`super::near_aim`]) leave to it.
//!
//! The directions of a pixel over the passes follow one low-discrepancy sequence, randomised anew for every pixel. Of Sobol' points the
//! same two dimensions serve all bounces, in another order for each (padded replications, Wald et al. 2002, 4.4; see
//! [`crate::plan`]).
//!
//! **Near rays** (see [`super::near_points`]) are the first gather rays of half of the classes of pixels, and of all
//! second components behind mirrors and glass. With a filter, nine neighbours of a class have nine sample points and share their
//! light, else all pixels of a class have the same one: so the error is smooth, faint copies of the shadows between near surfaces
//! in place of noise. The points are a Kronecker sequence whose steps are the
//! powers 1/p and 1/p^2 of the plastic number p (Roberts 2018, *The Unreasonable Effectiveness of Quasirandom
//! Sequences*).
//!
//! Differs from the paper in that: there the geometry term is bounded as a whole, cosines included; here only 1/d^2 is,
//! so that a ray of length clip is all that is ever needed.
//!
//! Cost: some 150 operations and 200 bytes a shading point, some 100 and 80 more for each emitter where there are at most
//! [`EMITTERS`](super::near_aim::EMITTERS), and one ray of `trace`.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::shade::ShadingPoint;
use super::{BoundKernel, Kit, List, Rays, ShadingPoints, layout, near_points, push};
use crate::accel::Ray;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, Shader, shaders};
use crate::sampling::dimensions::{GATHER, GATHER_LOBE, GATHER_ROULETTE};
use crate::sampling::halton::radical_inverse;
use crate::sampling::random::{hash, key, random_f32};
use crate::sampling::rotate;
use crate::sampling::sobol::unit;
use crate::scene::Material;

/// The pass from one set of shading points.
pub struct Gather {
    kernel: BoundKernel,
    work: Buffer,
}

impl Gather {
    /// Writes `rays` and multiplies `beta` for the points in `list`.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        list: &List,
        rays: &Rays,
        beta: &Buffer,
        steps: &Resources,
    ) -> Result<Self> {
        Self::of(kit, &shaders::GATHER, points, (list, None), (rays, beta, steps))
    }

    /// As [`Gather::new`] for a list that may have gaps; `started` receives the points.
    pub fn with_gaps(
        kit: &Kit,
        points: &ShadingPoints,
        (list, started): (&List, &List),
        rays: &Rays,
        beta: &Buffer,
        steps: &Resources,
    ) -> Result<Self> {
        Self::of(kit, &shaders::GATHER_GAPS, points, (list, Some(started)), (rays, beta, steps))
    }

    /// As [`Gather::with_gaps`] for near rays, which leave half of the classes of pixels in each pass and count for all.
    /// `started` receives the points that have a ray.
    pub fn of_near_rays(
        kit: &Kit,
        points: &ShadingPoints,
        (list, started): (&List, &List),
        rays: &Rays,
        beta: &Buffer,
        steps: &Resources,
    ) -> Result<Self> {
        Self::of(kit, &shaders::GATHER_NEAR, points, (list, Some(started)), (rays, beta, steps))
    }

    fn of(
        kit: &Kit,
        shader: &'static Shader,
        points: &ShadingPoints,
        (list, started): (&List, Option<&List>),
        (rays, beta, steps): (&Rays, &Buffer, &Resources),
    ) -> Result<Self> {
        let beta = Resources::of([("beta", beta)]);
        let started = started.map_or_else(|| Resources::of([]), List::as_output);
        let sets = [&points.resources(), &list.resources(), &started, &rays.resources(), &beta, steps];
        Ok(Gather { kernel: kit.bind(shader, &sets)?, work: list.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.kernel.run_listed(rec, &push(step), &self.work, LIST_GROUPS)
    }
}

/// Oracle: the ray, the throughput after it, and whether it left through the specular lobe.
pub fn reference(
    frame: &layout::FrameParameters,
    materials: &[Material],
    pixel: u32,
    bounce: u32,
    receiver: &ShadingPoint,
    beta: Vec3,
) -> (Ray, Vec3, bool) {
    let point = point(frame, pixel, bounce, GATHER);
    towards(frame, materials, (frame.sample_of(pixel), bounce), point, receiver, beta)
}

/// Oracle: sample point of a slot's ray of a bounce.
pub fn point(frame: &layout::FrameParameters, slot: u32, bounce: u32, stream: u32) -> [f32; 2] {
    [0, 1].map(|d| {
        let k = key(frame.keys[1], stream, frame.sample_of(slot), 2 * bounce + d as u32);
        if frame.has(layout::FrameParameters::SOBOL) {
            return unit(frame.sobol[bounce as usize][2 + d] ^ hash(k));
        }
        let base = frame.shifts[bounce as usize][2 + d].to_bits();
        rotate(radical_inverse(base, frame.size[3]), random_f32(k))
    })
}

/// Oracle: probability that a path goes on by a reflection of this weight.
pub fn survival(weight: Vec3, bounce: u32) -> f32 {
    if bounce == 0 { 1.0 } else { weight.max_element().min(1.0) }
}

/// Oracle: the near ray of a slot of a class with these flags.
pub fn near_reference(
    frame: &layout::FrameParameters,
    materials: &[Material],
    pixel: u32,
    (class, flags): (u32, u32),
    receiver: &ShadingPoint,
) -> (Ray, Vec3, bool) {
    let point = near_point(frame, pixel, class);
    let weight = Vec3::splat(near_points::ray_weight(frame, pixel, flags));
    towards(frame, materials, (frame.sample_of(pixel), 0), point, receiver, weight)
}

/// Oracle: point that gives the near ray of a slot its direction.
pub fn near_point(frame: &layout::FrameParameters, slot: u32, class: u32) -> [f32; 2] {
    let sending = near_points::ray_classes(frame.pattern[2]);
    let of_class = frame.size[3].wrapping_mul(sending).wrapping_add(near_points::near_order(frame, class));
    near_sequence(frame, (slot, class), of_class, GATHER)
}

/// Oracle: point number `of_class` of the sequence for a slot of a class, among those of its neighbours.
pub fn near_sequence(
    frame: &layout::FrameParameters,
    (slot, class): (u32, u32),
    of_class: u32,
    stream: u32,
) -> [f32; 2] {
    let ([width, _, pixels, _], [across, down, ..], spread) = (frame.size, frame.pattern, frame.mirrors[3]);
    let (second, pixel) = (slot >= pixels, slot % pixels);
    let place = [pixel % width / across % spread, pixel / width / down % spread];
    let of_pixels = of_class.wrapping_mul(spread * spread).wrapping_add(place[1] * spread + place[0]);
    let (n, begins) = if second { (class, frame.keys[0]) } else { (of_pixels, frame.keys[1]) };
    // The powers 1/p and 1/p^2 of the plastic number p, in units of 2^-32.
    let steps = [3_242_174_889u32, 2_447_445_414];
    [0, 1].map(|d| unit(n.wrapping_mul(steps[d]).wrapping_add(key(begins, stream, 0, d as u32))))
}

/// The ray of a sample point.
fn towards(
    frame: &layout::FrameParameters,
    materials: &[Material],
    (sample, bounce): (u32, u32),
    [u, v]: [f32; 2],
    receiver: &ShadingPoint,
    beta: Vec3,
) -> (Ray, Vec3, bool) {
    let r = receiver.gathering();
    let p = r.diffuse_probability();
    let diffuse = random_f32(key(frame.keys[0], GATHER_LOBE, sample, bounce)) < p;
    let (wi, weight) = r.sample_lobe(materials, diffuse, receiver.shading, receiver.wo, u, v);
    let above = wi.dot(receiver.geometric) > 0.0 && wi.dot(receiver.shading) > 0.0;
    let weight = match (above, bounce == 0 && diffuse) {
        (false, _) => Vec3::ZERO,
        // Irradiance of the eye's diffuse lobe: the albedo comes in when the image is put together.
        (true, true) => Vec3::splat(std::f32::consts::PI / p),
        (true, false) => weight,
    };
    let survival = survival(weight, bounce);
    let dies = random_f32(key(frame.keys[0], GATHER_ROULETTE, sample, bounce)) >= survival;
    let weight = if dies { Vec3::ZERO } else { weight / survival.max(1e-6) };
    let sends = above && !dies && (r.kd != Vec3::ZERO || !diffuse);
    let ray = Ray { origin: receiver.position, t_max: if sends { frame.up[3] } else { 0.0 }, direction: wi };
    (ray, beta * weight, !diffuse)
}
