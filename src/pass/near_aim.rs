//! Rays aimed at near emitters, for the direct light that clipping removed.
//!
//! A near ray finds an emitter as rarely as it fills a small part of the hemisphere, and an emitter is far brighter than all else: beside
//! windows and lamps such hits were half of an image's squared error. So each shading point with an emitter within the clip distance, above its
//! horizon and facing it, sends a ray of its own at one, in each pass. Both kinds of rays together are weighted by the balance heuristic (Veach
//! and Guibas 1995): with n cos / pi the mean density of near rays (n: one over the pixels that a near ray stands for, times the probability of the
//! diffuse lobe) and p that of the aimed ones, an emitter of radiance L at distance d adds
//!
//! ```text
//! L (1 - d^2 / clip^2) cos / (n cos / pi + p)
//! ```
//!
//! to the irradiance, and what near rays find on emitters is multiplied by n cos / pi / (n cos / pi + p). There is no bias, whatever either ray meets.
//!
//! Hits of near rays that no pixel shows do the same as far as lights are clipped there, half the clip distance: those that are lit aim, and the rays
//! of the others that go on ([`near_points`]) take the place of near rays. Where clipped light is gathered exactly, each point that a gather
//! ray ([`gather`]) leaves aims one, too; there n is the probability of the lobe times that of the ray's survival.
//!
//! An emitter is chosen by its mean radiance times A / (d^2 + A), with d the distance of its nearest point and A its area. Of a parallelogram
//! the part around the foot of the perpendicular is aimed at, by the two angles that a point has along the edges as seen from the height over
//! the foot, each evenly distributed; of a triangle all, evenly by area; of a sphere the cone under which it is seen, evenly by solid angle.
//! Spheres that shine inwards and lights without area are not aimed at.
//!
//! Scenes with more than [`EMITTERS`] emitters have none of these rays: each point looks at all of them.
//!
//! Cost: some 100 operations and 80 bytes read for each point and emitter, twice that for points that have a ray, and a ray of `trace` as long
//! as the clip distance.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, PI, TAU};

use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, List, Rays, ShadingPoints, gather, near_points, push};
use crate::bsdf::{basis, mean};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::light::emitters::{Emitter, Kind};
use crate::sampling::ONE_MINUS_EPSILON;
use crate::sampling::dimensions::AIM;
use crate::sampling::random::{key, random_f32};

/// Number of emitters up to which rays aim at them.
pub const EMITTERS: usize = 8;
/// Height over the plane of a parallelogram at which it is seen, at least, in lengths of its longer edge.
pub const HEIGHT: f32 = 1e-4;

/// The pass.
pub struct NearAim {
    rays: BoundKernel,
    light: BoundKernel,
    works: [Buffer; 2],
    push: Vec<u8>,
}

/// Points that aim rays.
#[derive(Clone, Copy)]
pub enum Source<'a> {
    /// Those of pixels, listed with gaps, with near rays.
    Pixels,
    /// Hits of near rays.
    Hits,
    /// Those from which gather rays leave.
    Gathering {
        /// The list has gaps.
        gaps: bool,
        /// The table of steps.
        steps: &'a Resources,
        /// The step of the gather rays.
        step: u32,
    },
}

impl NearAim {
    /// From the points in `list`; `aimed` receives those that have a ray, `direct` their light.
    pub fn new(
        kit: &Kit,
        points: (Source, &ShadingPoints),
        (list, aimed): (&List, &List),
        rays: &Rays,
        direct: &Buffer,
    ) -> Result<Self> {
        let (from, points) = points;
        let lights = [&shaders::NEAR_AIM_LIGHT, &shaders::NEAR_AIM_LIGHT_UNTEXTURED];
        let (shader, lights, steps, push) = match from {
            Source::Pixels => (&shaders::NEAR_AIM, lights, None, Vec::new()),
            Source::Hits => {
                let lights = [&shaders::NEAR_AIM_LIGHT_HITS, &shaders::NEAR_AIM_LIGHT_HITS_UNTEXTURED];
                (&shaders::NEAR_AIM_HITS, lights, None, Vec::new())
            }
            Source::Gathering { gaps: true, steps, step } => {
                (&shaders::NEAR_AIM_GATHER_GAPS, lights, Some(steps), push(step).to_vec())
            }
            Source::Gathering { gaps: false, steps, step } => {
                (&shaders::NEAR_AIM_GATHER, lights, Some(steps), push(step).to_vec())
            }
        };
        let none = Resources::of([]);
        let steps = steps.unwrap_or(&none);
        let sets = [&points.resources(), &list.resources(), &aimed.as_output(), &rays.resources(), steps];
        let own = Resources::of([("direct", direct)]);
        Ok(NearAim {
            rays: kit.bind(shader, &sets)?,
            light: kit.bind_surface(lights, &[&aimed.resources(), &rays.resources(), &own])?,
            works: [list.work.clone(), aimed.work.clone()],
            push,
        })
    }

    /// Records the part that writes the rays.
    pub fn record_rays(&self, rec: &mut Recorder) -> Result<()> {
        self.rays.run_listed(rec, &self.push, &self.works[0], LIST_GROUPS)
    }

    /// Records the part that adds what the traced rays found.
    pub fn record_light(&self, rec: &mut Recorder) -> Result<()> {
        self.light.run_listed(rec, &[], &self.works[1], LIST_GROUPS)
    }
}

/// Oracle: part of an emitter that a point can reach, relative to the point.
#[derive(Clone, Copy, Debug)]
pub enum Part {
    /// First corner, edges, unit normal.
    Triangle(Vec3, [Vec3; 2], Vec3),
    /// Foot of the perpendicular, unit edges, unit normal, height, and the part along the edges from the foot.
    Parallelogram(Vec3, [Vec3; 2], Vec3, f32, [Vec2; 2]),
    /// Direction to the centre, and 1 - cosine of the angle under which the radius is seen.
    Cone(Vec3, f32),
}

/// Coordinates of a vector's projection along two edges that span a plane.
fn coordinates(v: Vec3, [a, b]: [Vec3; 2], normal: Vec3) -> Vec2 {
    let (p, q) = (b.cross(normal), a.cross(normal));
    Vec2::new(v.dot(p) / a.dot(p), v.dot(q) / b.dot(q))
}

impl Part {
    /// Of an emitter within `reach` of a point with normal `n`, and its weight in the choice.
    pub fn of(e: &Emitter, point: Vec3, n: Vec3, reach: f32) -> Option<(Part, f32)> {
        let to = e.p0 - point;
        let brightness = mean(e.radiance);
        match e.kind {
            Kind::Sphere => {
                let sine = e.e1.x / to.length();
                let reached = !e.inward && sine < 1.0 && to.length() - e.e1.x < reach && to.dot(n) > -e.e1.x;
                let cap = sine * sine / (1.0 + (1.0 - sine * sine).max(0.0).sqrt());
                reached.then_some((Part::Cone(to.normalize(), cap), brightness * PI * sine * sine))
            }
            Kind::Triangle | Kind::Quad => {
                let edges = [e.e1, e.e2];
                let (lengths, height) = (Vec2::new(e.e1.length(), e.e2.length()), to.dot(e.normal));
                let foot = -coordinates(to, edges, e.normal);
                let within = foot.clamp(Vec2::ZERO, Vec2::ONE);
                let distance2 = (to + within.x * e.e1 + within.y * e.e2).length_squared();
                let top = to.dot(n) + e.e1.dot(n).max(0.0) + e.e2.dot(n).max(0.0);
                let skew = (e.e1 / lengths.x).cross(e.e2 / lengths.y).length().max(1e-6);
                let radius = Vec2::splat((reach * reach - height * height).max(0.0).sqrt() / skew);
                let (low, high) = ((-foot * lengths).max(-radius), ((1.0 - foot) * lengths).min(radius));
                let faces = height < 0.0 || e.two_sided;
                let reached = faces && top > 0.0 && distance2 < reach * reach && low.cmplt(high).all();
                let part = if e.kind == Kind::Triangle {
                    Part::Triangle(to, edges, e.normal)
                } else {
                    let above = height.abs().max(HEIGHT * lengths.max_element());
                    let foot = to + foot.x * e.e1 + foot.y * e.e2;
                    Part::Parallelogram(foot, [e.e1 / lengths.x, e.e2 / lengths.y], e.normal, above, [low, high])
                };
                reached.then_some((part, brightness * e.area / (distance2 + e.area)))
            }
            _ => None,
        }
    }

    /// The direction to a point of it; `u` and `v` in [0, 1).
    pub fn direction(&self, u: f32, v: f32) -> Vec3 {
        match *self {
            Part::Cone(axis, cap) => {
                let (down, (sine, cosine)) = (u * cap, (TAU * v).sin_cos());
                let (t, b) = basis(axis);
                let across = (down * (2.0 - down)).max(0.0).sqrt();
                across * (cosine * t + sine * b) + (1.0 - down) * axis
            }
            Part::Triangle(corner, [a, b], _) => {
                let root = (1.0 - u).sqrt();
                (corner + root * (1.0 - v) * a + root * v * b).normalize()
            }
            Part::Parallelogram(foot, [a, b], _, height, [low, high]) => {
                let at = |k: usize, u: f32| {
                    let [begin, end] = [low[k], high[k]].map(|x| (x / height).atan());
                    (height * (begin + u * (end - begin)).tan()).clamp(low[k], high[k])
                };
                (foot + at(0, u) * a + at(1, v) * b).normalize()
            }
        }
    }

    /// Its density by solid angle.
    pub fn density(&self, wi: Vec3) -> f32 {
        let (origin, edges, normal) = match *self {
            Part::Cone(axis, cap) => return if wi.dot(axis) >= 1.0 - cap { 1.0 / (TAU * cap) } else { 0.0 },
            Part::Triangle(origin, edges, normal) | Part::Parallelogram(origin, edges, normal, ..) => {
                (origin, edges, normal)
            }
        };
        let cosine = wi.dot(normal);
        let t = origin.dot(normal) / cosine;
        let at = coordinates(t * wi - origin, edges, normal);
        let skew = edges[0].cross(edges[1]).length();
        let (inside, by_area) = match *self {
            Part::Parallelogram(_, _, _, height, [low, high]) => {
                let density = |k: usize| {
                    let range = (high[k] / height).atan() - (low[k] / height).atan();
                    height / (height * height + at[k] * at[k]) / range
                };
                (at.cmpge(low).all() && at.cmple(high).all(), density(0) * density(1) / skew)
            }
            _ => (at.min_element() >= 0.0 && at.x + at.y <= 1.0, 2.0 / skew),
        };
        if t > 0.0 && t.is_finite() && inside { by_area * t * t / cosine.abs() } else { 0.0 }
    }
}

/// Oracle: the emitters that a point with normal `n` can aim at, with their weights.
pub fn parts(emitters: &[Emitter], point: Vec3, n: Vec3, reach: f32) -> Vec<(Part, f32)> {
    let few = if emitters.len() <= EMITTERS { emitters } else { &[] };
    few.iter().filter_map(|e| Part::of(e, point, n, reach)).collect()
}

/// Oracle: density of the aimed rays by solid angle.
pub fn density(parts: &[(Part, f32)], wi: Vec3) -> f32 {
    let total: f32 = parts.iter().map(|(_, weight)| weight).sum();
    parts.iter().map(|(part, weight)| weight / total * part.density(wi)).sum()
}

/// Oracle: of an emitter that both a ray along the lobe, of density `along_lobe`, and one aimed at it find, the share of the one, and over the
/// density of the other, which is sent with probability `chance`, its share.
pub fn shared_by(along_lobe: f32, aimed: f32, chance: f32) -> (f32, f32) {
    let sum = along_lobe + chance * aimed;
    (along_lobe / sum, if aimed > 0.0 { chance / sum } else { 0.0 })
}

/// Oracle: [`shared_by`] of rays along a diffuse lobe of the probability `diffuse`, of which the part `sent` is sent.
pub fn gather_weights(diffuse: f32, sent: f32, cosine: f32, aimed: f32) -> (f32, f32) {
    shared_by(diffuse * sent * cosine.max(0.0) * FRAC_1_PI, aimed, 1.0)
}

/// Oracle: [`gather_weights`] of the near rays of a slot with these flags, whose diffuse lobe has the probability `diffuse`.
pub fn near_weights(
    frame: &FrameParameters,
    (slot, flags): (u32, u32),
    diffuse: f32,
    cosine: f32,
    aimed: f32,
) -> (f32, f32) {
    gather_weights(diffuse, 1.0 / near_points::ray_weight(frame, slot, flags), cosine, aimed)
}

/// Oracle: [`shared_by`] of near rays that go on.
pub fn onward_weights(cosine: f32, aimed: f32) -> (f32, f32) {
    shared_by(near_points::ONWARD * cosine.max(0.0) * FRAC_1_PI, aimed, 1.0 - near_points::ONWARD)
}

/// Oracle: sample point of the aimed ray of a slot of a class.
pub fn point(frame: &FrameParameters, slot: u32, class: u32) -> [f32; 2] {
    gather::near_sequence(frame, (slot, class), frame.size[3] * frame.pattern[2] + class, AIM)
}

/// Oracle: sample point of the aimed ray from the hit of a slot's near ray.
pub fn point_at_hit(frame: &FrameParameters, slot: u32) -> [f32; 2] {
    [2, 3].map(|k| random_f32(key(frame.keys[0], AIM, frame.sample_of(slot), k)))
}

/// Oracle: the direction of an aimed ray by a sample point.
pub fn direction(parts: &[(Part, f32)], [u, v]: [f32; 2]) -> Option<Vec3> {
    let &(mut chosen, mut total) = parts.first()?;
    // One number chooses among the emitters, and is stretched each time.
    let mut along = u;
    for &(part, weight) in &parts[1..] {
        let at = along * (total + weight);
        along = if at >= total { (at - total) / weight } else { at / total };
        chosen = if at >= total { part } else { chosen };
        total += weight;
    }
    Some(chosen.direction(along.min(ONE_MINUS_EPSILON), v))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn emitter(kind: Kind, edges: [Vec3; 2]) -> Emitter {
        let across = edges[0].cross(edges[1]);
        let area = across.length() * if kind == Kind::Triangle { 0.5 } else { 1.0 };
        Emitter {
            kind,
            p0: Vec3::new(-0.4, -0.3, 0.5),
            e1: edges[0],
            e2: edges[1],
            normal: -across.normalize(),
            radiance: Vec3::ONE,
            area,
            two_sided: false,
            inward: false,
            power: Vec3::ONE,
            probability: 1.0,
            exponent: 1.0,
            pattern: None,
        }
    }

    /// The mean of 1 over the density of the directions is the solid angle, and that of cos over it the form factor times pi. By Lambert's formula.
    #[test]
    fn densities_are_those_of_the_directions() {
        let rectangle = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 0.8, 0.0)];
        let skewed = [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.4, 0.8, 0.1)];
        for (kind, edges) in [(Kind::Quad, rectangle), (Kind::Quad, skewed), (Kind::Triangle, skewed)] {
            let e = emitter(kind, edges);
            let n = Vec3::Z;
            let (part, _) = Part::of(&e, Vec3::ZERO, n, 1e3).expect("it is above the horizon and faces the point");
            let count = 256;
            let mut sum = 0.0;
            for i in 0..count * count {
                let [u, v] = [i % count, i / count].map(|k| (k as f32 + 0.5) / count as f32);
                let wi = part.direction(u, v);
                sum += f64::from(wi.dot(n) / part.density(wi));
            }
            let mean = sum / f64::from(count * count);
            let corners = match kind {
                Kind::Triangle => vec![e.p0, e.p0 + e.e1, e.p0 + e.e2],
                _ => vec![e.p0, e.p0 + e.e1, e.p0 + e.e1 + e.e2, e.p0 + e.e2],
            };
            let next = |i: usize| corners[(i + 1) % corners.len()];
            let edge =
                |(i, a): (usize, &Vec3)| f64::from(a.angle_between(next(i)) * a.cross(next(i)).normalize().dot(n));
            let expected = 0.5 * corners.iter().enumerate().map(edge).sum::<f64>().abs();
            assert!((mean / expected - 1.0).abs() < 2e-3, "{kind:?}: {mean} for {expected}");
        }
    }

    #[test]
    fn a_sphere_fills_its_cone() {
        let mut e = emitter(Kind::Sphere, [Vec3::X, Vec3::Y]);
        (e.p0, e.e1) = (Vec3::new(0.3, 0.0, 1.2), Vec3::new(0.4, 0.0, 0.0));
        let (part, _) = Part::of(&e, Vec3::ZERO, Vec3::Z, 2.0).expect("it is within reach");
        let (sine2, axis) = (0.16 / e.p0.length_squared(), e.p0.normalize());
        let solid_angle = TAU * (1.0 - (1.0 - sine2).sqrt());
        for i in 0..100 {
            let wi = part.direction(i as f32 / 100.0, (i * 37 % 100) as f32 / 100.0);
            assert!(wi.dot(axis) >= (1.0 - sine2).sqrt() - 1e-6);
            assert!((part.density(wi) * solid_angle - 1.0).abs() < 1e-4);
        }
        assert!(Part::of(&e, Vec3::ZERO, Vec3::Z, 0.8).is_none(), "it begins farther away");
        assert!(Part::of(&e, Vec3::ZERO, -Vec3::Z, 2.0).is_none(), "it is below the horizon");
    }
}
