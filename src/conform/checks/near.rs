//! Near light from the irradiance of pixels: its passes against their oracles.

use crate::accel::{Ray, offset_origin};
use crate::conform::Bench;
use crate::pass::near_aim;
use crate::pass::near_collect::{self, Link};
use crate::pass::near_points::{self, NOT_SHOWN, Seen};
use crate::pass::shade::ShadingPoint;
use crate::pass::surface::{SurfacePoint, surface_at};
use crate::pass::{ShadingPoints, gather, sort};
use crate::ring::Paths;
use crate::scene::{Camera, Frustum};
use crate::settings::{Clip, Compensation, Filter, Settings};
use crate::stage::NearLight;
use glam::{Vec3, Vec4};

use super::aim::{Aimed, parts_of};
use super::light::receivers;
use crate::conform::rig::{
    Rig, STRAYS, Tally, close, gallery_with_few_emitters, gallery_with_tables, hit_of, is_lit, orthographic, ray_of,
    sine_error,
};
use std::f32::consts::FRAC_1_PI;

fn settings(pattern: [u32; 2]) -> Settings {
    Settings { pattern, compensation: Compensation::Near, clip: Clip::Fraction(0.4), seed: 3, ..Settings::plain() }
}

fn stage<'a>(rig: &'a Rig) -> &'a NearLight {
    rig.frame().near_light.as_ref().unwrap()
}

/// Counts of rays, hits that a pixel shows, hits that are lit, rays from a lobe, rays that went on; rays aimed at emitters, from pixels and from hits.
#[derive(Debug, Default)]
struct Met {
    rays: usize,
    shown: usize,
    lit: usize,
    specular: usize,
    onward: usize,
    aimed: [usize; 2],
}

/// Of the end of a near ray, by the oracles.
struct End {
    surface: Option<SurfacePoint>,
    /// Share of the light that clipping removed.
    share: f32,
    /// Throughput, and what the hit emits.
    weight: Vec3,
    light: Vec3,
    /// It reflects light, mostly diffusely, and the pixel that shows it.
    sends: bool,
    matte: bool,
    shown: Option<u32>,
}

impl End {
    /// `before`, `seen_wo`: the points of the pixels; `clip`: distance within which light is clipped where the ray starts.
    fn of(
        rig: &Rig,
        slot: u32,
        (ray, hit): (Ray, Vec4),
        (weight, clip): (Vec3, f32),
        (before, seen_wo): Pixels,
    ) -> End {
        let p = &rig.parameters;
        let hit = hit_of(hit);
        let share = hit.map_or(0.0, |h| (1.0 - h.t * h.t / (clip * clip)).max(0.0));
        let surface = hit.map(|hit| surface_at(rig.scene, rig.bvh(), &hit, ray.direction, p.cones[2] * hit.t));
        let weight = weight * share;
        let sends = surface
            .as_ref()
            .is_some_and(|s| share > 0.0 && weight != Vec3::ZERO && mean(s.reflectance.kd + s.reflectance.f0) > 0.0);
        let matte = surface
            .as_ref()
            .is_some_and(|s| sends && mean(s.reflectance.kd) > near_points::MATTE * mean(s.reflectance.f0));
        let shown = surface.as_ref().filter(|_| matte).and_then(|s| {
            let q = near_points::pixel_of(p, s.position, sort::class_of(p, slot))?;
            let k = q as usize;
            let seen = Seen {
                position: before[k].position,
                geometric: before[k].geometric,
                wo: before[k].wo,
                flags: ShadingPoints::flags(seen_wo[k].w),
            };
            near_points::shows(p, &seen, s.position, s.geometric).then_some(q)
        });
        let light = surface.as_ref().map_or(Vec3::ZERO, |s| weight * s.emission);
        End { surface, share, weight, light, sends, matte, shown }
    }
}

type Pixels<'a> = (&'a [ShadingPoint], &'a [Vec4]);

/// Rays `k` of [`NearLight::aimed`] leave those of the slots that `is_source` names, and add light of the emitters that they meet. Returns how many.
fn check_aimed(rig: &Rig, k: usize, slots: &[u32], from: &[ShadingPoint], is_source: impl Fn(usize) -> bool) -> usize {
    let (p, near) = (&rig.parameters, stage(rig));
    let flags = rig.vec4s(&rig.frame().eye.points.wo);
    let aimed = Aimed {
        what: format!("rays aimed at emitters, {k}, {}x{}", p.size[0], p.size[1]),
        reach: [1.0, near_points::CLOSER][k] * p.up[3],
        list: &near.aimed[k],
        lighting: [&rig.frame().shade.lighting, &near.hit_lighting][k],
        point: &|slot| match k {
            0 => near_aim::point(p, slot, sort::class_of(p, slot)),
            _ => near_aim::point_at_hit(p, slot),
        },
        weight: &|slot, point, cosine, by_aim| {
            let diffuse = point.gathering().diffuse_probability();
            match k {
                0 => {
                    let flags = ShadingPoints::flags(flags[slot as usize].w);
                    near_aim::near_weights(p, (slot, flags), diffuse, cosine, by_aim).1
                }
                _ => near_aim::onward_weights(cosine, by_aim).1,
            }
        },
        record_light: &|rec| near.record_aimed_light(rec, k),
    };
    aimed.check(rig, slots, from, is_source)
}

/// Rays leave the right pixels, their hits find the pixels that show them, and some rays go on from other hits.
fn check_points(rig: &Rig, sine: f32, met: &mut Met) {
    let (p, near, eye) = (&rig.parameters, stage(rig), &rig.frame().eye);
    let before = receivers(rig, &eye.points);
    rig.prefill(&[&near.near_slot, &near.beta, &near.points.wo, &near.aimed[0].entries]);
    rig.run(|_, rec| near.record_aimed_rays(rec));
    met.aimed[0] += check_aimed(rig, 0, &rig.list(0), &before, |i| before[i].reflectance.kd != Vec3::ZERO);
    rig.run(|_, rec| near.record_rays(rec));
    let traced = [&eye.rays.origin, &eye.rays.direction, &eye.rays.hits].map(|b| rig.vec4s(b));
    rig.run(|_, rec| near.record_points(rec));
    let what = format!("{}x{}, pattern {:?}", p.size[0], p.size[1], p.pattern);
    let seen_wo = rig.vec4s(&eye.points.wo);
    let flags = |slot: u32| ShadingPoints::flags(seen_wo[slot as usize].w);
    let has_ray = |slot: &u32| near_points::has_near_ray(p, *slot, sort::class_of(p, *slot), flags(*slot));
    let started: Vec<u32> = rig.list(0).into_iter().filter(has_ray).collect();
    assert_eq!(rig.sorted(&near.started), started, "{what}: half of the classes have near rays");
    let mut rays = Tally::new(format!("near rays, {what}"));
    let mut found = Tally::new(format!("hits of near rays, {what}"));
    let rays_of = |[origin, direction, hits]: &[Vec<Vec4>; 3], i: usize| (ray_of(origin[i], direction[i]), hits[i]);
    let read = || {
        let [beta, emitted, wo] = [&near.beta, &near.points.emitted, &near.points.wo].map(|b| rig.vec4s(b));
        (beta, emitted, wo, rig.get::<u32>(&near.near_slot), receivers(rig, &near.points))
    };
    let (beta, emitted, wo, slots, after) = read();
    let onward_rays = [&eye.rays.origin, &eye.rays.direction].map(|b| rig.vec4s(b));
    let (mut listed, mut onward, mut shares) = (Vec::new(), Vec::new(), Vec::new());
    for &slot in &started {
        let i = slot as usize;
        let (expected, weight, specular) =
            gather::near_reference(p, &rig.scene.materials, slot, (sort::class_of(p, slot), flags(slot)), &before[i]);
        let (ray, hit) = rays_of(&traced, i);
        let tolerance = if specular { 2.0 * sine.sqrt() } else { 5e-4 };
        let same = ray.origin == expected.origin && close(ray.direction, expected.direction, 0.0, tolerance);
        rays.check(same, || format!("slot {i}: {ray:?} for {expected:?}"));
        assert_eq!(beta[i].w, f32::from(specular), "{what}: lobe of slot {i}");
        let end = End::of(rig, slot, (ray, hit), (weight, p.up[3]), (&before, &seen_wo));
        // Rays aimed at emitters bring the rest.
        let point = &before[i];
        let share = |reach: f32, wi: Vec3| {
            let by_aim = near_aim::density(&parts_of(rig, point, reach), wi);
            let diffuse = point.gathering().diffuse_probability();
            near_aim::near_weights(p, (slot, flags(slot)), diffuse, wi.dot(point.shading), by_aim).0
        };
        let share = if specular || ray.t_max == 0.0 { 1.0 } else { share(p.up[3], ray.direction) };
        let close_light = close(emitted[i].truncate(), share * end.light, tolerance.max(5e-3), 1e-6);
        found.check(close_light && emitted[i].w == 0.0, || format!("slot {i}: {} for {}", emitted[i], end.light));
        found.check(slots[i] == end.shown.unwrap_or(NOT_SHOWN), || {
            format!("slot {i}: pixel {} for {:?}", slots[i], end.shown)
        });
        let is_shown = slots[i] != NOT_SHOWN;
        let alone = end.sends && !is_shown && p.scene[2] > 2;
        let kept = if alone { near_points::kept(p, slot, end.share) } else { Some(1.0) };
        let reflects = alone && kept.is_some();
        let weight = kept.map_or(Vec3::ZERO, |probability| end.weight / probability);
        let source =
            end.surface.as_ref().filter(|s| reflects && end.matte && s.emission == Vec3::ZERO && p.scene[2] > 3);
        let direction = source.and_then(|s| near_points::goes_on(p, slot, s.shading));
        let link = match (&end.surface, source, direction) {
            (Some(s), ..) if is_shown => end.weight * (s.reflectance.kd + s.reflectance.f0) * FRAC_1_PI,
            (_, Some(s), Some(_)) => weight * s.reflectance.kd / near_points::ONWARD,
            (_, Some(_), None) => weight / (1.0 - near_points::ONWARD),
            _ => weight,
        };
        found.check(close(beta[i].truncate(), link, tolerance, 1e-6), || format!("slot {i}: {} for {link}", beta[i]));
        found.check(is_lit(wo[i]) == (reflects && direction.is_none()), || format!("slot {i}: lit"));
        if is_lit(wo[i]) {
            listed.push(slot);
            let kd = end.surface.as_ref().map_or(Vec3::ZERO, |s| s.reflectance.kd);
            found.check(close(after[i].reflectance.kd, kd, 1e-4, 1e-5), || format!("slot {i}: albedo"));
        }
        if let (Some(s), Some(direction)) = (source, direction) {
            onward.push(slot);
            let origin = offset_origin(s.position, s.geometric, p.eye[3]);
            let reach = if direction.dot(s.geometric) > 0.0 { near_points::CLOSER * p.up[3] } else { 0.0 };
            let [from, to] = [onward_rays[0][i], onward_rays[1][i].truncate().extend(0.0)];
            let same = close(from.truncate(), origin, 1e-5, 1e-5) && close(to.truncate(), direction, 0.0, 1e-3);
            let parts = parts_of(rig, &ShadingPoint { position: origin, shading: s.shading, ..before[i] }, reach);
            let by_aim = near_aim::density(&parts, direction);
            shares.push(near_aim::onward_weights(direction.dot(s.shading), by_aim).0);
            rays.check(same && from.w == reach, || format!("slot {i} goes on: {from}, {to} for {origin}, {direction}"));
        }
        met.rays += 1;
        met.shown += usize::from(is_shown);
        met.specular += usize::from(specular);
    }
    assert_eq!(rig.sorted(&near.list), listed, "{what}: the list names the lit hits, each once");
    assert_eq!(rig.sorted(&near.onward), onward, "{what}: so does that of the rays that go on");
    rig.run(|_, rec| {
        rec.fill(&near.hit_lighting.direct, 0)?;
        near.record_onward(rec)
    });
    let is_source = |i: usize| {
        let r = after[i].reflectance;
        mean(r.kd) > near_points::MATTE * mean(r.f0) && p.scene[2] > 3
    };
    met.aimed[1] += check_aimed(rig, 1, &listed, &after, is_source);
    let traced = [&eye.rays.origin, &eye.rays.direction, &eye.rays.hits].map(|b| rig.vec4s(b));
    let first = beta;
    let (beta, emitted, wo, slots, _) = read();
    for (&slot, share) in onward.iter().zip(shares) {
        let i = slot as usize;
        let clip = near_points::CLOSER * p.up[3];
        let end = End::of(rig, slot, rays_of(&traced, i), (first[i].truncate(), clip), (&before, &seen_wo));
        let is_shown = slots[i] != NOT_SHOWN;
        let link = match &end.surface {
            Some(s) if is_shown => end.weight * (s.reflectance.kd + s.reflectance.f0) * FRAC_1_PI,
            _ => end.weight,
        };
        let same = close(emitted[i].truncate(), share * end.light, 5e-3, 1e-6)
            && close(beta[i].truncate(), link, 1e-3, 1e-6)
            && (emitted[i].w, beta[i].w) == (1.0, first[i].w)
            && slots[i] == end.shown.unwrap_or(NOT_SHOWN)
            && is_lit(wo[i]) == (end.sends && !is_shown);
        found.check(same, || format!("slot {i} onward: {}, {} for {}, {link}", emitted[i], beta[i], end.light));
        if is_lit(wo[i]) {
            listed.push(slot);
        }
    }
    listed.sort_unstable();
    assert_eq!(rig.sorted(&near.list), listed, "{what}: the list names the lit hits after the second ray too");
    met.lit += listed.len();
    met.onward += onward.len();
    rays.finish(STRAYS);
    found.finish(STRAYS);
}

fn mean(v: Vec3) -> f32 {
    v.element_sum() / 3.0
}

/// The light of near rays adds up along the chains of pixels. Returns how often it was averaged over neighbours of a class, and how many
/// pixels without a near ray took some of others.
fn check_collect(rig: &Rig) -> [usize; 2] {
    let points = receivers(rig, &rig.frame().eye.points);
    let (mut averaged, mut spread) = (0, 0);
    let (p, near) = (&rig.parameters, stage(rig));
    let lighting = &rig.frame().shade.lighting;
    let three = |l: &crate::pass::Lighting| [&l.direct, &l.indirect, &l.specular].map(|b| rig.vec4s(b));
    rig.run(|_, rec| near.record_shade(rec, &Paths::default()));
    let (before, lit) = (three(lighting), three(&near.hit_lighting));
    let [beta, emitted, kd, wo] =
        [&near.beta, &near.points.emitted, &near.points.kd, &near.points.wo].map(|b| rig.vec4s(b));
    let slots: Vec<u32> = rig.get(&near.near_slot);
    let seen_wo = rig.vec4s(&rig.frame().eye.points.wo);
    let started = rig.sorted(&near.started);
    rig.run(|_, rec| near.record_collect(rec));
    let after = three(lighting);
    let links: Vec<Link> = (0..beta.len())
        .map(|i| {
            let has_ray = started.binary_search(&(i as u32)).is_ok();
            let at = |l: &[Vec<Vec4>; 3], k: usize| l[k][i].truncate();
            let of_hit = if has_ray && is_lit(wo[i]) { [0, 1, 2].map(|k| at(&lit, k)) } else { [Vec3::ZERO; 3] };
            Link {
                beta: beta[i].truncate(),
                rays: if has_ray && emitted[i].w == 1.0 { 2 } else { 1 },
                weight: near_points::ray_weight(p, i as u32, ShadingPoints::flags(seen_wo[i].w)),
                has_ray,
                specular: beta[i].w == 1.0,
                emitted: emitted[i].truncate(),
                shown: Some(slots[i]).filter(|&q| has_ray && q != NOT_SHOWN).map(|q| q as usize),
                hit: (if is_lit(wo[i]) { kd[i].truncate() } else { Vec3::ZERO }, of_hit),
                clipped: [at(&before, 0), at(&before, 1)],
            }
        })
        .collect();
    let shares = near_collect::shares(p.scene[2], rig.engine.plan().scene.extent.reflectivity);
    // Of each slot with a near ray what is left after the average over its class: direct, indirect, specular.
    let mut means = vec![[Vec3::ZERO; 3]; links.len()];
    for i in (0..links.len()).filter(|&i| links[i].has_ray) {
        let sum = |i: usize| near_collect::reference(&links, i, &shares);
        let [mut direct, mut indirect] = sum(i);
        let neighbours = near_collect::neighbours(p, i as u32);
        let part = f32::from_bits(p.lists[2]) / (p.mirrors[3] * p.mirrors[3]) as f32;
        for other in neighbours.into_iter().map(|slot| slot as usize) {
            let at = |k: usize| (points[k].position, points[k].geometric);
            let counts = links[other].has_ray && links[other].specular == links[i].specular;
            if counts && near_collect::smooth_between(at(i), at(other)) {
                let [other_direct, other_indirect] = sum(other);
                let own = sum(i);
                direct += part * (other_direct - own[0]);
                indirect += part * (other_indirect - own[1]);
                averaged += usize::from(other != i);
            }
        }
        means[i] = match links[i].specular {
            true => [Vec3::ZERO, Vec3::ZERO, direct + indirect],
            false => [direct, indirect, Vec3::ZERO],
        };
    }
    let filtered = rig.engine.plan().settings.filter.is_some();
    let listed = rig.list(0);
    for i in 0..links.len() {
        let old = [0, 1, 2].map(|k| before[k][i]);
        let new = [0, 1, 2].map(|k| after[k][i]);
        let slot = i as u32;
        let takes = links[i].has_ray || filtered && listed.contains(&slot);
        if !takes {
            let bits = |v: [Vec4; 3]| v.map(|v| v.to_array().map(f32::to_bits));
            assert_eq!(bits(old), bits(new), "slot {i} has no near ray");
            continue;
        }
        let mut added = means[i];
        if filtered && slot < p.size[2] {
            let at = |k: usize| (points[k].position, points[k].geometric);
            let others = near_collect::window(p, slot).into_iter().map(|other| other as usize);
            let lit = others.filter(|&other| is_lit(seen_wo[other]));
            let others: Vec<_> = lit.map(|k| (near_collect::alike(at(i), at(k)), means[k])).collect();
            added = near_collect::spread(p, means[i], &others);
            spread += usize::from(!links[i].has_ray && added != [Vec3::ZERO; 3]);
        }
        for k in 0..3 {
            let expected = old[k].truncate() + added[k];
            assert!(close(new[k].truncate(), expected, 1e-5, 1e-6), "slot {i}, {k}: {} for {expected}", new[k]);
        }
    }
    [averaged, spread]
}

pub fn near_light_follows_its_oracles(bench: &Bench) {
    let scene = gallery_with_tables();
    let sine = sine_error(bench, &scene);
    let (mut met, mut averaged, mut spread) = (Met::default(), 0, 0);
    let patterns = [[1, 1], [3, 3], [2, 3], [8, 8], [3, 3]];
    let images = bench.images().chain([[97, 61], [83, 47]]).zip(patterns.into_iter().cycle());
    for ((resolution, pattern), i) in images.zip(0..) {
        let rig = bench.rig(&scene, resolution, settings(pattern));
        rig.light();
        check_points(&rig, sine, &mut met);
        assert_eq!(check_collect(&rig), [0, 0], "without a filter nothing is averaged");
        // With one, neighbours have other directions, and share their light.
        let filtered = Settings { filter: Some(Filter::default()), ..settings(pattern) };
        // Both means of the later ones have faded.
        let rig = bench.rig_at_pass(&scene, resolution, filtered, 25 * i);
        rig.light();
        check_points(&rig, sine, &mut met);
        let [of_class, of_window] = check_collect(&rig);
        averaged += of_class;
        spread += of_window;
    }
    log::info!("{met:?}, {averaged} averaged, {spread} spread");
    bench.covered(averaged > 1000 && spread > 500, format_args!("{averaged} averaged, {spread} spread"));
    bench.covered(
        met.rays > 1000 && met.shown > 300 && met.lit > 300 && met.specular > 50 && met.onward > 50,
        format_args!("{met:?}"),
    );
    // Points near emitters aim at them where there are few.
    assert_eq!(met.aimed, [0, 0], "there are too many");
    let lamps = gallery_with_few_emitters();
    let mut of_lamps = Met::default();
    for (resolution, pattern, pass) in [([97, 61], [3, 3], 0), ([61, 47], [2, 3], 30), ([128, 96], [2, 2], 5)] {
        let filtered = Settings { filter: Some(Filter::default()), ..settings(pattern) };
        let rig = bench.rig_at_pass(&lamps, resolution, filtered, pass);
        assert!(rig.engine.emitters().list.len() <= near_aim::EMITTERS);
        rig.light();
        check_points(&rig, sine, &mut of_lamps);
        check_collect(&rig);
    }
    log::info!("{of_lamps:?} with few emitters");
    bench.covered(of_lamps.aimed[0] > 1000 && of_lamps.aimed[1] > 50, format_args!("{of_lamps:?}"));
    // Off-centre, as the projection of a host may be.
    let mut shifted = scene.clone();
    let frustum = Frustum { half_extents: [0.9, 0.7], shift: [0.35, -0.2] };
    shifted.camera = shifted.camera.map(|camera| Camera { frustum: Some(frustum), ..camera });
    let rig = bench.rig(&shifted, [61, 47], settings([3, 3]));
    rig.light();
    let mut of_shifted = Met::default();
    check_points(&rig, sine, &mut of_shifted);
    check_collect(&rig);
    let shown = of_shifted.shown as f32 / met.shown as f32 * met.rays as f32;
    bench.covered(shown > 0.5 * of_shifted.rays as f32, format_args!("{of_shifted:?}"));
    // By parallel rays.
    let from_afar = orthographic(scene.clone());
    let rig = bench.rig(&from_afar, [61, 47], settings([3, 3]));
    rig.light();
    let mut of_parallel = Met::default();
    check_points(&rig, sine, &mut of_parallel);
    check_collect(&rig);
    bench.covered(of_parallel.shown > 20 && of_parallel.lit > 20, format_args!("{of_parallel:?}"));
    // With the shortest paths only emitters are found; nothing is lit.
    let rig = bench.rig(&scene, [31, 17], Settings { max_depth: 2, ..settings([3, 3]) });
    rig.light();
    check_points(&rig, sine, &mut Met::default());
    check_collect(&rig);
}
