//! Chooses, for each region of the image, the lights of a large pool that its clusters weigh one by one
//! ([`light_lists`](super::light_lists)).
//!
//! A region is 4 x 4 blocks of clusters ([`REGION`]), of one class and component. Its representatives are a shading point of each of its
//! clusters, 16 at most. Of the pool's lights l it takes M = [`CHOSEN`], one after the other as `light_lists` does, with
//!
//! ```text
//! p_l = (1 - s) / R sum_r c_rl / sum_k c_rk + s b_l / sum_k b_k
//! ```
//!
//! where r runs over the R representatives that any light reaches, c is that of `light_lists`, b_l = P_l / max(v d^2, clip^2) with the light's power P_l and its distance d from the nearest
//! representative, v = [`NEARER`], and s = [`BY_BOUND`]. So each representative counts
//! alike: lights near a dark place are there when its clusters choose, however bright others are. A light that is taken has its power over M
//! p_l, times the number of choices that took it; the mean over the choices is the sum over the pool.
//!
//! Walks are cheap beside shadow rays, and a cluster that weighed a whole pool of thousands would cost more than its rays.
//!
//! Cost: for each region and class, and each light of the pool, 64 bytes and 1,700 operations. Memory: 32 bytes for each light that a
//! region takes.

use glam::Vec3;

use super::clusters;
use super::layout::{FrameParameters, PointLight};
use super::light_lists::{bound, contribution};
use super::{BoundKernel, Kit};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::plan::Plan;
use crate::sampling::dimensions::LISTS;
use crate::sampling::random::{hash, key};
use crate::stage::Eye;

pub use super::light_lists::BY_BOUND;

/// Width and height of a region, in blocks of clusters.
pub const REGION: u32 = 4;
/// A point of the region may be nearer to a light than its representatives are: part of the squared distance that counts.
pub const NEARER: f32 = 0.25;
/// Lights that a region takes. More: less noise, and more that each cluster weighs.
pub const CHOSEN: u32 = 256;

/// Invocations of a workgroup: few, since an image has few regions and each takes long.
const GROUP: u32 = 16;

/// The pass.
pub struct LightRegions {
    /// Of each light of each region: position and power; normal, bits of its number in the pool.
    pub lights: Buffer,
    kernel: BoundKernel,
    groups: u32,
}

/// Regions of an image, times classes.
pub fn count([width, height]: [u32; 2], [across, down]: [u32; 2]) -> u32 {
    width.div_ceil(8 * across * REGION) * height.div_ceil(8 * down * REGION) * across * down
}

/// Bytes of the lights of all regions of an image of this size.
pub fn bytes(plan: &Plan, size: [u32; 2]) -> u64 {
    let regions = count(size, plan.settings.pattern) * plan.eye.slots_of_pixel;
    32 * u64::from(CHOSEN) * u64::from(regions)
}

impl LightRegions {
    /// Chooses among `candidates` for the points of `eye`, which are in the clusters whose places these are.
    pub fn new(kit: &Kit, plan: &Plan, eye: &Eye, places: &Buffer, candidates: &Buffer) -> Result<LightRegions> {
        let regions = count(plan.lit_size(), plan.settings.pattern) * plan.eye.slots_of_pixel;
        let lights = kit.vec4s("lights of regions", 2 * CHOSEN * regions)?;
        let own = Resources::of([("region_lights", &lights), ("places", places), ("candidates", candidates)]);
        let (shader, groups) = match kit.context.info().is_wide() {
            false => (&shaders::LIGHT_REGIONS, regions.div_ceil(GROUP)),
            true => (&shaders::LIGHT_REGIONS_WIDE, regions),
        };
        let kernel = kit.bind(shader, &[&own, &eye.points.resources()])?;
        Ok(LightRegions { lights, kernel, groups })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], u64::from(self.groups))
    }
}

/// Oracle: number of the region and class of a cluster of this number.
pub fn region_of(frame: &FrameParameters, number: u32) -> u32 {
    let [width, height, ..] = frame.size;
    let [across, down, classes, _] = frame.pattern;
    let of_component = clusters::count([width, height], [across, down]);
    let (component, in_component) = (number / of_component, number % of_component);
    let (block, class) = (in_component / classes, in_component % classes);
    let (blocks, regions) = (width.div_ceil(8 * across), width.div_ceil(8 * across * REGION));
    let region = block / blocks / REGION * regions + block % blocks / REGION;
    component * count([width, height], [across, down]) + region * classes + class
}

/// Oracle: the first place, among the 64 of a cluster of this number, of the search for its representative.
pub fn representative(frame: &FrameParameters, number: u32) -> u32 {
    let [width, height, ..] = frame.size;
    let [across, down, classes, _] = frame.pattern;
    let block = number % clusters::count([width, height], [across, down]) / classes;
    let blocks = width.div_ceil(8 * across);
    let corner = [block % blocks * 8 * across + frame.within[0], block / blocks * 8 * down + frame.within[1]];
    hash(key(frame.keys[0], LISTS, corner[0] + corner[1] * frame.within[2], 3)) & 63
}

/// Oracle: the probability p_l of each light of a pool.
pub fn probabilities(frame: &FrameParameters, pool: &[PointLight], points: &[(Vec3, Vec3)]) -> Vec<f64> {
    let nearest = |light: &PointLight| {
        let distances = points.iter().map(|(x, _)| x.distance_squared(Vec3::from_slice(&light.position[..3])));
        distances.fold(f32::INFINITY, f32::min)
    };
    let bounds: Vec<f64> = pool.iter().map(|light| f64::from(bound(frame, light, NEARER * nearest(light)))).collect();
    let whole = bounds.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let of_point = |&point: &(Vec3, Vec3)| {
        let each: Vec<f64> = pool.iter().map(|light| f64::from(contribution(frame, light, point))).collect();
        let sum: f64 = each.iter().sum();
        (sum > 0.0).then(|| each.into_iter().map(move |c| c / sum).collect::<Vec<f64>>())
    };
    let shares: Vec<Vec<f64>> = points.iter().filter_map(of_point).collect();
    let by_bound = if shares.is_empty() { 1.0 } else { f64::from(BY_BOUND) };
    let mean = |l: usize| shares.iter().map(|of_point| of_point[l]).sum::<f64>() / shares.len().max(1) as f64;
    (0..pool.len()).map(|l| (1.0 - by_bound) * mean(l) + by_bound * bounds[l] / whole).collect()
}
