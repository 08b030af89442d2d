//! Shading, gathering, collecting and scheduling against their oracles.

use crate::accel::{Ray, offset_origin};
use crate::bsdf::Reflectance;
use crate::conform::{Bench, Must};
use crate::gpu::{Buffer, Resources, Staging, download, upload};
use crate::pass::collect::{self, Gathered};
use crate::pass::layout::{DispatchCounts, PointLight, Step};
use crate::pass::schedule::{self, Schedule};
use crate::pass::shade::{self, ShadingPoint};
use crate::pass::surface::surface_at;
use crate::pass::{Lighting, ShadingPoints, gather, near_aim};
use crate::sampling::dimensions::AIM;
use crate::settings::{Clip, Sequence, Settings, Traversal};
use crate::stage::Stage;
use glam::{Vec3, Vec4};

use super::aim::{Aimed, parts_of};
use crate::conform::rig::{
    Rig, STRAYS, Tally, close, gallery_with_alpha, gallery_with_few_emitters, gallery_with_tables, has, hit_of, is_lit,
    make, ray_of, sine_error, untouched, xyz,
};

/// Tolerance for a direction of the diffuse lobe: Vulkan permits sines and cosines an error of 2^-11.
const RELATIVE: f32 = 5e-4;

/// Tolerance for a sum of many lights: divisions and roots.
const DIFFUSE: f32 = 1e-4;

/// Tolerance for light over a specular lobe, which magnifies differences of the directions: SwiftShader is 1e-3 off at
/// worst.
pub const LOBE: f32 = 2e-3;

/// The shading points in the form of the oracles.
pub fn receivers(rig: &Rig, r: &ShadingPoints) -> Vec<ShadingPoint> {
    let [position, geometric, shading, kd, f0, wo] =
        [&r.position, &r.geometric, &r.shading, &r.kd, &r.f0, &r.wo].map(|b| rig.vec4s(b));
    (0..position.len())
        .map(|i| ShadingPoint {
            position: position[i].truncate(),
            geometric: geometric[i].truncate(),
            shading: shading[i].truncate(),
            reflectance: Reflectance {
                kd: kd[i].truncate(),
                f0: f0[i].truncate(),
                f90: geometric[i].w,
                alpha: shading[i].w,
            },
            wo: wo[i].truncate(),
            sampled: has(wo[i], ShadingPoints::LOBE_SAMPLED).then_some(rig.parameters.choice[2]),
            splats: has(wo[i], ShadingPoints::SPLATS),
        })
        .collect()
}

fn sums(rig: &Rig, sums: &Lighting) -> [Vec<Vec4>; 3] {
    [&sums.direct, &sums.indirect, &sums.specular].map(|b| rig.vec4s(b))
}

fn at(sums: &[Vec<Vec4>; 3], i: usize) -> [Vec3; 3] {
    [0, 1, 2].map(|k| sums[k][i].truncate())
}

/// Whether lighting is equal; `indirect` is the tolerance of the indirect part.
fn alike(a: [Vec3; 3], b: [Vec3; 3], indirect: f32) -> bool {
    [DIFFUSE, indirect, LOBE].into_iter().enumerate().all(|(k, relative)| close(a[k], b[k], relative, 1e-9))
}

/// Results of the stages of a bounce: points gathered, lit ones among them, those by specular lobes, pixels with
/// light of each of the three kinds, and rays aimed at emitters.
#[derive(Debug, Default)]
struct Seen {
    gathered: usize,
    lit: usize,
    specular: usize,
    sums: [usize; 3],
    aimed: usize,
}

/// Compares rays towards near emitters from the points before a bounce.
fn check_aim(rig: &Rig, bounce: usize) -> usize {
    let (p, frame, compensation) = (&rig.parameters, rig.frame(), rig.compensation());
    let (points, lighting) = match bounce {
        1 => (&frame.eye.points, &frame.shade.lighting),
        _ => (&compensation.points, &compensation.lighting),
    };
    rig.run(|_, rec| {
        if bounce == 1 {
            compensation.record_clear(rec)?;
        }
        compensation.record_aimed_rays(rec, bounce)
    });
    let before = bounce as u32 - 1;
    let aimed = Aimed {
        what: format!("rays aimed at emitters, {}x{}, bounce {bounce}", p.size[0], p.size[1]),
        reach: p.up[3],
        list: &compensation.bounces[bounce - 1].aimed,
        lighting,
        point: &|slot| gather::point(p, slot, before, AIM),
        weight: &|_, point, cosine, by_aim| {
            let diffuse = point.gathering().diffuse_probability();
            let survival = gather::survival(point.reflectance.kd / diffuse.max(1e-6), before);
            near_aim::gather_weights(diffuse, survival, cosine, by_aim).1
        },
        record_light: &|rec| compensation.record_aimed_light(rec, bounce),
    };
    let from = receivers(rig, points);
    aimed.check(rig, &rig.list(before as usize), &from, |i| from[i].reflectance.kd != Vec3::ZERO)
}

/// Compares one short ray for each shading point of the previous bounce, and its hit.
fn check_gather(rig: &Rig, bounce: usize, sine: f32, seen: &mut Seen) {
    let frame = rig.frame();
    let p = &rig.parameters;
    let before = receivers(rig, if bounce == 1 { &frame.eye.points } else { &rig.compensation().points });
    let throughput = &rig.compensation().beta;
    if bounce == 1 {
        // Paths start here: nothing is read.
        rig.prefill(&[throughput]);
    }
    let old = rig.vec4s(throughput);
    rig.prefill(&[&frame.eye.rays.origin, &frame.eye.rays.direction, &frame.eye.rays.hits]);
    rig.run(|_, rec| rig.compensation().record_gather(rec, bounce));
    let r = &rig.compensation().points;
    let rays = [&frame.eye.rays.origin, &frame.eye.rays.direction, &frame.eye.rays.hits].map(|b| rig.vec4s(b));
    let [origin, direction, hits] = &rays;
    let [beta, emitted, position, wo] = [throughput, &r.emitted, &r.position, &r.wo].map(|b| rig.vec4s(b));
    let after = receivers(rig, r);
    let what = format!("{}x{}, bounce {bounce}", p.size[0], p.size[1]);
    let mut tally = Tally::new(format!("gather, {what}"));
    let mut traced = Tally::new(format!("trace of gather rays, {what}"));
    let mut met = Tally::new(format!("receivers of gather rays, {what}"));
    let listed = rig.list(bounce - 1);
    let mut lit = Vec::new();
    for &pixel in &listed {
        let i = pixel as usize;
        let so_far = if bounce == 1 { Vec3::ONE } else { old[i].truncate() };
        let (expected, weight, specular) =
            gather::reference(p, &rig.scene.materials, pixel, bounce as u32 - 1, &before[i], so_far);
        let ray = ray_of(origin[i], direction[i]);
        // A microfacet near the edge of visibility contains the root of a small difference of sines.
        let tolerance = if specular { 2.0 * sine.sqrt() } else { RELATIVE };
        let same = ray.origin == expected.origin
            && ray.t_max == expected.t_max
            && close(ray.direction, expected.direction, 0.0, tolerance);
        let values = [(ray.origin, expected.origin), (ray.direction, expected.direction)];
        tally.check_values(same, &values, || format!("pixel {i}: {ray:?} for {expected:?}"));
        let hit = hit_of(hits[i]);
        traced.check_hit(rig, &ray, hit, || format!("pixel {i}: {hit:?} of {ray:?}"));
        // The fraction of the light that clipping removes.
        let clip = p.up[3];
        let share = hit.map_or(0.0, |h| (1.0 - h.t * h.t / (clip * clip)).max(0.0));
        let weight = weight * share;
        let b = beta[i].truncate();
        let values = [Default::default(), Default::default(), (b, weight)];
        tally.check_values(close(b, weight, tolerance, 1e-6), &values, || {
            format!("pixel {i}: throughput {b} for {weight}")
        });
        let lobe = if bounce == 1 { f32::from(specular) } else { old[i].w };
        tally.check(beta[i].w == lobe, || format!("pixel {i}: lobe {}", beta[i].w));
        let surface = hit.map(|hit| surface_at(rig.scene, rig.bvh(), &hit, ray.direction, p.cones[2] * hit.t));
        // Rays aimed at emitters bring the rest.
        let by_aim = || near_aim::density(&parts_of(rig, &before[i], clip), ray.direction);
        let of_emitters = match specular || ray.t_max == 0.0 {
            true => 1.0,
            false => {
                let diffuse = before[i].gathering().diffuse_probability();
                let survival = gather::survival(before[i].reflectance.kd / diffuse.max(1e-6), bounce as u32 - 1);
                near_aim::gather_weights(diffuse, survival, ray.direction.dot(before[i].shading), by_aim()).0
            }
        };
        let light = surface.map_or(Vec3::ZERO, |s| of_emitters * s.emission);
        let e = emitted[i].truncate();
        let values = [(e, weight * light)];
        met.check_values(
            close(e, weight * light, tolerance.max(if of_emitters < 1.0 { 5e-3 } else { 0.0 }), 1e-6),
            &values,
            || format!("pixel {i}: {e} for {}", weight * light),
        );
        let last = bounce as u32 + 1 == p.scene[2];
        let reflects = surface.is_some_and(|s| s.reflectance.kd + s.reflectance.f0 != Vec3::ZERO);
        let expected = !last && share > 0.0 && reflects;
        met.check(is_lit(wo[i]) == expected, || format!("pixel {i}: lit {}", is_lit(wo[i])));
        met.check(has(wo[i], ShadingPoints::HIT) == surface.is_some(), || format!("pixel {i}: hit"));
        if let Some(s) = surface {
            let place = offset_origin(s.position, s.geometric, p.eye[3]);
            let same = close(after[i].position, place, 1e-5, 1e-6)
                && position[i].w == hits[i].x
                && close(after[i].geometric, s.geometric, 0.0, 1e-4)
                && close(after[i].shading, s.shading, 0.0, 1e-4)
                && close(after[i].reflectance.kd, s.reflectance.kd, 1e-4, 1e-5)
                && close(after[i].reflectance.f0, s.reflectance.f0, 1e-4, 1e-5)
                && after[i].wo == -ray.direction;
            let values = [Default::default(), (after[i].position, place), (after[i].geometric, s.geometric)];
            met.check_values(same, &values, || format!("pixel {i}: {:?} for {s:?}", after[i]));
            met.check(has(wo[i], ShadingPoints::GLOSSY) == (s.reflectance.f90 > 0.0), || format!("pixel {i}: lobe"));
            seen.gathered += 1;
        }
        seen.specular += usize::from(beta[i].w == 1.0);
        if is_lit(wo[i]) {
            lit.push(pixel);
        }
    }
    let others = (0..origin.len()).filter(|&i| listed.binary_search(&(i as u32)).is_err());
    for i in others {
        assert!(untouched(origin[i]) && untouched(direction[i]) && untouched(hits[i]), "{what}: pixel {i} has no ray");
        // Bit for bit: slots without a path may hold any value.
        let bits = |v: Vec4| v.to_array().map(f32::to_bits);
        assert_eq!(bits(beta[i]), bits(old[i]), "{what}: pixel {i}");
    }
    tally.finish(STRAYS);
    traced.finish(STRAYS);
    met.finish(STRAYS);
    assert_eq!(rig.list(bounce), lit, "{what}: the list names the lit points, each once");
    seen.lit += lit.len();
}

pub fn check_shade(rig: &Rig, bounce: usize) {
    let frame = rig.frame();
    let p = &rig.parameters;
    let (targets, out) = match bounce {
        0 => (&frame.eye.points, &frame.shade.lighting),
        _ => (&rig.compensation().points, &rig.compensation().lighting),
    };
    rig.prefill(&[&out.direct, &out.indirect, &out.specular]);
    rig.run(|frame, rec| match bounce {
        0 => frame.shade.record(rec),
        _ => rig.compensation().record_shade(rec, bounce),
    });
    // Eye segment, gather rays, shadow ray and j reflections together do not exceed the maximum path length.
    let plan = &rig.engine.plan().lists;
    let Some(reflections) = p.scene[2].checked_sub(bounce as u32 + 2) else { return };
    let lights = rig.listed_lights();
    let first: Vec<u32> = rig.get(&frame.light_lists.first);
    // Each class of pixels, or each cluster, has its own lights.
    let words = rig.vec4s(&targets.wo);
    let lights_of = |slot: u32| {
        let segments = ShadingPoints::segments(ShadingPoints::flags(words[slot as usize].w));
        let first = first[slot as usize] as usize;
        let all = &lights[first..first + plan.first_slot(reflections as usize + 1) as usize];
        // Mirrors and glass on the particle's path count as well.
        all.iter().copied().filter(|l| l.f0[3] + segments as f32 <= reflections as f32).collect::<Vec<PointLight>>()
    };
    let found = sums(rig, out);
    let receivers = receivers(rig, targets);
    let listed = rig.list(bounce);
    let mut tally = Tally::new(format!("shade, {}x{}, bounce {bounce}", p.size[0], p.size[1]));
    for i in 0..receivers.len() {
        if listed.binary_search(&(i as u32)).is_ok() {
            let expected =
                shade::reference(rig.scene, rig.bvh(), &receivers[i], &lights_of(i as u32), p.right[3], p.forward[3]);
            let found = at(&found, i);
            let values = [0, 1, 2].map(|k| (found[k], expected[k]));
            tally.check_values(alike(found, expected, LOBE), &values, || {
                format!("pixel {i}: {found:?} for {expected:?}")
            });
        } else {
            assert!((0..3).all(|k| untouched(found[k][i])), "pixel {i} is not lit");
        }
    }
    tally.finish(STRAYS);
}

fn check_collect(rig: &Rig, bounce: usize) {
    let frame = rig.frame();
    let before = sums(rig, &frame.shade.lighting);
    rig.run(|_, rec| rig.compensation().record_collect(rec, bounce));
    let after = sums(rig, &frame.shade.lighting);
    let r = &rig.compensation().points;
    let light = sums(rig, &rig.compensation().lighting);
    let [beta, emitted, kd, wo] = [&rig.compensation().beta, &r.emitted, &r.kd, &r.wo].map(|b| rig.vec4s(b));
    let listed = rig.list(bounce - 1);
    for i in 0..beta.len() {
        if listed.binary_search(&(i as u32)).is_err() {
            let bits = |sums: &[Vec<Vec4>; 3]| [0, 1, 2].map(|k| sums[k][i].to_array().map(f32::to_bits));
            assert_eq!(bits(&before), bits(&after), "bounce {bounce}: pixel {i} gets nothing");
            continue;
        }
        let point = Gathered {
            beta: beta[i].truncate(),
            specular: beta[i].w == 1.0,
            emitted: emitted[i].truncate(),
            kd: kd[i].truncate(),
            lit: is_lit(wo[i]),
            sums: at(&light, i),
        };
        let added = collect::reference(&point, bounce as u32);
        let (old, new) = (at(&before, i), at(&after, i));
        for k in 0..3 {
            assert!(
                close(new[k], old[k] + added[k], 1e-6, 1e-12),
                "pixel {i}, {k}: {} + {} = {}",
                old[k],
                added[k],
                new[k]
            );
        }
    }
}

/// With a long clipping distance, so that most gather rays hit something.
fn of_bounces() -> Settings {
    Settings { particles: 9, max_depth: 4, clip: Clip::Distance(1.2), seed: 3, ..Settings::plain() }
}

/// Runs the walk, the eye stage and all bounces, and compares shading and gather rays.
fn check_bounces(rig: &Rig, sine: f32) -> Seen {
    rig.walk_and_look();
    let mut seen = Seen::default();
    for bounce in 0..4 {
        if bounce > 0 {
            check_gather(rig, bounce, sine, &mut seen);
        }
        check_shade(rig, bounce);
        if bounce < 3 {
            seen.aimed += check_aim(rig, bounce + 1);
        }
        if bounce > 0 {
            check_collect(rig, bounce);
        }
        assert_eq!(rig.lost(), 0);
    }
    for (k, sum) in sums(rig, &rig.frame().shade.lighting).iter().enumerate() {
        seen.sums[k] = rig.list(0).len().min(sum.iter().filter(|s| !untouched(**s) && s.x > 0.0).count());
    }
    seen
}

pub fn surfaces_that_let_light_pass_follow_their_oracles(bench: &Bench) {
    let scene = gallery_with_alpha();
    let sine = sine_error(bench, &scene);
    for resolution in bench.images() {
        let rig = bench.rig(&scene, resolution, Settings { pattern: [2, 1], ..of_bounces() });
        check_bounces(&rig, sine);
    }
}

pub fn shade_gather_and_collect_follow_their_oracles(bench: &Bench) {
    let scene = gallery_with_tables();
    let sine = sine_error(bench, &scene);
    let patterns = [[1, 1], [3, 3], [2, 3], [8, 8], [1, 1]];
    let mut compared = [0; 6];
    // The last with Sobol' points.
    let sequence = |i: usize| if i == 7 { Sequence::Sobol } else { Sequence::Halton };
    let images = bench.images().chain([[31, 17], [31, 17], [97, 61]]).zip(patterns.into_iter().cycle());
    for (i, (resolution, pattern)) in images.enumerate() {
        let settings = Settings { pattern, sequence: sequence(i), ..of_bounces() };
        let seen = check_bounces(&bench.rig(&scene, resolution, settings), sine);
        let all = [seen.gathered, seen.lit, seen.specular, seen.sums[0], seen.sums[1], seen.sums[2]];
        compared.iter_mut().zip(all).for_each(|(sum, n)| *sum += n);
        assert_eq!(seen.aimed, 0, "there are too many emitters");
    }
    bench.covered(compared.iter().all(|&n| n > 50), format_args!("{compared:?}"));
    // Points near emitters aim at them where there are few.
    let lamps = gallery_with_few_emitters();
    let mut seen = Seen::default();
    for (pattern, sequence) in [([1, 1], Sequence::Halton), ([3, 3], Sequence::Sobol)] {
        let rig = bench.rig(&lamps, [97, 61], Settings { pattern, sequence, ..of_bounces() });
        seen.aimed += check_bounces(&rig, sine).aimed;
    }
    // Clusters of the screen that choose their lights, so that the list has gaps.
    let settings = Settings { pattern: [2, 2], particles: 64, light_pool: 100, ..of_bounces() };
    let rig = bench.rig(&lamps, [97, 61], settings);
    assert!(rig.frame().eye.clusters.is_some());
    rig.walk_and_look();
    rig.run(|frame, rec| {
        frame.light_lists.run(rec)?;
        frame.shade.record(rec)
    });
    seen.aimed += check_aim(&rig, 1);
    check_gather(&rig, 1, sine, &mut seen);
    bench.covered(seen.aimed > 3000 && seen.gathered > 500, format_args!("{seen:?}"));
}

/// Effect of a single light on the shading points of the gallery.
#[derive(Debug, Default)]
struct Effects {
    lit: usize,
    shadowed: usize,
    clipped: usize,
    specular: usize,
}

fn effects(rig: &Rig, light: &PointLight) -> Effects {
    let p = &rig.parameters;
    let (clip2, far) = (p.right[3], p.forward[3]);
    let receivers = receivers(rig, &rig.frame().eye.points);
    let mut effects = Effects::default();
    for &i in &rig.list(0) {
        let r = &receivers[i as usize];
        let parallel = light.flags() & PointLight::DIRECTIONAL != 0;
        let d = if parallel { -far * xyz(light.normal) } else { xyz(light.position) - r.position };
        let wi = d.normalize();
        let sent = shade::light_towards(&rig.scene.materials, light, wi, d.length_squared(), clip2);
        if sent == Vec3::ZERO || wi.dot(r.shading) <= 0.0 || wi.dot(r.geometric) <= 0.0 {
            continue;
        }
        let shadow_ray = Ray { origin: r.position, t_max: 1.0, direction: d };
        let occluded = rig.bvh().transmittance(rig.scene, &shadow_ray) == 0.0;
        effects.shadowed += usize::from(occluded);
        effects.lit += usize::from(!occluded);
        effects.clipped += usize::from(!parallel && !occluded && d.length_squared() < clip2);
        effects.specular += usize::from(!occluded && r.reflectance.f90 > 0.0);
    }
    effects
}

/// Replaces all lights of a rig by one, in slot `slot`.
fn only(rig: &Rig, slot: usize, light: PointLight) {
    // A light's slot determines the number of reflections before it, lit or not.
    let mut lights: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
    for l in &mut lights {
        *l = PointLight { f0: [0.0, 0.0, 0.0, l.f0[3]], ..PointLight::default() };
    }
    lights[slot] = light;
    let mut staging = Staging::new();
    staging.stage_into(rig.ctx, &rig.frame().walk.lights, 0, &lights).must();
    rig.run(|_, rec| staging.record(rec));
}

/// One by one, and with the device's best kernel.
pub fn shade_of_each_kind_of_light(bench: &Bench) {
    [Traversal::Single, Traversal::Auto].into_iter().for_each(|traversal| shade_each_kind(bench, traversal));
}

fn shade_each_kind(bench: &Bench, traversal: Traversal) {
    let scene = gallery_with_tables();
    let settings = Settings { particles: 27, clip: Clip::Distance(1.0), seed: 3, traversal, ..Settings::plain() };
    let rig = bench.rig(&scene, [31, 17], settings);
    rig.walk_and_look();
    let lights: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
    let delta = rig.engine.device_scene().delta.len();
    assert_eq!(delta, 4);
    let reflected = rig.parameters.depths[1][1] as usize;
    // Of the lights with power, the one that lights most shading points.
    let brightest = |range: std::ops::Range<usize>, of: fn(&PointLight) -> [f32; 4]| {
        let sends = |i: usize| xyz(of(&lights[i])) != Vec3::ZERO;
        range.max_by_key(|&i| if sends(i) { effects(&rig, &lights[i]).lit } else { 0 }).unwrap()
    };
    let on_emitter = brightest(delta..reflected, |l| l.emit);
    let glossy = brightest(reflected..lights.len(), |l| if l.flags() & 8 != 0 { l.flux } else { [0.0; 4] });
    assert_ne!(lights[glossy].flags() & PointLight::GLOSSY, 0);
    let mut lobe = lights[glossy];
    lobe.emit = [0.0, 0.0, 0.0, 1.0];
    // Close above the floor at the room's centre, for clipping.
    let mut near = lights[on_emitter];
    (near.position[0], near.position[1], near.position[2]) = (-0.6, 0.5, -0.2);
    for (name, slot, light, clips, shadows) in [
        ("point", 0, lights[0], false, true),
        ("spot", 1, lights[1], false, true),
        ("directional", 2, lights[2], false, true),
        ("virtual", 3, lights[3], true, true),
        ("surface", on_emitter, lights[on_emitter], true, false),
        ("glossy", glossy, lights[glossy], true, false),
        ("specular lobe alone", glossy, lobe, true, false),
        ("near surface", delta, near, true, true),
    ] {
        only(&rig, slot, light);
        rig.run(|frame, rec| frame.shade.record(rec));
        let found = sums(&rig, &rig.frame().shade.lighting);
        let receivers = receivers(&rig, &rig.frame().eye.points);
        let words = rig.vec4s(&rig.frame().eye.points.wo);
        let mut tally = Tally::new(format!("shade by a {name} light"));
        let indirect = if light.flags() & PointLight::GLOSSY != 0 { LOBE } else { DIFFUSE };
        for &i in &rig.list(0) {
            let i = i as usize;
            let p = &rig.parameters;
            let segments = ShadingPoints::segments(ShadingPoints::flags(words[i].w));
            let in_reach = light.f0[3] as u32 + segments + 2 <= p.scene[2];
            let lights: &[PointLight] = if in_reach { &[light] } else { &[] };
            let expected = shade::reference(rig.scene, rig.bvh(), &receivers[i], lights, p.right[3], p.forward[3]);
            let values = [0, 1, 2].map(|k| (at(&found, i)[k], expected[k]));
            tally.check_values(alike(at(&found, i), expected, indirect), &values, || {
                format!("{i}: {:?} for {expected:?}", at(&found, i))
            });
        }
        tally.finish(STRAYS);
        let e = effects(&rig, &light);
        bench.covered(e.lit > 10 && e.specular > 0, format_args!("{name}: {e:?}"));
        bench.covered(!shadows || e.shadowed > 0, format_args!("{name}: {e:?}"));
        bench.covered(clips || light.flags() & PointLight::CLIPPED == 0, format_args!("{name}"));
        bench.covered(name != "near surface" || e.clipped > 10, format_args!("{name}: {e:?}"));
    }
}

pub fn schedule_turns_counts_into_dispatches(bench: &Bench) {
    for live in [0u32, 1, 63, 64, 65, (1 << 21) + 1, u32::MAX - 63] {
        for unfinished in [0, 1, 77] {
            let steps: Vec<Step> = [0, 1, 27, 64, 65, 2049, 3 << 21]
                .into_iter()
                .flat_map(|end| [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[last, indirect]| (end, last, indirect)))
                .map(|(end, last, indirect)| Step { end, last, indirect, ..Step::default() })
                .collect();
            let step_set = Resources::of([("steps", &upload(bench, "steps", &steps).must())]);
            let list_groups = [9, 9, 9, unfinished];
            let before =
                DispatchCounts { live, unfinished, round_groups: [9; 4], list_groups, ..DispatchCounts::default() };
            let works: Vec<Buffer> = steps.iter().map(|_| upload(bench, "work", &[before]).must()).collect();
            let status = upload(bench, "status", &[5u32, 6, 7, 8]).must();
            let passes: Vec<Schedule> = make(bench, Resources::of([("status", &status)]), |kit| {
                works.iter().map(|work| Schedule::new(kit, work, &step_set)).collect()
            });
            bench
                .submit_and_wait("schedule", None, |rec| {
                    (0u32..).zip(&passes).try_for_each(|(i, pass)| pass.record(rec, i))
                })
                .must();
            let mut lost = 0;
            for (step, work) in steps.iter().zip(&works) {
                let found = download::<DispatchCounts>(bench, work).must()[0];
                let (expected, more) = schedule::reference(&before, step);
                assert_eq!(bytemuck::bytes_of(&found), bytemuck::bytes_of(&expected), "{before:?} {step:?}: {found:?}");
                lost += more;
                // Enough workgroups, within what every device allows.
                let [x, y, z, _] = found.list_groups;
                assert!(x <= 65_535 && y <= 65_535 && z == 1);
                assert!(u64::from(x) * u64::from(y) * 64 >= u64::from(live));
            }
            assert_eq!(download::<u32>(bench, &status).must(), [5 + lost, 6, 7, 8]);
        }
    }
}
