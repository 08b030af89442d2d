//! The choice of lights for clusters of shading points against its oracle, and that it keeps the energy.

use crate::conform::Bench;
use crate::gpu::Buffer;
use crate::pass::layout::PointLight;
use crate::pass::light_lists::{bound, chosen, contribution, from_box, power, probabilities, representatives, seed};
use crate::pass::{light_lists, light_regions};
use crate::settings::{Clip, ClusterOrder, Compensation, Settings, Traversal};
use glam::Vec3;

use super::light::check_shade;
use crate::conform::rig::{Rig, STRAYS, Tally, close, gallery_with_tables, xyz};

pub fn settings(pattern: [u32; 2], traversal: Traversal) -> Settings {
    Settings {
        particles: 6,
        light_pool: 600,
        direct_lights: Some(3),
        pattern,
        compensation: Compensation::Near,
        clip: Clip::Distance(0.5),
        traversal,
        seed: 3,
        ..Settings::plain()
    }
}

/// Light by light, what it emits towards everything.
fn strength(light: &PointLight) -> Vec3 {
    xyz(light.emit) + xyz(light.flux)
}

/// Compares one list with the light that each of its places should hold.
fn check_list(
    tally: &mut Tally,
    what: &str,
    list: &[PointLight],
    pool: &[PointLight],
    p: &[f64],
    times: &[u32],
) -> usize {
    let mut expected: Vec<Option<(usize, u32)>> = vec![None; list.len()];
    let mut place = 0;
    for (i, &n) in times.iter().enumerate().filter(|(_, n)| **n > 0) {
        expected[place] = Some((i, n));
        place += n as usize;
    }
    for (found, expected) in list.iter().zip(&expected) {
        // Other places emit nothing, whatever else is in them.
        let light = expected.map_or(
            PointLight { emit: [0.0, 0.0, 0.0, found.emit[3]], flux: [0.0, 0.0, 0.0, found.flux[3]], ..*found },
            |(i, _)| pool[i],
        );
        let times = expected.map_or(0.0, |(i, n)| f64::from(n) / (list.len() as f64 * p[i])) as f32;
        let same = found.position == light.position
            && close(xyz(found.emit), xyz(light.emit) * times, 1e-3, 0.0)
            && close(xyz(found.flux), xyz(light.flux) * times, 1e-3, 0.0)
            && (found.normal, found.wi, found.f0) == (light.normal, light.wi, light.f0);
        let values = [(strength(found), strength(&light) * times)];
        tally.check_values(same, &values, || format!("{what}: {found:?} for {expected:?}"));
    }
    expected.iter().flatten().count()
}

/// Compares the lights that regions took with their oracle, and returns them, with the power that they have there, and their numbers in
/// the pool.
fn check_regions(rig: &Rig, buffer: &Buffer) -> Vec<Vec<(PointLight, u32)>> {
    const CHOSEN: usize = light_regions::CHOSEN as usize;
    let (frame, p, plan) = (rig.frame(), &rig.parameters, rig.engine.plan());
    let lights: Vec<PointLight> = rig.get(&frame.walk.lights);
    let found = rig.vec4s(buffer);
    let places: Vec<u32> = rig.get(&frame.eye.clusters.as_ref().unwrap().places);
    let [position, shading] = [&frame.eye.points.position, &frame.eye.points.shading].map(|b| rig.vec4s(b));
    let (copied, of_class) = (plan.lights.first_slot(1) as usize, plan.lights.slots() as usize);
    // The points of each region: of each of its clusters the first one from some place on.
    let mut points = vec![Vec::new(); found.len() / (2 * CHOSEN)];
    for (number, places) in (0u32..).zip(places.chunks_exact(64)) {
        let start = light_regions::representative(p, number) as usize;
        let slot = (0..64).map(|k| places[(start + k) % 64]).find(|&slot| slot != crate::pass::clusters::NO_POINT);
        let region = light_regions::region_of(p, number) as usize;
        points[region].extend(slot.map(|slot| (position[slot as usize].truncate(), shading[slot as usize].truncate())));
    }
    let mut tally = Tally::new(format!("lights of regions, {}x{}", p.size[0], p.size[1]));
    let of_region = |(region, points): (usize, &Vec<(Vec3, Vec3)>)| {
        let class = region as u32 % p.pattern[2];
        let pool = &lights[class as usize * of_class..][copied..of_class];
        let probabilities = light_regions::probabilities(p, pool, points);
        let numbers = (0..).map(|l| f64::from(light_lists::number(p, class, l, 4)));
        let times = chosen(&probabilities, CHOSEN as u32, numbers);
        let mut expected: Vec<Option<(usize, f32)>> = vec![None; CHOSEN];
        let mut place = 0;
        for (i, &n) in times.iter().enumerate().filter(|(_, n)| **n > 0) {
            expected[place] = Some((i, (f64::from(n) / (CHOSEN as f64 * probabilities[i])) as f32));
            place += n as usize;
        }
        let of_place = |(place, expected): (usize, &Option<(usize, f32)>)| {
            let at = 2 * (CHOSEN * region + place);
            let (at_light, normal) = (found[at], found[at + 1]);
            let light = pool[normal.w.to_bits() as usize];
            // Its power there, which its own has been multiplied by.
            let times = at_light.w / power(&light).max(f32::MIN_POSITIVE);
            let holds = match expected {
                // No cluster asks a region without points.
                _ if points.is_empty() => true,
                None => at_light.w == 0.0,
                Some((i, expected)) => {
                    let same = normal.w.to_bits() as usize == *i && at_light.truncate() == xyz(light.position);
                    same && normal.truncate() == xyz(light.normal) && (times / expected - 1.0).abs() < 1e-3
                }
            };
            tally.check(holds, || format!("region {region}, place {place}: {at_light} {normal} for {expected:?}"));
            let scaled = |v: [f32; 4]| [v[0] * times, v[1] * times, v[2] * times, v[3]];
            (PointLight { emit: scaled(light.emit), flux: scaled(light.flux), ..light }, normal.w.to_bits())
        };
        expected.iter().enumerate().map(of_place).collect()
    };
    let regions = points.iter().enumerate().map(of_region).collect();
    tally.finish(STRAYS);
    regions
}

/// Compares the lists of all clusters of a rig, and returns how many lights they hold.
fn check_clusters(rig: &Rig) -> usize {
    let (frame, p, plan) = (rig.frame(), &rig.parameters, rig.engine.plan());
    rig.prefill(&[&frame.light_lists.listed]);
    rig.run(|frame, rec| frame.light_lists.record(rec));
    let lights: Vec<PointLight> = rig.get(&frame.walk.lights);
    let listed = rig.listed_lights();
    let first: Vec<u32> = rig.get(&frame.light_lists.first);
    let clusters: Vec<[u32; 2]> = rig.get(&frame.eye.clusters.as_ref().unwrap().listed);
    let entries: Vec<u32> = rig.get(&frame.eye.list.entries);
    let [position, shading] = [&frame.eye.points.position, &frame.eye.points.shading].map(|b| rig.vec4s(b));
    let (slots, copied) = (plan.lists.slots() as usize, plan.lists.first_slot(1) as usize);
    let of_regions = frame.light_lists.region_lights().map(|buffer| check_regions(rig, buffer));
    let mut tally = Tally::new(format!("light lists, {}x{}", p.size[0], p.size[1]));
    let mut held = 0;
    for (k, [class, number]) in clusters.iter().enumerate().take(rig.work(0).total as usize / 64) {
        let places = &entries[64 * k..64 * (k + 1)];
        let present = |place: &&u32| **place != crate::pass::clusters::NO_POINT;
        for &slot in places.iter().filter(present) {
            assert_eq!(first[slot as usize], number * slots as u32, "slot {slot}");
        }
        let of_cluster = seed(p, *number);
        let points = representatives(p, of_cluster).map(|start| {
            let mut turned = (0..64).map(|k| &places[(start as usize + k) % 64]);
            let slot = *turned.find(|place| present(place)).expect("a listed cluster has points") as usize;
            (position[slot].truncate(), shading[slot].truncate())
        });
        let of_class = plan.lights.slots() as usize;
        let pool = &lights[*class as usize * of_class..][..of_class];
        let list = &listed[*number as usize * slots..][..slots];
        assert_eq!(list[..copied], pool[..copied], "lights on emitters");
        let whole = || pool[copied..].iter().copied().zip(0..).collect();
        let region = |of: &Vec<Vec<_>>| of[light_regions::region_of(p, *number) as usize].clone();
        let (pool, numbers): (Vec<PointLight>, Vec<u32>) =
            of_regions.as_ref().map_or_else(whole, region).into_iter().unzip();
        let contributions: Vec<f64> =
            pool.iter().map(|l| points.iter().map(|&point| f64::from(contribution(p, l, point))).sum()).collect();
        let inside = || places.iter().filter(present).map(|&slot| position[slot as usize].truncate());
        let bounds: Vec<f64> = pool.iter().map(|l| f64::from(bound(p, l, from_box(l, inside())))).collect();
        let probabilities = probabilities(&contributions, &bounds);
        let numbers = numbers.iter().map(|&l| f64::from(light_lists::number(p, *class, l, 0)));
        let times = chosen(&probabilities, (slots - copied) as u32, numbers);
        let what = format!("cluster {number}");
        held += check_list(&mut tally, &what, &list[copied..], &pool, &probabilities, &times);
    }
    tally.finish(STRAYS);
    held
}

pub fn clusters_choose_as_their_oracle(bench: &Bench) {
    let scene = gallery_with_tables();
    let (mut held, mut regions) = (0, 0);
    let patterns = [[1, 1], [3, 3], [2, 3], [3, 3], [8, 8]];
    let images = bench.images().chain([[150, 40]]).zip(patterns.into_iter().chain([[1, 2]]));
    // With the smaller pool clusters weigh all of it. Clusters choose for rays that are traced alone as well.
    let cases = [(600, Traversal::Cluster), (90, Traversal::Single)];
    for ((resolution, pattern), (light_pool, traversal)) in images.flat_map(|image| cases.map(|case| (image, case))) {
        let settings = Settings { light_pool, ..settings(pattern, traversal) };
        let rig = bench.rig(&scene, resolution, settings);
        assert!(rig.engine.plan().chooses_lights());
        rig.walk_and_look();
        regions += usize::from(rig.frame().light_lists.region_lights().is_some());
        held += check_clusters(&rig);
        check_shade(&rig, 0);
    }
    bench.covered(held > 1000, format_args!("{held} lights are chosen"));
    bench.covered(regions == 6, format_args!("the larger pool is too large for clusters"));
}

pub fn classes_choose_by_power_where_there_are_no_clusters(bench: &Bench) {
    let scene = gallery_with_tables();
    for (resolution, pattern) in [([1, 1], [1, 1]), ([31, 17], [2, 3])] {
        let by_space = Settings { cluster_order: ClusterOrder::Space, ..settings(pattern, Traversal::Single) };
        let rig = bench.rig(&scene, resolution, by_space);
        let (frame, p, plan) = (rig.frame(), &rig.parameters, rig.engine.plan());
        rig.walk_and_look();
        rig.run(|frame, rec| frame.light_lists.record(rec));
        let lights: Vec<PointLight> = rig.get(&frame.walk.lights);
        let listed = rig.listed_lights();
        let copied = plan.lists.first_slot(1) as usize;
        let mut tally = Tally::new(format!("lists of classes, {resolution:?}"));
        for class in 0..plan.settings.classes() {
            let of =
                |all: &[PointLight], slots: u32| all[(class * slots) as usize..((class + 1) * slots) as usize].to_vec();
            let (pool, list) = (of(&lights, plan.lights.slots()), of(&listed, plan.lists.slots()));
            let pool = &pool[copied..];
            let powers: Vec<f64> = pool.iter().map(|l| f64::from(power(l))).collect();
            let probabilities = probabilities(&vec![0.0; powers.len()], &powers);
            let numbers = (0..).map(|l| f64::from(light_lists::number(p, class, l, 0)));
            let times = chosen(&probabilities, (list.len() - copied) as u32, numbers);
            check_list(&mut tally, &format!("class {class}"), &list[copied..], pool, &probabilities, &times);
        }
        tally.finish(STRAYS);
        check_shade(&rig, 0);
    }
}
