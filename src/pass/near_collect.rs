//! Near light of the pixels, from pixel to pixel, and its addition to their other light.
//!
//! With E_0 the clipped irradiance of a pixel, the near ray from pixel p to pixel q, throughput B and reflectance rho at
//! q, the irradiance is
//!
//! ```text
//! E(p) = E_0(p) + B(p) (L_e + rho / pi E(q))
//! ```
//!
//! where E(q) is known up to its own near light, which the near ray of q estimates: a path from pixel to pixel. It is
//! followed for [`LINKS`] near rays. Hits that no pixel shows end it: they were lit by lights clipped at half the clip distance, since
//! they have no near light of their own, or a second near ray went on from them (`near_points`). At a quarter of it a single light beside such a hit outshone whole first frames; half of
//! it leaves out 0.1 to 0.7 % of a room's light, which the rays that go on bring back.
//!
//! A path through n near rays must not be longer than `max_depth`, but a pixel holds the sum over all path lengths. The
//! share of indirect light that is allowed is taken from the mean reflectivity rho of the scene, [`shares`].
//!
//! Bias: light after more than [`LINKS`] near rays in a row, and what is left of near light at hits that no pixel shows,
//! is left out.
//!
//! Only half of the classes of pixels have near rays in a pass, beside second components; their light counts for all, so the
//! first ray of a path that starts from a pixel is weighted by the inverse of that share, and later ones, which start from pixels
//! of the same class, are not. A filter whose window
//! has a pixel of each class spreads it evenly. Third components keep theirs, for the light of these joins that of second ones before any filter. With a filter, the near light of [`NEAR_SPREAD`](super::near_points::NEAR_SPREAD)
//! squared neighbours of a class, whose rays have different directions, is averaged first, in the symmetrical way of
//! `discontinuity`, where they lie on one smooth surface ([`SMOOTH`], [`SLOPE`]).
//!
//! And each pixel then takes the mean of the near light of all pixels around it, in a window as wide as the pattern, in place of its own,
//! weighted by the cosine between the normals and less where the chord leaves the tangent plane ([`STEEP`]); the pixels without near rays
//! count as zero. Otherwise thin and curved things, over which the filter does not average, are dotted: four of nine pixels would be
//! twice too bright, and five too dark. Both means blur, and fade with the passes: the one over the window like the filter
//! ([`Filter::weight`](crate::settings::Filter::weight)), the one over a class, which reaches three times as far, sooner ([`weight`]).
//!
//! Cost: 9 vec4 for a near ray and 6 for each further one, some 60 operations each; for the addition 8 vec4, and 5 with 50
//! operations for each neighbour; for the mean over the window 5 vec4 for each of its pixels, and 8 vec4 for each pixel.

use glam::Vec3;

use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, Lighting, List, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::plan::Plan;

/// Maximum number of near rays in a row.
pub const LINKS: usize = 3;

/// Passes with the whole mean over neighbours of a class. More: less noise in the first dozens of passes; fewer: less blur in corners after them.
pub const FULL_PASSES: u32 = 8;

/// Weight of the mean over neighbours of a class in pass number `pass` (from 0).
pub fn weight(pass: u32) -> f32 {
    FULL_PASSES as f32 / (pass + 1).max(FULL_PASSES) as f32
}

/// Minimum cosine of the angle between the normals of neighbours whose near light is averaged.
pub const SMOOTH: f32 = 0.9;
/// Maximum slope of the chord between them against their tangent planes, beyond the turn of the normal.
pub const SLOPE: f32 = 0.1;

/// Slope of the chord between neighbours against the tangent plane at which their near light counts half.
pub const STEEP: f32 = 0.25;

/// The pass over one list.
pub struct NearCollect {
    sum: BoundKernel,
    add: BoundKernel,
    /// With a filter, over all pixels.
    spread: Option<(BoundKernel, Buffer)>,
    work: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// All points of pixels.
    pub all: &'a List,
    /// Points that near rays start from.
    pub list: &'a List,
    /// Hits of the near rays.
    pub points: &'a ShadingPoints,
    /// Light at hits that no pixel shows; overwritten.
    pub lighting: &'a Lighting,
    /// Throughput of the near rays; w: the lobe.
    pub beta: &'a Buffer,
    /// Pixels that show the hits.
    pub near_slot: &'a Buffer,
    /// Light of the pixels.
    pub pixels: &'a Lighting,
    /// Direct light of the pixels that is kept apart, [`super::soft_shadow::SoftShadow::direct`].
    pub soft_direct: Option<&'a Buffer>,
    /// The points of the pixels.
    pub seen: &'a ShadingPoints,
    /// Receives near light: direct and indirect; w of the first: the lobe.
    pub near: &'a [Buffer; 2],
}

impl NearCollect {
    /// Writes `near` and adds it to `pixels`.
    pub fn new(kit: &Kit, plan: &Plan, inputs: &Inputs) -> Result<Self> {
        let Inputs { all, list, points, lighting, beta, near_slot, pixels, soft_direct, seen, near } = *inputs;
        let shares = kit.stage("near shares", &shares(plan.settings.max_depth, plan.scene.extent.reflectivity))?;
        let own = Resources::of([
            ("beta", beta),
            ("near_slot", near_slot),
            ("shares", &shares),
            ("pixel_direct", &pixels.direct),
            ("pixel_indirect", &pixels.indirect),
            ("near_direct", &near[0]),
            ("near_indirect", &near[1]),
            ("seen_position", &seen.position),
            ("seen_geometric", &seen.geometric),
            ("seen_wo", &seen.wo),
        ]);
        let sets = [&points.resources(), &list.resources(), &lighting.resources(), &own];
        // Light at the hits has been summed by then.
        let means = Resources::of([("mean_direct", &lighting.direct), ("mean_indirect", &lighting.indirect)]);
        let add = match plan.settings.filter {
            None => kit.bind(&shaders::NEAR_ADD, &[&list.resources(), &pixels.resources(), &own])?,
            Some(_) => kit.bind(&shaders::NEAR_MEAN, &[&list.resources(), &pixels.resources(), &means, &own])?,
        };
        let spread = match plan.settings.filter {
            None => None,
            Some(_) => {
                let kernel = kit.bind(&shaders::NEAR_SPREAD, &[&all.resources(), &pixels.resources(), &means, &own])?;
                Some((kernel, all.work.clone()))
            }
        };
        let sum = match soft_direct {
            None => kit.bind(&shaders::NEAR_COLLECT, &sets)?,
            Some(soft) => {
                let apart = Resources::of([("soft_direct", soft)]);
                kit.bind(&shaders::NEAR_COLLECT_SOFT, &[&sets[..], &[&apart]].concat())?
            }
        };
        Ok(NearCollect { sum, add, spread, work: list.work.clone() })
    }

    /// Whether near light is spread over pixels of all classes.
    pub(crate) fn spreads(&self) -> bool {
        self.spread.is_some()
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_means(rec)?;
        self.record_spread(rec)
    }

    /// Records the part up to the means over neighbours of a class.
    pub(crate) fn record_means(&self, rec: &mut Recorder) -> Result<()> {
        self.sum.run_listed(rec, &[], &self.work, LIST_GROUPS)?;
        self.add.run_listed(rec, &[], &self.work, LIST_GROUPS)
    }

    /// Records the part in which they spread over the pixels of all classes, if they do.
    pub(crate) fn record_spread(&self, rec: &mut Recorder) -> Result<()> {
        match &self.spread {
            Some((spread, work)) => spread.run_listed(rec, &[], work, LIST_GROUPS),
            None => Ok(()),
        }
    }
}

/// For 1, 2, 3 near rays: the shares of direct light, indirect light and emission that paths of at most `max_depth`
/// segments have, and the share of indirect light at points that were lit by no more reflections than the first near
/// ray allows. `rho`: mean reflectivity.
pub fn shares(max_depth: u32, rho: f32) -> [[f32; 4]; LINKS] {
    // Light of 1 to n reflections.
    let series = |n: i32| (1..=n).map(|j| f64::from(rho).powi(j)).sum::<f64>();
    let depth = max_depth as i32;
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole) as f32 } else { 0.0 };
    let allowed = |segments: i32| if segments <= depth { 1.0 } else { 0.0 };
    // The eye's segment, near rays, and the segments from a light of j reflections.
    std::array::from_fn(|k| {
        let rays = k as i32 + 1;
        let left = series(depth - 2 - rays);
        [allowed(2 + rays), share(left, series(depth - 2)), allowed(1 + rays), share(left, series(depth - 3))]
    })
}

/// The near ray of a pixel, for the oracle.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// Throughput.
    pub beta: Vec3,
    /// Number of slots that the ray stands for.
    pub weight: f32,
    /// Near rays that it stands for: 2 if it went on from a hit that no pixel shows.
    pub rays: usize,
    /// There is one in this pass.
    pub has_ray: bool,
    /// It left through the specular lobe.
    pub specular: bool,
    /// Emission at its hit, times throughput.
    pub emitted: Vec3,
    /// The pixel that shows its hit.
    pub shown: Option<usize>,
    /// Albedo of its hit, and direct irradiance, indirect irradiance and specular radiance there; zero if it is not lit.
    pub hit: (Vec3, [Vec3; 3]),
    /// Clipped direct and indirect irradiance of the pixel that the ray starts from.
    pub clipped: [Vec3; 2],
}

/// Oracle: near light of pixel `start`, direct (or, through its specular lobe, all) and indirect.
pub fn reference(links: &[Link], start: usize, shares: &[[f32; 4]; LINKS]) -> [Vec3; 2] {
    let mut sums = [Vec3::ZERO; 2];
    let (mut at, mut through) = (start, Vec3::ONE);
    let mut rays = 0;
    while rays < LINKS {
        let link = &links[at];
        rays += link.rays;
        let share = shares.get(rays - 1).unwrap_or(&[0.0; 4]);
        sums[usize::from(rays > 1)] += share[2] * through * link.emitted;
        through *= link.beta;
        let Some(q) = link.shown else {
            let (kd, [direct, indirect, specular]) = link.hit;
            let irradiance = share[0] * direct + share[3] * indirect;
            sums[1] += through * (kd * std::f32::consts::FRAC_1_PI * irradiance + share[3] * specular);
            break;
        };
        sums[1] += through * (share[0] * links[q].clipped[0] + share[1] * links[q].clipped[1]);
        if links[q].specular || !links[q].has_ray {
            break;
        }
        // It stands for other pixels once.
        through /= link.weight;
        at = q;
    }
    sums
}

/// Oracle: whether near light of two points of a class, with their normals, is averaged.
pub fn smooth_between(a: (Vec3, Vec3), b: (Vec3, Vec3)) -> bool {
    let chord = b.0 - a.0;
    let turn = (2.0 - 2.0 * a.1.dot(b.1)).max(0.0);
    let rise = chord.dot(a.1 + b.1);
    a.1.dot(b.1) >= SMOOTH && rise * rise <= chord.length_squared() * (turn + SLOPE * SLOPE)
}

/// Oracle: slots of the neighbours of the same class with whose near light that of a slot is averaged, itself included.
pub fn neighbours(frame: &FrameParameters, slot: u32) -> Vec<u32> {
    let ([width, height, pixels, _], [across, down, ..]) = (frame.size.map(i64::from), frame.pattern.map(i64::from));
    let reach = if i64::from(slot) < pixels { i64::from(frame.mirrors[3] / 2) } else { 0 };
    let pixel = i64::from(slot) % pixels;
    let offsets = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
    let places = offsets.map(|(x, y)| (pixel % width + x * across, pixel / width + y * down));
    let inside = places.filter(|(x, y)| (0..width).contains(x) && (0..height).contains(y));
    inside.map(|(x, y)| (i64::from(slot) - pixel + y * width + x) as u32).collect()
}

/// Oracle: weight of the near light of another pixel, with its normal.
pub fn alike(at: (Vec3, Vec3), other: (Vec3, Vec3)) -> f32 {
    let chord = other.0 - at.0;
    let slope = chord.dot(at.1).powi(2) / chord.length_squared().max(1e-30);
    at.1.dot(other.1).max(0.0) / (1.0 + slope / (STEEP * STEEP))
}

/// Oracle: near light that a pixel takes: direct, indirect and specular. `own`: what it has, or zero; `others`: weight and near light of
/// the lit pixels in its window, itself included.
pub fn spread(frame: &FrameParameters, own: [Vec3; 3], others: &[(f32, [Vec3; 3])]) -> [Vec3; 3] {
    let weights: f32 = others.iter().map(|(weight, _)| weight).sum();
    std::array::from_fn(|k| {
        let sum: Vec3 = others.iter().map(|(weight, light)| *weight * light[k]).sum();
        (1.0 - frame.lens[2]) * own[k] + frame.lens[2] * sum / weights.max(1e-30)
    })
}

/// Oracle: pixels in the window around one.
pub fn window(frame: &FrameParameters, slot: u32) -> Vec<u32> {
    let ([width, height, ..], [across, down, ..]) = (frame.size.map(i64::from), frame.pattern.map(i64::from));
    let (x, y) = (i64::from(slot) % width, i64::from(slot) / width);
    let places = (-down / 2..=down / 2).flat_map(|dy| (-across / 2..=across / 2).map(move |dx| (x + dx, y + dy)));
    let inside = places.filter(|(x, y)| (0..width).contains(x) && (0..height).contains(y));
    inside.map(|(x, y)| (y * width + x) as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_stop_at_the_maximum_path_length() {
        // Depth 5: lights of 0 to 3 reflections light pixels; after a near ray 0 to 2, then 0 to 1, then 0.
        let expected = [[1.0, 0.75 / 0.875, 1.0, 1.0], [1.0, 0.5 / 0.875, 1.0, 0.5 / 0.75], [1.0, 0.0, 1.0, 0.0]];
        assert_eq!(shares(5, 0.5), expected);
        // Depth 2: only emitters that near rays meet.
        assert_eq!(shares(2, 0.5)[0], [0.0, 0.0, 1.0, 0.0]);
        assert_eq!(shares(2, 0.5)[1], [0.0; 4]);
        assert_eq!(shares(5, 0.0)[0], [1.0, 0.0, 1.0, 0.0]);
    }
}
