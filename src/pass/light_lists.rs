//! Chooses the lights that light each cluster of shading points, from a pool of more lights than could light them all (after
//! Georgiev and Slusallek 2010).
//!
//! Shadow rays cost far more than particles, so a pass traces more particles than it can afford lights
//! ([`crate::settings::Settings::light_pool`]). Of the lights l after reflections of a cluster's class, the cluster chooses M, as many as
//! all particles would leave without a pool. It asks one light after the other (sequential sampling, Bondesson and Thorburn 2008): with
//! u_l a number of the light, class and pass, and m the choices that are left,
//!
//! ```text
//! p_l = (1 - s) sum_r c_rl / sum_r,k c_rk + s b_l / sum_k b_k
//! n_l = floor(m p_l / (p_l + p_(l+1) + ...) + u_l)        times that light l is chosen; then m is less by n_l
//! ```
//!
//! c_rl is the irradiance of light l at the cluster's representative r, without shadows and lobes, clipped as in `shade`, with cosines
//! that are a little too large ([`SOFT`]); b_l = P_l / max(d^2, clip^2), with the light's power P_l and its distance d from the box around the cluster's
//! points, bounds what it can send to any of them; and s = [`BY_BOUND`] is the share of lights chosen by that alone. So the light of weight
//! n_l / (M p_l) has at most 1 / (M s) of the sum of all bounds at any point, but for its lobe. Of a larger pool than [`light_regions::CHOSEN`] only those are weighed that its region
//! of the image took ([`light_regions`]), with the power that they have there. The mean over u is the sum over all lights of the pool, whatever the
//! representatives are: in the mean each light is chosen M p_l times. Lights on emitters and those without area, which are
//! few, are taken over as they are.
//!
//! u_l is a random number of the light and pass, and advances by 1 / K from one of the K classes of pixels to the next.
//! All clusters of a class have the same u_l and weigh the same lights, so
//! that neighbours choose nearly the same: with numbers of their own they would show as squares. Faint ones remain in single passes.
//! A light that changes, because something moves, changes the choice of few others; systematic sampling, which lays the lights on one
//! line, would choose anew behind it.
//!
//! Points that gather rays hit form no clusters of the screen; where points form none, or the lists of all clusters exceed the largest buffer that kernels may bind, each
//! class chooses by power alone.
//!
//! On a graphics card ([`crate::gpu::DeviceInfo::is_wide`]) a workgroup takes a cluster: its invocations weigh the lights side by side, and
//! one of them chooses, light after light.
//!
//! Differs from the paper in that: it chooses for parts of the image instead of the whole, and without visibility.
//! Cost: for each cluster 64 bytes and 20 + 50 R operations for each light that it weighs, R = [`REPRESENTATIVES`], 16 bytes for each of its points, and 24 bytes for
//! each light that lights it: for 640x480 pixels a third to a half of the time that shadow rays take. Memory: 16 bytes for each of
//! the latter; 32 for each light of the pool.

use glam::Vec3;

use super::clusters::{self, Clusters};
use super::layout::{FrameParameters, PointLight};
use super::light_regions::{self, LightRegions};
use super::schedule::TOTAL_GROUPS;
use super::{BoundKernel, Kit, groups};
use crate::bsdf::mean;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::plan::Plan;
use crate::sampling::dimensions::LISTS;
use crate::sampling::random::{hash, key};
use crate::sampling::sobol::unit;
use crate::stage::Eye;

/// Share of lights chosen by the bound alone. Higher: smaller weights where representatives see little; lower: less noise elsewhere.
pub const BY_BOUND: f32 = 0.2;
/// Added to the cosines at the representatives and at the light: other points of the cluster may face it more. Higher: smaller weights
/// at silhouettes and on curved surfaces; lower: less noise on planes.
pub const SOFT: f32 = 0.2;
/// Maximum number of lights after reflections in a pool.
pub const MAX_POOL: u32 = 8192;
/// Shading points of a cluster that weigh the lights.
pub const REPRESENTATIVES: u32 = 8;

/// The lights of each shading point, and the pass that chooses them.
pub struct LightLists {
    /// [`PointLight`]s, those of the walk.
    pub lights: Buffer,
    /// Of each cluster (or class) the lights that it takes: number among `lights`, and bits of the factor of what it emits.
    pub listed: Buffer,
    /// The first entry of each slot in `listed`.
    pub first: Buffer,
    chooses: Option<Chooses>,
}

/// How lights are chosen.
struct Chooses {
    /// Collects what the choice needs to know of each light.
    collect: BoundKernel,
    collect_groups: u64,
    regions: Option<LightRegions>,
    choose: BoundKernel,
    choose_groups: u64,
    copy: BoundKernel,
    lists: Lists,
}

/// Lists to fill.
enum Lists {
    /// Those of all classes of pixels.
    Classes(u64),
    /// Those of the listed clusters.
    Clusters(Buffer),
}

impl LightLists {
    /// Lists of `lights` for the points of `eye`.
    pub fn new(kit: &Kit, plan: &Plan, eye: &Eye, lights: &Buffer) -> Result<LightLists> {
        Self::of(kit, plan, (eye, eye.clusters.as_ref()), lights)
    }

    /// Lists of `lights` for all points of a class of pixels, chosen by power.
    pub fn of_classes(kit: &Kit, plan: &Plan, eye: &Eye, lights: &Buffer) -> Result<LightLists> {
        Self::of(kit, plan, (eye, None), lights)
    }

    fn of(kit: &Kit, plan: &Plan, (eye, clusters): (&Eye, Option<&Clusters>), lights: &Buffer) -> Result<LightLists> {
        let (classes, slots) = (plan.settings.classes(), plan.lists.slots());
        let [width, height] = plan.lit_size();
        let [across, down] = plan.settings.pattern;
        // Until clusters choose, a slot has the lights of its class.
        let class = |pixel: u32| pixel % width % across + across * (pixel / width % down);
        let of_pixels = (0..width * height).map(|pixel| class(pixel) * slots);
        let first: Vec<u32> = (0..plan.eye.slots_of_pixel).flat_map(|_| of_pixels.clone()).collect();
        let first = kit.stage("first lights", &first)?;
        if !plan.chooses_lights() {
            // Each class takes all of its lights as they are.
            let all: Vec<[u32; 2]> = (0..classes * slots).map(|light| [light, 1.0f32.to_bits()]).collect();
            let listed = kit.stage("listed lights", &all)?;
            return Ok(LightLists { lights: lights.clone(), listed, first, chooses: None });
        }
        let count = clusters::count([width, height], [across, down]) * plan.eye.slots_of_pixel;
        let list_size = u64::from(slots) * size_of::<[u32; 2]>() as u64;
        let room = kit.context.info().max_storage_buffer_range;
        // A part of an image chooses as the whole does.
        let rate = plan.settings.shading_rate;
        let whole = plan.view.camera().map_or([width, height], |camera| camera.resolution.map(|n| n.div_ceil(rate)));
        let of_whole = clusters::count(whole, [across, down]) * plan.eye.slots_of_pixel;
        let fits = u64::from(of_whole) * list_size <= room && light_regions::bytes(plan, whole) <= room;
        let of_screen = clusters.filter(|_| fits);
        let lists = if of_screen.is_some() { count } else { classes };
        let listed = kit.array("listed lights", lists, list_size)?;
        let of_class = plan.lights.slots() - plan.lights.first_slot(1);
        let pool = of_class * classes;
        let candidates = kit.vec4s("lights to choose from", 2 * pool)?;
        let regions = match of_screen {
            Some(clusters) if of_class > light_regions::CHOSEN => {
                Some(LightRegions::new(kit, plan, eye, &clusters.places, &candidates)?)
            }
            _ => None,
        };
        let chosen = kit.array("chosen lights", lists * (slots - plan.lists.first_slot(1)), 8)?;
        let own = Resources::of([
            ("lights", lights),
            ("candidates", &candidates),
            ("chosen_lights", &chosen),
            ("listed_lights", &listed),
            ("first_light", &first),
        ]);
        let collect = kit.bind(&shaders::LIGHT_LISTS_POOL, &[&own])?;
        let sets = match of_screen {
            None => vec![own],
            Some(clusters) => {
                // Without regions the kernel has no such binding.
                let lights = regions.as_ref().map_or(&candidates, |regions| &regions.lights);
                let numbers = Resources::of([("clusters", &clusters.listed), ("region_lights", lights)]);
                vec![own, numbers, eye.points.resources(), eye.list.resources()]
            }
        };
        let sets: Vec<&Resources> = sets.iter().collect();
        let wide = of_screen.is_some() && kit.context.info().is_wide();
        let (choose, copy, of_lists) = match of_screen {
            None => {
                let of_lists = Lists::Classes(u64::from(classes));
                (&shaders::LIGHT_LISTS_CHOOSE_CLASSES, &shaders::LIGHT_LISTS_CLASSES, of_lists)
            }
            Some(_) => {
                let of_lists = Lists::Clusters(eye.list.work.clone());
                let choose = match (&regions, wide) {
                    (None, false) => &shaders::LIGHT_LISTS_CHOOSE,
                    (None, true) => &shaders::LIGHT_LISTS_CHOOSE_WIDE,
                    (Some(_), false) => &shaders::LIGHT_LISTS_CHOOSE_REGIONS,
                    (Some(_), true) => &shaders::LIGHT_LISTS_CHOOSE_REGIONS_WIDE,
                };
                (choose, &shaders::LIGHT_LISTS, of_lists)
            }
        };
        let chooses = Chooses {
            collect,
            collect_groups: groups(pool),
            regions,
            choose: kit.bind(choose, &sets)?,
            choose_groups: if wide { u64::from(lists) } else { groups(lists) },
            copy: kit.bind(copy, &sets)?,
            lists: of_lists,
        };
        Ok(LightLists { lights: lights.clone(), listed, first, chooses: Some(chooses) })
    }

    /// Lights that regions of the image took of a large pool.
    pub fn region_lights(&self) -> Option<&Buffer> {
        Some(&self.chooses.as_ref()?.regions.as_ref()?.lights)
    }

    /// The buffers by their names in shaders.
    pub fn resources(&self) -> Resources {
        Resources::of([("lights", &self.lights), ("listed_lights", &self.listed), ("first_light", &self.first)])
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        let Some(chooses) = &self.chooses else { return Ok(()) };
        chooses.collect.run(rec, &[], chooses.collect_groups)?;
        chooses.regions.as_ref().map_or(Ok(()), |regions| regions.record(rec))?;
        chooses.choose.run(rec, &[], chooses.choose_groups)?;
        match &chooses.lists {
            Lists::Classes(classes) => chooses.copy.run(rec, &[], *classes),
            Lists::Clusters(work) => chooses.copy.run_listed(rec, &[], work, TOTAL_GROUPS),
        }
    }
}

/// Oracle: the light of an entry of [`LightLists::listed`].
pub fn listed_light(lights: &[PointLight], [number, times]: [u32; 2]) -> PointLight {
    let times = f32::from_bits(times);
    let scaled = |[r, g, b, w]: [f32; 4]| [r * times, g * times, b * times, w];
    let light = lights[number as usize];
    PointLight { emit: scaled(light.emit), flux: scaled(light.flux), ..light }
}

/// Oracle: power of a light, its lobe spread evenly; mean over channels.
pub fn power(light: &PointLight) -> f32 {
    let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
    mean(xyz(light.emit) + xyz(light.flux) * xyz(light.f0) * std::f32::consts::FRAC_1_PI)
}

/// Oracle: irradiance of a light at a point with a normal, without shadows.
pub fn contribution(frame: &FrameParameters, light: &PointLight, (x, n): (Vec3, Vec3)) -> f32 {
    let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
    let d = xyz(light.position) - x;
    let r2 = d.length_squared().max(1e-30);
    let soft = SOFT * r2.sqrt();
    let cosines = (d.dot(n) + soft).max(0.0) * (soft - d.dot(xyz(light.normal))).max(0.0);
    power(light) * cosines / (r2 * r2.max(frame.right[3].max(1e-7)))
}

/// Oracle: number that tells a cluster of this number, in the order of [`super::clusters`], from all others of the whole image.
pub fn seed(frame: &FrameParameters, number: u32) -> u32 {
    let [width, height, ..] = frame.size;
    let [across, down, classes, _] = frame.pattern;
    let of_component = clusters::count([width, height], [across, down]);
    let block = number % of_component / classes;
    let blocks = width.div_ceil(8 * across);
    let corner = [block % blocks * 8 * across + frame.within[0], block / blocks * 8 * down + frame.within[1]];
    corner[0] + (corner[1] + number / of_component * frame.within[3]) * frame.within[2]
}

/// Oracle: places among the 64 of a cluster where the search for its representatives begins.
pub fn representatives(frame: &FrameParameters, seed: u32) -> [u32; REPRESENTATIVES as usize] {
    let turn = hash(key(frame.keys[0], LISTS, seed, 1));
    std::array::from_fn(|r| 8 * r as u32 + ((turn >> (4 * r)) & 7))
}

/// Oracle: the number u of a light of the pool in a class and pass. `consumer`: 0 for clusters, 4 for regions.
pub fn number(frame: &FrameParameters, class: u32, light: u32, consumer: u32) -> f32 {
    let start = hash(hash(key(frame.keys[1], LISTS, frame.size[3], consumer)) ^ light);
    unit(start.wrapping_add(class.wrapping_mul(u32::MAX / frame.pattern[2])))
}

/// Oracle: what a light sends at most to a point at a squared distance, its lobe spread evenly.
pub fn bound(frame: &FrameParameters, light: &PointLight, distance2: f32) -> f32 {
    power(light) / distance2.max(frame.right[3].max(1e-7))
}

/// Oracle: squared distance of a light from the box around some points.
pub fn from_box(light: &PointLight, points: impl Iterator<Item = Vec3>) -> f32 {
    let none = (Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY));
    let (low, high) = points.fold(none, |(low, high), point| (low.min(point), high.max(point)));
    let position = Vec3::from_slice(&light.position[..3]);
    (low - position).max(position - high).max(Vec3::ZERO).length_squared()
}

/// Oracle: the probability p_l of each light, from contributions and bounds (for classes, powers).
pub fn probabilities(contributions: &[f64], bounds: &[f64]) -> Vec<f64> {
    let [all, bound] = [contributions, bounds].map(|of| of.iter().sum::<f64>());
    let by_bound = if all > 0.0 { f64::from(BY_BOUND) } else { 1.0 };
    let share = |part: f64, of: f64| if of > 0.0 { part / of } else { 0.0 };
    let each = contributions.iter().zip(bounds);
    each.map(|(&c, &b)| (1.0 - by_bound) * share(c, all) + by_bound * share(b, bound)).collect()
}

/// Oracle: for each light how often it is chosen, `count` times in all. `numbers`: u of each light.
pub fn chosen(probabilities: &[f64], count: u32, numbers: impl Iterator<Item = f64>) -> Vec<u32> {
    let mut points = count;
    let mut left: f64 = probabilities.iter().sum();
    let mut take = |(p, u): (&f64, f64)| {
        let expected = f64::from(points) * p / left.max(f64::MIN_POSITIVE);
        let taken = ((expected + u) as u32).min(points);
        points -= taken;
        left -= p;
        taken
    };
    probabilities.iter().zip(numbers).map(&mut take).collect()
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn the_mean_over_passes_is_the_sum_over_all_lights() {
        let contributions = [0.0, 3.0, 0.2, 1e-6, 9.0, 0.0, 0.4];
        let powers = [1.0, 0.5, 2.0, 0.1, 0.0, 3.0, 0.7];
        let light = [1.0, 5.0, -2.0, 8.0, 0.25, 3.0, 0.0];
        let p = probabilities(&contributions, &powers);
        assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let frame = FrameParameters { pattern: [1, 1, 1, 0], ..FrameParameters::zeroed() };
        for count in [1, 3, 16] {
            let passes = 400_000;
            let (mut sum, mut squares) = (0.0, 0.0);
            for pass in 0..passes {
                let frame = FrameParameters { size: [0, 0, 0, pass], ..frame };
                let numbers = (0..).map(|l| f64::from(number(&frame, 0, l, 0)));
                let times = chosen(&p, count, numbers);
                assert_eq!(times.iter().sum::<u32>(), count);
                let weighed = times.iter().zip(&light).zip(&p);
                let found = weighed.map(|((&n, l), p)| f64::from(n) * l / (f64::from(count) * p)).sum::<f64>();
                (sum, squares) = (sum + found, squares + found * found);
            }
            let n = f64::from(passes);
            let (found, expected) = (sum / n, light.iter().sum::<f64>());
            let deviation = ((squares / n - found * found) / n).sqrt();
            println!("{count}: {found:.3} +- {deviation:.3} for {expected}");
            assert!((found - expected).abs() < 3.0 * deviation && deviation < 0.02 * expected, "{count}: {found}");
        }
    }

    #[test]
    fn a_light_that_changes_changes_few_choices() {
        let frame = FrameParameters { pattern: [1, 1, 1, 0], ..FrameParameters::zeroed() };
        let numbers = || (0..).map(|l| f64::from(number(&frame, 0, l, 0)));
        let weight = |l: u32| 1.0 + f64::from(hash(l) % 8);
        let choose = |powers: &[f64]| chosen(&probabilities(&vec![0.0; powers.len()], powers), 32, numbers());
        let plain: Vec<f64> = (0..256).map(weight).collect();
        let before = choose(&plain);
        let mut changes = Vec::new();
        for changed in 0..256 {
            let mut powers = plain.clone();
            powers[changed] *= 3.0;
            let after = choose(&powers);
            changes.push(before.iter().zip(&after).map(|(a, b)| a.abs_diff(*b)).sum::<u32>());
        }
        let mean = f64::from(changes.iter().sum::<u32>()) / 256.0;
        println!("choices that differ, of 32: {mean:.2} in the mean, at most {:?}", changes.iter().max());
        assert!(mean < 4.0, "{mean}");
    }

    #[test]
    fn powers_alone_choose_where_no_light_contributes() {
        let p = probabilities(&[0.0, 0.0], &[3.0, 1.0]);
        assert_eq!(p, [0.75, 0.25]);
        assert_eq!(chosen(&p, 4, [0.5; 2].into_iter()), [3, 1]);
        assert_eq!(probabilities(&[0.0], &[0.0]), [0.0], "black lights");
    }
}
