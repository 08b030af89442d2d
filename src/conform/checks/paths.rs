//! Eye paths through mirrors and glass, and their second components, against their oracles.

use crate::conform::{Bench, Must};
use std::collections::BTreeMap;

use crate::bsdf::Reflectance;
use crate::bsdf::ideal::Media;
use crate::bsdf::phong::width_of;
use crate::gpu::{Resources, download, upload};
use crate::pass::eye_paths::{self, EyePath, Plane};
use crate::pass::glossy_light;
use crate::pass::merge::{self, Merge};
use crate::pass::surface::surface_at;
use crate::pass::{List, ShadingPoints, layout, sort, tiles};
use crate::plan::MAX_FOLLOWED_ALPHA;
use crate::scene::Surface;
use crate::settings::{Reflectance as Form, Settings, Superposition};
use glam::{Vec3, Vec4};

use super::film::{Sheet, fill};
use crate::conform::rig::{Rig, STRAYS, Tally, close, gallery_with_tables, has, hit_of, make, ray_of, untouched};

/// Tolerance for a direction: refraction near the critical angle magnifies the rounding of roots and divisions.
const DIRECTION: f32 = 1e-3;

/// Tolerance for the density of a lobe, which magnifies differences of the directions.
const LOBE: f32 = 5e-3;

/// The eye paths of all slots, read from the device.
struct EyePathState {
    origin: Vec<Vec4>,
    direction: Vec<Vec4>,
    hits: Vec<Vec4>,
    throughput: Vec<Vec4>,
    media: Vec<[u32; 4]>,
    emitted: Vec<Vec4>,
    lobe: Vec<f32>,
}

impl EyePathState {
    fn of(rig: &Rig) -> EyePathState {
        let frame = rig.frame();
        EyePathState {
            origin: rig.vec4s(&frame.eye.rays.origin),
            direction: rig.vec4s(&frame.eye.rays.direction),
            hits: rig.vec4s(&frame.eye.rays.hits),
            throughput: rig.vec4s(&frame.eye.paths.throughput),
            media: rig.get(&frame.eye.paths.media),
            emitted: rig.vec4s(&frame.eye.points.emitted),
            lobe: rig.get(&frame.eye.paths.lobe_of),
        }
    }

    /// Segments of the path in slot `i`, and density of its direction along a lobe. At a first hit nothing is known of either.
    fn lobe_of(&self, i: usize, step: usize) -> (u32, f32) {
        let segments = if step > 0 { ShadingPoints::segments(ShadingPoints::flags(self.emitted[i].w)) } else { 0 };
        (segments, if segments > 0 { self.lobe[i] } else { 0.0 })
    }

    fn bits(&self, i: usize) -> Vec<u32> {
        let vectors = [&self.origin, &self.direction, &self.hits, &self.throughput, &self.emitted];
        let of_vectors = vectors.iter().flat_map(|v| v[i].to_array().map(f32::to_bits));
        of_vectors.chain(self.media[i]).chain([self.lobe[i].to_bits()]).collect()
    }

    /// Whether slot `i` agrees with the oracle after its step.
    fn is(&self, i: usize, expected: &EyePath, cos_view: f32) -> bool {
        let state = close(self.throughput[i].truncate(), expected.throughput, DIRECTION, 1e-6)
            && (self.throughput[i].w - expected.depth).abs() <= 1e-4 * expected.depth
            && close(self.emitted[i].truncate(), expected.emitted, 1e-4, 1e-6)
            && has(self.emitted[i], ShadingPoints::LOBE_SAMPLED) == expected.sampled
            && has(self.emitted[i], ShadingPoints::NARROW_LOBE) == expected.narrow
            && has(self.emitted[i], ShadingPoints::UNLIKELY) == expected.unlikely
            && has(self.emitted[i], ShadingPoints::CHOSE) == expected.chose
            && has(self.emitted[i], ShadingPoints::DEEP) == expected.deep
            && ShadingPoints::free_component(ShadingPoints::flags(self.emitted[i].w)) == expected.free;
        let Some(ray) = expected.ray else { return state };
        let found = ray_of(self.origin[i], self.direction[i]);
        state
            && close(found.origin, ray.origin, 1e-5, 1e-6)
            && found.t_max == ray.t_max
            && close(found.direction, ray.direction, 0.0, DIRECTION)
            && self.direction[i].w == cos_view
            && self.lobe_of(i, 1).0 == expected.segments
            && (expected.segments == 0 || close(Vec3::splat(self.lobe[i]), Vec3::splat(expected.lobe), LOBE, 1e-6))
            && Media(self.media[i]) == expected.media
    }
}

/// Counts of paths by the result of a step.
#[derive(Debug, Default)]
struct Seen {
    split: usize,
    split_again: usize,
    first: usize,
    second: usize,
    stayed: usize,
    crossed: usize,
    within_two: usize,
    mirrored: usize,
    curved: usize,
    in_mirrors: usize,
    along_lobes: usize,
    further: usize,
}

/// Runs one step and compares it with the oracle.
fn check_step(rig: &Rig, step: usize, seen: &mut Seen) {
    let frame = rig.frame();
    let [width, height, pixels, _] = rig.parameters.size;
    let slots = (frame.eye.paths.throughput.bytes() / 16) as u32;
    let components = slots / pixels;
    let before = EyePathState::of(rig);
    let entering: Vec<u32> = match step.checked_sub(1) {
        None => (0..pixels).collect(),
        Some(last) => rig.eye_list(last),
    };
    rig.run(|frame, rec| frame.eye.record_step(rec, step));
    let in_tile: Vec<u32> = rig.ideal_pixels();
    let after = EyePathState::of(rig);
    let what = format!("{width}x{height}, step {step}");
    let mut expected = BTreeMap::new();
    for &slot in &entering {
        let i = slot as usize;
        let Some(hit) = hit_of(before.hits[i]) else { continue };
        let (d, cos_view) = (before.direction[i].truncate(), before.direction[i].w);
        let path = EyePath {
            slot,
            ray: None,
            throughput: before.throughput[i].truncate(),
            depth: before.throughput[i].w,
            media: if step == 0 { Media::default() } else { Media(before.media[i]) },
            emitted: before.emitted[i].truncate(),
            lobe: before.lobe_of(i, step).1,
            segments: before.lobe_of(i, step).0,
            sampled: false,
            narrow: step > 0 && has(before.emitted[i], ShadingPoints::NARROW_LOBE),
            unlikely: step > 0 && has(before.emitted[i], ShadingPoints::UNLIKELY),
            chose: step > 0 && has(before.emitted[i], ShadingPoints::CHOSE),
            deep: step > 0 && has(before.emitted[i], ShadingPoints::DEEP),
            free: if step > 0 { ShadingPoints::free_component(ShadingPoints::flags(before.emitted[i].w)) } else { 0 },
        };
        let width = rig.parameters.cones[0] * rig.parameters.depth_scale(path.depth + cos_view * hit.t);
        let surface = surface_at(rig.scene, rig.bvh(), &hit, d, width);
        let way = (d, hit.t, cos_view);
        let number = (step as u32, sort::class_of(&rig.parameters, slot));
        let plane = rig.spreading_plane(&hit, d).filter(|plane| {
            let shown = || rig.get::<u32>(&frame.eye.planes.region)[(slot % pixels) as usize];
            let is_curved = matches!(plane, Plane::Curved { .. });
            step == 0 || (!is_curved && shown() > 0 && rig.is_pane(shown()) == (slot < pixels))
        });
        seen.curved += usize::from(matches!(plane, Some(Plane::Curved { .. })));
        seen.mirrored += usize::from(plane.is_some() && step == 0);
        seen.in_mirrors += usize::from(plane.is_some() && step > 0);
        if let Some((next, branch)) =
            eye_paths::reference(&rig.parameters, rig.scene, number, components, &path, way, &surface, plane)
        {
            let lobes = [Some(next), branch].into_iter().flatten().filter(|p| p.ray.is_some() && p.lobe > 0.0);
            seen.along_lobes += lobes.count();
            seen.further += usize::from(next.segments > 1);
            seen.split += usize::from(branch.is_some() && step == 0);
            seen.split_again += usize::from(branch.is_some_and(|branch| branch.slot >= 2 * pixels));
            seen.stayed += usize::from(next.ray.is_none());
            seen.crossed += usize::from(next.media != path.media);
            seen.within_two += usize::from(next.media.0[1] != 0);
            if let Some(ray) = next.ray {
                let through = ray.direction.dot(surface.geometric) < 0.0;
                *(if through { &mut seen.first } else { &mut seen.second }) += 1;
            }
            // A second component without light is none.
            let branch = branch.filter(|branch| branch.ray.is_some());
            for path in [Some(next), branch].into_iter().flatten() {
                expected.insert(path.slot, (path, cos_view));
            }
        }
    }
    let mut tally = Tally::new(format!("eye_paths, {what}"));
    for (&slot, (path, cos_view)) in &expected {
        let i = slot as usize;
        let of = [&after.throughput, &after.emitted].map(|v| v[i].truncate());
        let mut values = vec![(of[0], path.throughput), (of[1], path.emitted)];
        if let Some(ray) = &path.ray {
            values.extend(
                [&after.origin, &after.direction].map(|v| v[i].truncate()).into_iter().zip([ray.origin, ray.direction]),
            );
        }
        tally.check_values(after.is(i, path, *cos_view), &values, || {
            let (origin, direction) = (after.origin[i], after.direction[i]);
            let (through, media, emitted, lobe) =
                (after.throughput[i], after.media[i], after.emitted[i], after.lobe[i]);
            format!("slot {slot}: {origin} {direction} {through} {media:?} {emitted} {lobe} for {path:?}")
        });
    }
    tally.finish(STRAYS);
    // A deflected path is on the list exactly if the oracle's is, except at mirrors over a base.
    let on: Vec<u32> = expected.iter().filter(|(_, (path, _))| path.ray.is_some()).map(|(&slot, _)| slot).collect();
    let listed = rig.eye_list(step);
    let strays = on.iter().filter(|s| !listed.contains(s)).chain(listed.iter().filter(|s| !on.contains(s))).count();
    assert!(strays <= (on.len() as f64 * STRAYS) as usize, "{what}: {strays} of {} are listed wrongly", on.len());
    let mut traced = Tally::new(format!("trace of eye paths, {what}"));
    for &slot in &listed {
        let i = slot as usize;
        let (hit, ray) = (hit_of(after.hits[i]), ray_of(after.origin[i], after.direction[i]));
        traced.check_hit(rig, &ray, hit, || format!("slot {slot}: {hit:?} of {ray:?}"));
    }
    traced.finish(STRAYS);
    for slot in (0..slots).filter(|s| !expected.contains_key(s)) {
        let i = slot as usize;
        if step == 0 && slot >= pixels && in_tile.binary_search(&(slot % pixels)).is_ok() {
            let nothing = after.throughput[i] == Vec4::ZERO && after.emitted[i] == Vec4::ZERO;
            assert!(nothing && untouched(after.hits[i]), "{what}: slot {slot} carries nothing");
        } else {
            assert!(before.bits(i) == after.bits(i), "{what}: slot {slot} is left alone");
        }
    }
}

/// Compares the list of tiles that show mirrors or glass.
fn check_tiles(rig: &Rig) {
    let List { entries: list, work } = &rig.frame().eye.ideal_tiles;
    let [width, height, pixels, _] = rig.parameters.size;
    let hits = rig.vec4s(&rig.frame().eye.rays.hits);
    let ideal = |hit: &Vec4| {
        hit_of(*hit).is_some_and(|hit| {
            let material = rig.bvh().material(hit.triangle) as usize;
            let m = &rig.scene.materials[material];
            let whole = Reflectance::new(m.base_color, m.metallic, m.roughness, m.specular);
            let along = whole.alpha + (1.0 - whole.alpha) * m.anisotropy.powi(2);
            let other = m.phong_exponent.map_or((whole.alpha * along).sqrt(), |d| width_of(-d));
            let alpha = m.lobe.as_ref().map_or(other, |table| table.alpha());
            let narrow = m.metallic_roughness_texture.is_some() && m.lobe.is_none() || alpha <= MAX_FOLLOWED_ALPHA;
            let followed = rig.parameters.choice[3] > 0.0 && narrow && (whole.f90 > 0.0 || m.metallic > 0.0);
            m.surface != Surface::Opaque || rig.plane(&hit) > 0 || followed
        })
    };
    let ideal: Vec<bool> = hits[..pixels as usize].iter().map(ideal).collect();
    rig.run(|frame, rec| frame.eye.record_tiles(rec));
    let work: layout::DispatchCounts = rig.get(work)[0];
    let expected = tiles::reference([width, height], &ideal);
    assert_eq!(rig.get::<u32>(list)[..work.live as usize], expected, "{width}x{height}");
    let [x, y, z, _] = work.list_groups;
    assert!(x * y >= work.live && x * y < work.live + x.max(1) && z == 1, "{work:?}");
}

/// Runs the steps of the eye paths, comparing each.
fn follow(rig: &Rig, seen: &mut Seen) {
    let frame = rig.frame();
    let paths = &frame.eye.paths;
    rig.prefill(&[&frame.eye.rays.origin, &frame.eye.rays.direction, &frame.eye.rays.hits, &frame.eye.points.emitted]);
    rig.prefill(&[&paths.throughput, &paths.media]);
    rig.prefill(&[&paths.lobe_of]);
    rig.run(|frame, rec| frame.eye.record_first(rec));
    check_tiles(rig);
    for step in 0..frame.eye.lists.len() {
        check_step(rig, step, seen);
    }
    assert_eq!(rig.lost(), 0);
}

pub fn eye_paths_follow_their_oracle(bench: &Bench) {
    let scene = gallery_with_tables();
    let planes = Some(Superposition::default());
    let mut frosted = scene.clone();
    frosted.materials.iter_mut().filter(|m| m.thin).for_each(|m| m.frost = 0.5);
    let mut curved = scene.clone();
    curved.materials.iter_mut().filter(|m| m.may_reflect()).for_each(|m| m.reflector = Some(true));
    let cases = [
        (&scene, true, None),
        (&scene, false, None),
        (&scene, true, planes),
        (&frosted, true, planes),
        (&curved, true, planes),
    ];
    for (scene, split, superposition) in cases {
        let mut seen = Seen::default();
        for (i, resolution) in bench.images().enumerate() {
            let settings = Settings {
                particles: 1,
                max_specular: 5,
                split,
                superposition,
                reflectance: [Form::Schlick, Form::Fresnel, Form::Map][i % 3],
                seed: i as u64,
                ..Settings::plain()
            };
            let rig = bench.rig(scene, resolution, settings);
            assert_eq!(rig.frame().eye.lists.len(), 5);
            follow(&rig, &mut seen);
        }
        let all = [seen.first, seen.second, seen.stayed, seen.crossed, seen.within_two, seen.along_lobes];
        bench.covered(
            all.iter().all(|&n| n > 5)
                && [seen.split, seen.split_again].iter().all(|&n| (n > 5) == split)
                && seen.further > 0,
            format_args!("{seen:?}"),
        );
        bench.covered((seen.mirrored > 5) == superposition.is_some(), format_args!("{seen:?}"));
        bench.covered((seen.curved > 5) == std::ptr::eq(scene, &curved), format_args!("{seen:?}"));
    }
}

/// Many tiles, few of them marked: the list keeps their order across all stretches.
pub fn tiles_are_listed_in_order(bench: &Bench) {
    let scene = gallery_with_tables();
    for resolution in [[1, 1], [8, 513], [521, 9], [640, 200]] {
        let rig = bench.rig(&scene, resolution, Settings { particles: 1, ..Settings::plain() });
        rig.run(|frame, rec| frame.eye.record_first(rec));
        check_tiles(&rig);
    }
}

pub fn merge_adds_second_components_to_their_pixels(bench: &Bench) {
    for [width, height] in bench.images() {
        let size = (width * height) as usize;
        let s = Sheet::new(bench, [width, height], 1);
        let (r, n) = (&s.receivers, &mut bench.numbers(size as u32));
        // Every third second component is not lit, and its sums must be ignored.
        let lit = |i: u32| i % 3 != 2;
        let flags = |i: u32| ShadingPoints::word(if lit(i) { ShadingPoints::LIT } else { ShadingPoints::HIT });
        let kd = fill(bench, &r.kd, n, 1.0, |_| 1.0);
        fill(bench, &r.wo, n, 1.0, flags);
        let emitted = fill(bench, &r.emitted, n, 1.0, |_| 0.0);
        let through = fill(bench, &s.paths.throughput, n, 1.0, |_| 1.0);
        let light = [&s.sums.direct, &s.sums.indirect, &s.sums.specular].map(|b| fill(bench, b, n, 1.0, |_| 0.0));
        // Every other tile.
        let across = width.div_ceil(8);
        let tiles: Vec<u32> = (0..across * height.div_ceil(8)).step_by(2).collect();
        let live = tiles.len() as u32;
        let work = layout::DispatchCounts { live, list_groups: [live, 1, 1, 0], ..layout::DispatchCounts::default() };
        let list =
            List { entries: upload(bench, "tiles", &tiles).must(), work: upload(bench, "tile work", &[work]).must() };
        let shared = Resources::of([("frame", &s.frame)]);
        let pass = make(bench, shared, |kit| Merge::new(kit, r, &s.paths, &s.sums, &list, &r.emitted));
        bench.submit_and_wait("merge", None, |rec| pass.record(rec)).must();
        let found = download::<Vec4>(bench, &r.emitted).must();
        for i in 0..size {
            let (x, y, k) = (i as u32 % width, i as u32 / width, size + i);
            let is_lit = lit(k as u32);
            let light = light.each_ref().map(|l| if is_lit { l[k].truncate() } else { Vec3::ZERO });
            let vectors = [emitted[k], through[k], kd[k]].map(Vec4::truncate);
            let listed = (x / 8 + y / 8 * across) % 2 == 0;
            let more = merge::reference(vectors[0], vectors[1], vectors[2], light);
            let expected = emitted[i].truncate() + if listed { more } else { Vec3::ZERO };
            assert!(close(found[i].truncate(), expected, 1e-6, 0.0), "{x} {y}: {} for {expected}", found[i]);
            assert_eq!(found[k], emitted[k], "second component of {x} {y}");
        }
    }
}

pub fn third_components_join_second_ones(bench: &Bench) {
    let scene = gallery_with_tables();
    let (mut joined, mut marked) = (0, 0);
    for resolution in bench.images().chain([[97, 61], [160, 120]]) {
        let rig = bench.rig(&scene, resolution, Settings { particles: 3, ..Settings::plain() });
        rig.light();
        let (frame, pixels) = (rig.frame(), rig.parameters.size[2] as usize);
        let (points, lighting) = (&frame.eye.points, &frame.shade.lighting);
        let buffers = [&points.emitted, &frame.eye.paths.throughput, &points.kd, &points.wo];
        let [emitted, throughput, kd, wo] = buffers.map(|b| rig.vec4s(b));
        assert_eq!(emitted.len(), 3 * pixels, "the gallery has glass");
        let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
        rig.run(|frame, rec| frame.third_light.as_ref().unwrap().record(rec));
        let [after, wo_after] = [&points.emitted, &points.wo].map(|b| rig.vec4s(b));
        let listed = rig.ideal_pixels();
        let bits = |v: Vec4| v.to_array().map(f32::to_bits);
        for pixel in 0..pixels {
            let [second, third] = [1, 2].map(|component| pixel + component * pixels);
            if listed.binary_search(&(pixel as u32)).is_err() {
                assert_eq!(bits(after[second]), bits(emitted[second]), "pixel {pixel} is left alone");
                continue;
            }
            let lit = has(wo[third], ShadingPoints::LIT);
            let light = [0, 1, 2].map(|k| if lit { sums[k][third].truncate() } else { Vec3::ZERO });
            let of_path = [emitted[third], throughput[third], kd[third]].map(|v| v.truncate());
            let added = merge::reference(of_path[0], of_path[1], of_path[2], light);
            let (found, expected) = (after[second].truncate(), emitted[second].truncate() + added);
            assert!(close(found, expected, 1e-6, 1e-7), "pixel {pixel}: {found} for {expected}");
            joined += usize::from(added != Vec3::ZERO);
            let found_lamp = of_path[0] != Vec3::ZERO && has(wo[third], ShadingPoints::UNLIKELY | ShadingPoints::DEEP);
            let flags = |wo: &[Vec4]| ShadingPoints::flags(wo[second].w);
            let deep = if found_lamp { ShadingPoints::DEEP } else { 0 };
            assert_eq!(flags(&wo_after), flags(&wo) | deep, "pixel {pixel}");
            marked += usize::from(found_lamp);
        }
    }
    bench.covered(joined > 100 && marked > 0, format_args!("{joined} joined, {marked} marked"));
}

pub fn light_along_lobes_joins_its_pixel(bench: &Bench) {
    let scene = gallery_with_tables();
    let mut joined = 0;
    for resolution in bench.images() {
        let rig = bench.rig(&scene, resolution, Settings { particles: 3, ..Settings::plain() });
        rig.light();
        let (frame, pixels) = (rig.frame(), rig.parameters.size[2] as usize);
        let (points, lighting) = (&frame.eye.points, &frame.shade.lighting);
        let buffers = [&points.emitted, &frame.eye.paths.throughput, &points.kd, &points.wo];
        let [emitted, throughput, kd, wo] = buffers.map(|b| rig.vec4s(b));
        let sums = [&lighting.direct, &lighting.indirect, &lighting.specular].map(|b| rig.vec4s(b));
        rig.run(|frame, rec| frame.glossy_light.as_ref().unwrap().record(rec));
        let (specular, after) = (rig.vec4s(&lighting.specular), rig.vec4s(&frame.eye.paths.throughput));
        let mut tally = Tally::new(format!("glossy_light at {resolution:?}"));
        for pixel in 0..pixels {
            let follows = has(wo[pixel], ShadingPoints::LOBE_SAMPLED);
            if !follows || has(wo[pixel], ShadingPoints::SEEN_BY_SPECULAR) {
                let bits = |v: Vec4| v.to_array().map(f32::to_bits);
                tally.check(bits(specular[pixel]) == bits(sums[2][pixel]), || format!("pixel {pixel} is left alone"));
                continue;
            }
            let slot = pixel + pixels;
            let lit = has(wo[slot], ShadingPoints::LIT);
            let light = [0, 1, 2].map(|k| if lit { sums[k][slot].truncate() } else { Vec3::ZERO });
            let of_path = [emitted[slot], throughput[slot], kd[slot]].map(|v| v.truncate());
            let added = glossy_light::reference(of_path[0], of_path[1], of_path[2], light);
            let expected = sums[2][pixel].truncate() + added;
            let found = specular[pixel].truncate();
            tally.check(close(found, expected, 1e-5, 1e-7), || format!("pixel {pixel}: {found} for {expected}"));
            tally.check(after[slot].truncate() == Vec3::ZERO, || format!("pixel {pixel} has it twice"));
            joined += usize::from(added != Vec3::ZERO);
        }
        tally.finish(0.0);
    }
    bench.covered(joined > 100, format_args!("{joined}"));
}
