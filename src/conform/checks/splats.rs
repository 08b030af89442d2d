//! Splats from the emitters to the pixels against their oracles.

use crate::bsdf::ideal::Media;
use crate::bsdf::phong::width_of;
use crate::conform::Bench;
use crate::conform::tally::within;
use crate::pass::layout::{DispatchCounts, PointLight};
use crate::pass::splat_light::{self, Hit};
use crate::pass::splat_start::SplatState;
use crate::pass::surface::surface_at;
use crate::pass::{List, ShadingPoints, shade, splat_follow, splat_grid, splat_pack, splat_start, splat_width};
use crate::scene::Scene;
use crate::settings::{Settings, Splats};
use crate::stage::{self, Stage};
use glam::{Vec3, Vec4};

use super::light::{LOBE, receivers};
use crate::conform::rig::{
    Rig, SINE, STRAYS, Tally, close, gallery_outdoors, gallery_with_tables, has, hit_of, ray_of, sine_error,
};

/// Tolerance for a direction: refraction near the critical angle magnifies rounding.
const DIRECTION: f32 = 1e-3;
/// Tolerance for a direction that is stored in 28 bits.
const STORED: f32 = 4e-4;

fn splats<'a>(rig: &'a Rig) -> &'a stage::Splats {
    rig.frame().splats.as_ref().unwrap()
}

fn settings(particles: u32) -> Settings {
    let splats = Splats { particles, alpha: 0.05, ..Splats::default() };
    Settings { particles: 4, photons: 0, splats: Some(splats), seed: 3, ..Settings::plain() }
}

/// A hit as it is stored.
type Words = [[u32; 4]; 2];

/// The particles of a batch, read from the device.
struct State {
    origin: Vec<Vec4>,
    direction: Vec<Vec4>,
    hits: Vec<Vec4>,
    flux: Vec<Vec4>,
    media: Vec<[u32; 4]>,
}

impl State {
    fn of(rig: &Rig) -> State {
        let s = splats(rig);
        State {
            origin: rig.vec4s(&s.rays.origin),
            direction: rig.vec4s(&s.rays.direction),
            hits: rig.vec4s(&s.rays.hits),
            flux: rig.vec4s(&s.flux),
            media: rig.get(&s.media),
        }
    }
}

fn check_start(rig: &Rig, what: &str, sine: f32) {
    let s = splats(rig);
    rig.prefill(&[&s.rays.origin, &s.rays.direction, &s.rays.hits, &s.flux, &s.media]);
    rig.run(|frame, rec| {
        let splats = frame.splats.as_ref().unwrap();
        splats.record_clear(rec, &rig.parameters)?;
        splats.record_start(rec, 0)
    });
    let state = State::of(rig);
    let mut tally = Tally::new(format!("splat_start, {what}"));
    let mut traced = Tally::new(format!("trace of splats, {what}"));
    for i in 0..s.plan.batch as usize {
        let emitters = (rig.engine.emitters(), &rig.scene.textures[..]);
        let (expected, sent) = splat_start::reference(&rig.parameters, emitters, i as u32);
        let (ray, flux) = (ray_of(state.origin[i], state.direction[i]), state.flux[i].truncate());
        let same = close(ray.origin, expected.origin, 1e-5, 8.0 * sine)
            && close(ray.direction, expected.direction, 0.0, 2.0 * SINE)
            && ray.t_max == expected.t_max
            && close(flux, sent, 2.0 * SINE, 0.0);
        let values = [(ray.origin, expected.origin), (ray.direction, expected.direction), (flux, sent)];
        tally.check_values(same, &values, || format!("particle {i}: {ray:?} {flux} for {expected:?} {sent}"));
        traced.check_hit(rig, &ray, hit_of(state.hits[i]), || format!("particle {i}: {ray:?}"));
    }
    tally.finish(STRAYS);
    traced.finish(STRAYS);
}

/// Runs a step; counts particles absorbed, stored and continued.
fn check_step(rig: &Rig, what: &str, bounces: usize, seen: &mut [usize; 3]) {
    let s = splats(rig);
    let before = State::of(rig);
    let sorted = |list: &List| rig.sorted(list);
    let entering = match bounces.checked_sub(1) {
        None => (0..s.plan.batch).collect(),
        Some(last) => sorted(&s.lists[last]),
    };
    rig.run(|frame, rec| frame.splats.as_ref().unwrap().record_step(rec, bounces));
    let after = State::of(rig);
    let listed = sorted(&s.lists[bounces]);
    let fresh: Vec<Words> = rig.get(&s.fresh);
    let surface_of: Vec<u32> = rig.get(&rig.engine.device_scene().surfaces.as_ref().unwrap().of_triangle);
    let last = bounces + 1 == s.lists.len();
    let mut tally = Tally::new(format!("splat_follow, {what}, bounces {bounces}"));
    for &particle in &entering {
        let i = particle as usize;
        let flux = before.flux[i].truncate();
        let on = listed.binary_search(&particle).is_ok();
        let slot = bounces.checked_sub(1).map(|step| step * s.plan.batch as usize + i);
        let stored = slot.map(|slot| Hit::of(fresh[slot])).filter(|hit| hit.surface > 0);
        let Some(hit) = hit_of(before.hits[i]) else {
            tally.check(!on && stored.is_none(), || format!("particle {particle} left the scene"));
            continue;
        };
        let d = before.direction[i].truncate();
        let surface = surface_at(rig.scene, rig.bvh(), &hit, d, rig.parameters.cones[1] * hit.t);
        let number = surface_of[hit.triangle as usize];
        let keeps = bounces > 0 && number > 0 && surface.reflectance.f90 > 0.0;
        let stores = match stored {
            None => !keeps,
            Some(found) => {
                keeps
                    && (found.surface, found.bounces) == (number, bounces as u32)
                    && close(found.position, surface.position, 1e-5, 1e-6)
                    && close(found.wi, -d, 0.0, STORED)
                    && found.flux == flux
            }
        };
        seen[1] += usize::from(stored.is_some());
        let media = if bounces == 0 { Media::default() } else { Media(before.media[i]) };
        let way = (particle, bounces as u32);
        let next = splat_follow::reference(&rig.parameters, rig.scene, way, (d, flux, media), &surface);
        let next = next.filter(|_| !last);
        let same = match &next {
            None => !on,
            Some((ray, sent, media)) => {
                let found = ray_of(after.origin[i], after.direction[i]);
                on && close(found.origin, ray.origin, 1e-5, 1e-6)
                    && close(found.direction, ray.direction, 0.0, DIRECTION)
                    && close(after.flux[i].truncate(), *sent, 10.0 * DIRECTION, 0.0)
                    && Media(after.media[i]) == *media
            }
        };
        seen[if next.is_some() { 2 } else { 0 }] += 1;
        let values = next
            .as_ref()
            .map(|(ray, sent, _)| [(after.flux[i].truncate(), *sent), (after.direction[i].truncate(), ray.direction)]);
        tally.check_values(same && stores, values.as_ref().map_or(&[][..], |values| values), || {
            format!("particle {particle}: on {on}, stored {stored:?}, {} for {next:?}", after.flux[i])
        });
    }
    tally.finish(STRAYS);
}

/// Stores the hits, finds their widths and sorts them; returns them, and h of each surface.
fn check_grid(rig: &Rig, what: &str) -> (Vec<Hit>, Vec<f32>) {
    let s = splats(rig);
    let parameters = s.plan.parameters();
    let fresh: Vec<Words> = rig.get(&s.fresh);
    let mut state = rig.get::<SplatState>(&s.state)[0];
    let mut expected = Vec::new();
    splat_pack::reference(&parameters, &mut state, &mut expected, &fresh);
    rig.run(|frame, rec| {
        let splats = frame.splats.as_ref().unwrap();
        splats.record_pack(rec)?;
        splats.record_grid(rec)
    });
    assert_eq!(rig.get::<SplatState>(&s.state)[0], state, "{what}: counts");
    let hits: Vec<Words> = rig.get::<Words>(&s.hits)[..expected.len()].to_vec();
    assert!(hits == expected, "{what}: hits are stored in the order of their slots");

    let surfaces = rig.engine.device_scene().surfaces.clone().unwrap();
    let records: Vec<[u32; 4]> = rig.get(&surfaces.records);
    let (counts, width): (Vec<u32>, Vec<f32>) = (rig.get(&s.surface_hits), rig.get(&s.width));
    for (i, &h) in width.iter().enumerate() {
        let on = hits.iter().filter(|hit| hit[0][3] == i as u32 + 1).count() as u32;
        let wanted = splat_width::reference(parameters.width, f32::from_bits(records[i][0]), on);
        assert!(counts[i] == on && within(h - wanted, 1e-5 * wanted), "{what}: surface {i}: {h} for {wanted}");
    }
    let read: Vec<Hit> = hits.iter().map(|&words| Hit::of(words)).collect();
    let places: Vec<(Vec3, u32, f32)> =
        read.iter().map(|hit| (hit.position, hit.surface, width[hit.surface as usize - 1])).collect();
    let order = splat_grid::reference(&parameters, &places);
    let (sorted, buckets): (Vec<Words>, Vec<[u32; 2]>) = (rig.texels(&s.grid.hits), rig.get(&s.grid.buckets));
    let mut cells = Tally::new(format!("splat_grid, {what}"));
    let mut found = 0;
    for (i, &from) in order.iter().enumerate() {
        let (position, surface, h) = places[from as usize];
        let code = splat_grid::code_of(splat_grid::cell_of(position, h), surface);
        let [at, arrival] = sorted[i];
        // A quotient may be rounded the other way at a boundary of cells.
        cells.check(
            at[3] == code && at[..3] == hits[from as usize][0][..3] && arrival == hits[from as usize][1],
            || format!("place {i}: {at:?} for hit {from}"),
        );
    }
    for [first, end] in buckets {
        found += end - first;
    }
    assert_eq!(found as usize, hits.len(), "{what}: hits in buckets");
    cells.finish(STRAYS);
    (read, width)
}

/// Lights the image; returns the number of points that splats light.
fn check_light(rig: &Rig, what: &str, hits: &[Hit], width: &[f32]) -> usize {
    rig.walk_and_look();
    let s = splats(rig);
    let eye_hits = rig.vec4s(&rig.frame().eye.rays.hits);
    rig.run(|_, rec| s.record_find(rec));
    rig.run(|frame, rec| frame.shade.record(rec));
    let specular = || rig.vec4s(&rig.frame().shade.lighting.specular);
    let before = specular();
    rig.run(|frame, rec| frame.splats.record(rec));
    assert_eq!(rig.lost(), 0, "{what}");
    let after = specular();
    let state = rig.get::<SplatState>(&s.state)[0];
    let surfaces = rig.engine.device_scene().surfaces.clone().unwrap();
    let (records, of_triangle): (Vec<[u32; 4]>, Vec<u32>) =
        (rig.get(&surfaces.records), rig.get(&surfaces.of_triangle));
    let edges: Vec<[[f32; 4]; 2]> = rig.get(&surfaces.edges);
    let r = &rig.frame().eye.points;
    let (receivers, wo) = (receivers(rig, r), rig.vec4s(&r.wo));
    let lights: Vec<PointLight> = rig.get(rig.frame().lights());
    let mut highlights = Tally::new(format!("highlights beside splats, {what}"));
    let mut tally = Tally::new(format!("splat_light, {what}"));
    let mut lit = 0;
    for slot in rig.list(0) {
        let i = slot as usize;
        let receiver = receivers[i];
        let reflectance = receiver.reflectance;
        let flags = ShadingPoints::flags(wo[i].w);
        let shows = has(wo[i], ShadingPoints::SPLATS);
        let sampled = has(wo[i], ShadingPoints::LOBE_SAMPLED);
        let lobe = has(wo[i], ShadingPoints::GLOSSY) && !sampled && width_of(reflectance.alpha) > s.plan.settings.alpha;
        assert_eq!(shows, lobe, "{what}: slot {slot}, {reflectance:?}");
        if shows && ShadingPoints::segments(flags) == 0 {
            // Of direct light alone.
            let (clip2, far) = (rig.parameters.right[3], rig.parameters.forward[3]);
            let wanted = shade::reference(rig.scene, rig.bvh(), &receiver, &lights, clip2, far)[2];
            let found = before[i].truncate();
            highlights.check_values(close(found, wanted, LOBE, 1e-9), &[(found, wanted)], || {
                format!("slot {slot}: {found} for {wanted}")
            });
        }
        let surface = hit_of(eye_hits[i]).map_or(0, |hit| of_triangle[hit.triangle as usize]);
        let mut wanted = Vec3::ZERO;
        if shows && surface > 0 && width[surface as usize - 1] > 0.0 {
            let h = width[surface as usize - 1];
            let [_, first, end, _] = records[surface as usize - 1].map(|n| n as usize);
            let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
            let outline: Vec<[Vec3; 2]> = edges[first..end].iter().map(|edge| edge.map(xyz)).collect();
            let covered = splat_light::coverage(receiver.position, receiver.geometric, &outline, h);
            let segments = ShadingPoints::segments(flags);
            let on = (surface, h, covered);
            wanted = splat_light::reference(
                &rig.parameters,
                &rig.scene.materials,
                (&receiver, segments),
                on,
                hits,
                state.particles,
            );
        }
        let found = (after[i] - before[i]).truncate();
        let rounding = 1e-5 * before[i].truncate().max_element();
        tally.check_values(close(found, wanted, 3e-3, rounding), &[(found, wanted)], || {
            format!("slot {slot}, surface {surface}: {found} for {wanted}")
        });
        lit += usize::from(found != Vec3::ZERO);
    }
    tally.finish(STRAYS);
    highlights.finish(STRAYS);
    lit
}

fn follow(bench: &Bench, scene: &Scene, size: [u32; 2], settings: Settings, sine: f32, seen: &mut [usize; 3]) -> usize {
    let what = format!("{} particles, {size:?}", settings.splats.unwrap().particles);
    let rig = bench.rig(scene, size, settings);
    check_start(&rig, &what, sine);
    (0..splats(&rig).lists.len()).for_each(|bounces| check_step(&rig, &what, bounces, seen));
    let (hits, width) = check_grid(&rig, &what);
    check_light(&rig, &what, &hits, &width)
}

pub fn splats_against_their_oracles(bench: &Bench) {
    let scene = gallery_with_tables();
    let sine = sine_error(bench, &scene);
    let (mut seen, mut lit) = ([0; 3], 0);
    for (particles, size) in bench.sizes().zip(bench.images().cycle().skip(1)) {
        lit += follow(bench, &scene, size, settings(particles as u32), sine, &mut seen);
    }
    let outdoors = gallery_outdoors();
    let sine = sine_error(bench, &outdoors);
    for size in [[31, 17], [29, 19], [41, 13]] {
        lit += follow(bench, &outdoors, size, settings(500), sine, &mut seen);
    }
    bench.covered(
        seen.iter().all(|&n| n > 50) && lit > 300,
        format_args!("absorbed, stored, continued: {seen:?}; lit {lit}"),
    );
}

pub fn a_batch_whose_hits_do_not_fit_is_left_out_whole(bench: &Bench) {
    let scene = gallery_with_tables();
    let rig = bench.rig(&scene, [1, 1], settings(2049));
    let s = splats(&rig);
    let mut parameters = s.plan.parameters();
    rig.run(|_, rec| s.record_clear(rec, &rig.parameters));
    rig.run(|_, rec| s.record_batch(rec, 0));
    let first = rig.get::<SplatState>(&s.state)[0];
    assert!(first.full == 0 && first.particles == 2049, "{first:?}");
    bench.covered(first.hits > 20, format_args!("{first:?}"));
    let stored: Vec<Words> = rig.get(&s.hits);
    // The same batch again and again, until one does not fit.
    let mut hits = stored[..first.hits as usize].to_vec();
    let mut state = first;
    parameters.capacity = (s.hits.bytes() / 32) as u32;
    let fresh: Vec<Words> = rig.get(&s.fresh);
    for _ in 0..parameters.capacity / first.hits + 2 {
        rig.run(|_, rec| s.record_pack(rec));
        splat_pack::reference(&parameters, &mut state, &mut hits, &fresh);
        assert_eq!(rig.get::<SplatState>(&s.state)[0], state);
    }
    assert_eq!(state.full, 1);
    assert!(rig.get::<Words>(&s.hits)[..hits.len()] == hits[..], "what is stored is not touched");
    // Nothing starts any more.
    rig.run(|_, rec| s.record_start(rec, 0));
    assert!(rig.vec4s(&s.rays.origin).iter().all(|origin| origin.w == 0.0));
    rig.run(|_, rec| s.record_grid(rec));
    assert_eq!(rig.get::<DispatchCounts>(&s.grid.list.work)[0].live, state.hits);
}

pub fn each_class_of_pixels_takes_splats_in_one_of_as_many_passes(bench: &Bench) {
    let scene = gallery_with_tables();
    let light = |pattern: [u32; 2], local: u32| {
        let rig = bench.rig(&scene, [31, 17], Settings { pattern, ..settings(500) });
        let s = splats(&rig);
        // Another pass in which the eye sees the same.
        let mut parameters = rig.parameters;
        parameters.size[3] = local;
        rig.run(|frame, rec| {
            frame.record_start(rec, &parameters)?;
            s.record_particles(rec, &parameters)?;
            frame.walk.record(rec)?;
            frame.eye.record(rec)?;
            s.record_find(rec)?;
            rec.fill(&frame.shade.lighting.specular, 0)?;
            s.record(rec)
        });
        rig.vec4s(&rig.frame().shade.lighting.specular)
    };
    let whole = light([1, 1], 0);
    let parts: Vec<Vec<Vec4>> = [0, 1].into_iter().map(|local| light([2, 1], local)).collect();
    let mut lit = 0;
    for (i, all) in whole.iter().map(|l| l.truncate()).enumerate() {
        let [one, other] = [0, 1].map(|k| parts[k][i].truncate());
        assert!(one == Vec3::ZERO || other == Vec3::ZERO, "slot {i}: {one}, {other}");
        assert!(close((one + other) / 2.0, all, 1e-4, 0.0), "slot {i}: {one}, {other} for {all}");
        lit += usize::from(all != Vec3::ZERO);
    }
    bench.covered(lit > 50 && parts[0] != parts[1], format_args!("{lit}"));
}
