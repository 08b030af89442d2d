//! Caustic photons from the emitters to the pixels against their oracles.

use crate::bsdf::Reflectance;
use crate::bsdf::ideal::Media;
use crate::conform::tally::within;
use crate::conform::{Bench, Must};
use crate::gpu::Staging;
use crate::pass::caustics::SHARP;
use crate::pass::layout::{DispatchCounts, FrameParameters, PointLight};
use crate::pass::photon_follow::{self, Fate};
use crate::pass::photon_light::{self, Photon};
use crate::pass::photon_start::Started;
use crate::pass::shade::ShadingPoint;
use crate::pass::surface::surface_at;
use crate::pass::{ShadingPoints, photon_find, photon_grid, photon_lights, photon_radius, photon_start, photon_width};
use crate::scene::Scene;
use crate::settings::{Filter, Reflectance as Form, Sequence, Settings};
use crate::stage::{Photons, Stage};
use glam::{Vec3, Vec4};

use crate::conform::rig::{
    Rig, SINE, STRAYS, Tally, close, gallery_outdoors, gallery_with_tables, has, hit_of, ray_of, sine_error,
};

/// Tolerance for a direction: refraction near the critical angle magnifies rounding.
const DIRECTION: f32 = 1e-3;

fn photons<'a>(rig: &'a Rig) -> &'a Photons {
    rig.frame().photons.as_ref().unwrap()
}

/// The photons, read from the device.
struct State {
    origin: Vec<Vec4>,
    direction: Vec<Vec4>,
    hits: Vec<Vec4>,
    flux: Vec<Vec4>,
    media: Vec<[u32; 4]>,
    position: Vec<Vec4>,
    normal: Vec<Vec4>,
}

impl State {
    fn of(rig: &Rig) -> State {
        let p = photons(rig);
        State {
            origin: rig.vec4s(&p.rays.origin),
            direction: rig.vec4s(&p.rays.direction),
            hits: rig.vec4s(&p.rays.hits),
            flux: rig.vec4s(&p.flux),
            media: rig.get(&p.media),
            position: rig.vec4s(&p.position),
            normal: rig.vec4s(&p.normal),
        }
    }
}

/// The sums of the weights of lights.
fn check_weights(rig: &Rig, what: &str, lights: &[PointLight]) -> Vec<f32> {
    let sums: Vec<f32> = rig.get(&photons(rig).lights.sums);
    let p = &rig.parameters;
    let (classes, each, first) = (p.pattern[2], p.pattern[3], p.depths[1][1]);
    for class in 0..classes {
        let mut sum = 0.0;
        for i in (class * each + first)..(class + 1) * each {
            sum += f64::from(photon_lights::weight(p, &lights[i as usize], &rig.engine.device_scene().targets));
            let found = f64::from(sums[i as usize]);
            assert!(within(found - sum, 1e-4 * sum), "{what}: light {i}: {found} for {sum}");
        }
    }
    sums
}

/// Returns the number of photons from virtual lights.
fn check_start(rig: &Rig, what: &str, sine: f32) -> usize {
    let p = photons(rig);
    rig.prefill(&[&p.rays.origin, &p.rays.direction, &p.rays.hits, &p.flux, &p.position, &p.media, &p.normal]);
    rig.run(|frame, rec| {
        frame.walk.record(rec)?;
        frame.photons.as_ref().unwrap().record_start(rec)
    });
    let state = State::of(rig);
    let mut tally = Tally::new(format!("photon_start, {what}"));
    let mut traced = Tally::new(format!("trace of photons, {what}"));
    let targets = &rig.engine.device_scene().targets;
    let lights: Vec<PointLight> = rig.get(rig.frame().lights());
    let sums = check_weights(rig, what, &lights);
    let mut from_lights = 0;
    for i in 0..p.count as usize {
        let oracle = photon_start::reference(
            &rig.parameters,
            (rig.engine.emitters(), &rig.scene.textures),
            (&lights, &sums),
            targets,
            i as u32,
        );
        let (ray, flux) = (ray_of(state.origin[i], state.direction[i]), state.flux[i]);
        let same = match oracle {
            None => ray.t_max == 0.0 && flux.truncate() == Vec3::ZERO,
            Some(Started { ray: expected, flux: expected_flux, aim, bounces }) => {
                from_lights += usize::from(bounces > 0.0);
                state.direction[i].w == bounces
                    && close(ray.origin, expected.origin, 1e-5, 8.0 * sine)
                    && ray.t_max == expected.t_max
                    && close(ray.direction, expected.direction, 0.0, 4.0 * SINE)
                    && close(flux.truncate(), expected_flux, 4.0 * SINE, 0.0)
                    && flux.w.to_bits() == aim
            }
        };
        let (origin, sent) = oracle.as_ref().map_or((Vec3::ZERO, Vec3::ZERO), |o| (o.ray.origin, o.flux));
        let direction = oracle.as_ref().map_or(Vec3::ZERO, |o| o.ray.direction);
        let values = [(ray.origin, origin), (ray.direction, direction), (flux.truncate(), sent)];
        // Photons without flux may hold any ray.
        let values = if ray.t_max > 0.0 { &values[..] } else { &[] };
        tally.check_values(same, values, || format!("photon {i}: {ray:?} {flux} for {oracle:?}"));
        assert_eq!(state.position[i], Vec4::ZERO, "{what}: photon {i} is not stored yet");
        if ray.t_max > 0.0 {
            traced.check_hit(rig, &ray, hit_of(state.hits[i]), || format!("photon {i}: {ray:?}"));
        }
    }
    // A cone's solid angle contains the sine of its angle: the flux of three photons of 2039 is 0.3 % off on SwiftShader.
    tally.finish(2.0 * STRAYS);
    traced.finish(STRAYS);
    from_lights
}

/// Runs a step; adds to the numbers of photons lost, stored and continued.
fn check_step(rig: &Rig, what: &str, step: usize, seen: &mut [usize; 4]) {
    let p = photons(rig);
    let before = State::of(rig);
    let sorted = |list: &crate::pass::List| {
        let live = rig.get::<DispatchCounts>(&list.work)[0].live as usize;
        let mut slots: Vec<u32> = rig.get(&list.entries);
        slots.truncate(live);
        slots.sort_unstable();
        slots
    };
    let entering = match step.checked_sub(1) {
        None => (0..p.count).collect(),
        Some(last) => sorted(&p.lists[last]),
    };
    rig.run(|frame, rec| frame.photons.as_ref().unwrap().record_step(rec, step));
    let (after, listed) = (State::of(rig), sorted(&p.lists[step]));
    let last = step + 1 == p.lists.len();
    let mut tally = Tally::new(format!("photon_follow, {what}, step {step}"));
    for &photon in &entering {
        let i = photon as usize;
        let flux = before.flux[i];
        let hit = hit_of(before.hits[i]).filter(|_| flux.truncate() != Vec3::ZERO);
        let fate = hit.map_or(Fate::Lost, |hit| {
            let d = before.direction[i].truncate();
            let surface = surface_at(rig.scene, rig.bvh(), &hit, d, rig.parameters.cones[1] * hit.t);
            let aimed = rig.engine.device_scene().targets.meets(flux.w.to_bits(), hit.triangle);
            let media = if step == 0 { Media::default() } else { Media(before.media[i]) };
            let state = (d, flux.truncate(), media);
            let number = (step as u32, last);
            let way = (aimed, before.direction[i].w);
            photon_follow::reference(&rig.parameters, rig.scene, number, photon, state, &surface, way)
        });
        let stored = after.position[i].w == 1.0;
        let on = listed.binary_search(&photon).is_ok();
        let same = match &fate {
            Fate::Lost => !stored && !on,
            Fate::Stored(expected) => {
                let place = rig.bvh().position(&hit.unwrap());
                stored
                    && !on
                    && close(after.flux[i].truncate(), *expected, DIRECTION, 0.0)
                    && close(after.position[i].truncate(), place, 1e-5, 1e-6)
                    && after.normal[i].truncate().dot(before.direction[i].truncate()) < 0.0
                    && after.direction[i] == before.direction[i]
            }
            Fate::Flies(ray, expected, media) => {
                let found = ray_of(after.origin[i], after.direction[i]);
                !stored
                    && on
                    && close(found.origin, ray.origin, 1e-5, 1e-6)
                    && close(found.direction, ray.direction, 0.0, DIRECTION)
                    && close(after.flux[i].truncate(), *expected, 10.0 * DIRECTION, 0.0)
                    && Media(after.media[i]) == *media
            }
        };
        seen[match fate {
            Fate::Lost => 0,
            Fate::Stored(_) => 1,
            Fate::Flies(..) => 2,
        }] += 1;
        let values = match &fate {
            Fate::Lost => [(Vec3::ZERO, Vec3::ZERO); 2],
            Fate::Stored(sent) => [(after.flux[i].truncate(), *sent), (Vec3::ZERO, Vec3::ZERO)],
            Fate::Flies(ray, sent, _) => {
                [(after.flux[i].truncate(), *sent), (after.direction[i].truncate(), ray.direction)]
            }
        };
        tally.check_values(same, &values, || {
            format!("photon {photon}: stored {stored}, on {on}, {} {} for {fate:?}", after.direction[i], after.flux[i])
        });
    }
    tally.finish(STRAYS);
}

/// The stored photons and their positions.
fn stored(positions: &[Option<Vec3>]) -> Vec<(u32, Vec3)> {
    (0..).zip(positions).filter_map(|(photon, position)| position.map(|at| (photon, at))).collect()
}

/// Sorts the photons; returns the stored ones in grid order.
fn check_grid(rig: &mut Rig, what: &str) -> Vec<Photon> {
    let g = &photons(rig).grid;
    rig.prefill(&[&g.position, &g.normal, &g.wi, &g.flux, &g.buckets]);
    rig.run(|frame, rec| frame.photons.as_ref().unwrap().record_grid(rec));
    let state = State::of(rig);
    let positions: Vec<Option<Vec3>> = state.position.iter().map(|v| (v.w == 1.0).then_some(v.truncate())).collect();
    let radius = photon_radius::reference(&rig.parameters, positions.iter().flatten().count());
    let found = rig.get::<FrameParameters>(&rig.frame().parameters)[0].photon;
    assert!(radius.iter().zip(found).all(|(a, b)| within(a - b, 1e-5 * a.abs())), "{what}: {found:?} for {radius:?}");
    rig.parameters.photon = found;
    let g = &photons(rig).grid;
    let order = photon_grid::reference(&rig.parameters, &positions);
    assert_eq!(
        rig.get::<DispatchCounts>(&g.list.work)[0].live,
        order.len() as u32,
        "{what}: stored photons are counted"
    );
    let [position, normal, wi, flux] = [&g.position, &g.normal, &g.wi, &g.flux].map(|b| rig.vec4s(b));
    let buckets: Vec<[u32; 2]> = rig.get(&g.buckets);
    let mut counted = vec![[0, 0]; buckets.len()];
    let sorted = order.iter().enumerate().map(|(i, &photon)| {
        let from = photon as usize;
        let place = state.position[from].truncate();
        let (code, bucket) = photon_grid::place_of(&rig.parameters, photon, place);
        assert_eq!((position[i].truncate(), position[i].w.to_bits()), (place, code), "{what}: place {i}");
        assert_eq!(
            (flux[i], normal[i].truncate()),
            (state.flux[from].truncate().extend(state.direction[from].w), state.normal[from].truncate()),
            "{what}: place {i}"
        );
        assert_eq!(wi[i].truncate(), -state.direction[from].truncate(), "{what}: place {i}");
        let bounds = &mut counted[bucket as usize];
        *bounds = [if bounds[1] == 0 { i as u32 } else { bounds[0] }, i as u32 + 1];
        let class = photon_grid::class_of(&rig.parameters, photon);
        assert_eq!(normal[i].w.to_bits(), class, "{what}: class of place {i}");
        let without_area = flux[i].w == photon_start::WITHOUT_AREA;
        let [normal, wi, flux] = [normal[i], wi[i], flux[i]].map(Vec4::truncate);
        Photon { position: place, normal, wi, flux, narrowing: 1.0, class, without_area }
    });
    let sorted = sorted.collect();
    assert!(buckets == counted, "{what}: first and end of each bucket");
    let mut bits = vec![0; (g.near.bytes() / 4) as usize];
    for (photon, position) in stored(&positions) {
        for bit in photon_grid::near_bits(&rig.parameters, photon, position) {
            bits[bit as usize / 32] |= 1 << (bit % 32);
        }
    }
    assert!(rig.get::<u32>(&g.near) == bits, "{what}: bits of the look-ups");
    sorted
}

/// Lights the image; returns the number of points that photons light, diffusely and by a lobe.
fn check_light(rig: &Rig, what: &str, mut photons: Vec<Photon>, narrowed: &mut usize) -> [usize; 3] {
    rig.light();
    let frame = rig.frame();
    let sums = || [&frame.shade.lighting.indirect, &frame.shade.lighting.specular].map(|b| rig.vec4s(b));
    let before = sums();
    rig.run(|frame, rec| frame.photon_lighting.record(rec));
    assert_eq!(rig.lost(), 0, "{what}");
    let after = sums();
    let around: Vec<f32> = photons.iter().map(|own| photon_width::around(&rig.parameters, own, &photons)).collect();
    let mut widths = Tally::new(format!("photon_width, {what}"));
    for (i, (photon, wi)) in photons.iter_mut().zip(rig.vec4s(&self::photons(rig).grid.wi)).enumerate() {
        let expected = photon_width::narrowing(&rig.parameters, photon, around[i]);
        widths.check(close(Vec3::splat(wi.w), Vec3::splat(expected), 1e-4, 0.0), || {
            format!("{i}: {} for {expected}", wi.w)
        });
        photon.narrowing = wi.w;
        *narrowed += usize::from(wi.w >= SHARP);
    }
    widths.finish(STRAYS);
    let r = &frame.eye.points;
    let [position, geometric, shading, f0, wo] =
        [&r.position, &r.geometric, &r.shading, &r.f0, &r.wo].map(|b| rig.vec4s(b));
    let of_photons = State::of(rig).position.into_iter().map(|v| (v.w == 1.0).then_some(v.truncate()));
    let of_photons = stored(&of_photons.collect::<Vec<_>>());
    let listed: Vec<(u32, Vec3)> =
        rig.list(0).into_iter().map(|slot| (slot, position[slot as usize].truncate())).collect();
    let list = &frame.photon_lighting.as_ref().unwrap().found;
    let work = rig.get::<DispatchCounts>(&list.work)[0];
    let mut found = rig.get::<u32>(&list.entries)[..work.live as usize].to_vec();
    found.sort_unstable();
    assert_eq!(found, photon_find::reference(&rig.parameters, &listed, &of_photons), "{what}: receivers found");
    let mut tally = Tally::new(format!("photon_light, {what}"));
    let caustic = frame.photon_lighting.as_ref().unwrap().caustic.as_ref().map(|caustic| rig.vec4s(caustic));
    let mut lit = [0; 3];
    for slot in rig.list(0) {
        let i = slot as usize;
        let reflectance =
            Reflectance { kd: Vec3::ZERO, f0: f0[i].truncate(), f90: geometric[i].w, alpha: shading[i].w };
        let receiver = ShadingPoint {
            sampled: has(wo[i], ShadingPoints::LOBE_SAMPLED).then_some(rig.parameters.choice[2]),
            splats: false,
            position: position[i].truncate(),
            geometric: geometric[i].truncate(),
            shading: shading[i].truncate(),
            reflectance,
            wo: wo[i].truncate(),
        };
        let expected = photon_light::reference(&rig.parameters, &rig.scene.materials, slot, &receiver, &photons);
        for (k, sum) in expected.into_iter().enumerate() {
            let (found, rounding) = match (k, &caustic) {
                (2, None) => continue,
                // Third components are not filtered.
                (2, Some(caustic)) if i >= caustic.len() => continue,
                (2, Some(caustic)) => (caustic[i].truncate(), 0.0),
                _ => {
                    let rounding = 1e-5 * before[k][i].truncate().max_element();
                    ((after[k][i] - before[k][i]).truncate(), rounding)
                }
            };
            let left_out = k == 1 && reflectance.f90 == 0.0;
            let wanted = if left_out { Vec3::ZERO } else { sum };
            let values = [(found, wanted)];
            tally.check_values(close(found, wanted, 1e-3, rounding), &values, || {
                format!("slot {slot}, sum {k}: {found} for {wanted}")
            });
            lit[k] += usize::from(found != Vec3::ZERO);
        }
    }
    tally.finish(STRAYS);
    lit
}

/// Shoots, follows, sorts and looks up the photons of these settings.
fn follow(
    bench: &Bench,
    scene: &Scene,
    size: [u32; 2],
    settings: Settings,
    sine: f32,
    (seen, narrowed): (&mut [usize; 4], &mut usize),
) -> [usize; 3] {
    let what = format!("{} photons, {size:?}, pattern {:?}", settings.photons, settings.pattern);
    let mut rig = bench.rig(scene, size, settings);
    seen[3] += check_start(&rig, &what, sine);
    for step in 0..photons(&rig).lists.len() {
        check_step(&rig, &what, step, seen);
    }
    let stored = check_grid(&mut rig, &what);
    check_light(&rig, &what, stored, narrowed)
}

pub fn photons_from_an_environment_follow_their_oracles(bench: &Bench) {
    let scene = gallery_outdoors();
    let sine = sine_error(bench, &scene);
    let settings = Settings {
        photons: 8191,
        particles: 4,
        max_specular: 5,
        mirror_lights: 0,
        photon_radius: Some(0.3),
        ..Settings::plain()
    };
    let (mut seen, mut narrowed) = ([0; 4], 0);
    let lit = follow(bench, &scene, [31, 17], settings, sine, (&mut seen, &mut narrowed));
    bench.covered(seen.iter().all(|&n| n > 10) && lit[..2].iter().all(|&n| n > 0), format_args!("{seen:?} {lit:?}"));
}

pub fn photons_follow_their_oracles(bench: &Bench) {
    let scene = gallery_with_tables();
    let sine = sine_error(bench, &scene);
    let (mut seen, mut narrowed, mut lit) = ([0; 4], 0, [0; 3]);
    let base = Settings {
        reflectance: Form::Fresnel,
        particles: 4,
        max_specular: 5,
        mirror_lights: 0,
        glossy_paths: false,
        photon_radius: Some(0.3),
        ..Settings::plain()
    };
    for photons in bench.sizes() {
        let settings = Settings { photons: photons as u32, seed: photons as u64, ..base.clone() };
        lit = follow(bench, &scene, [31, 17], settings, sine, (&mut seen, &mut narrowed));
    }
    log::info!("lost, stored, gone on, from lights: {seen:?}; receivers lit diffusely and by a lobe: {lit:?}");
    bench.covered(seen.iter().all(|&n| n > 100) && lit[..2].iter().all(|&n| n > 10), format_args!("{seen:?} {lit:?}"));
    // The other sequence; paths along lobes.
    let settings = Settings { photons: 341, sequence: Sequence::Sobol, glossy_paths: true, ..base.clone() };
    follow(bench, &scene, [31, 17], settings, sine, (&mut seen, &mut narrowed));
    // Classes, and photons that are looked up in 13 ranges.
    let settings = Settings { photons: 341, pattern: [3, 2], loop_budget: 1152, rounds: 100, ..base.clone() };
    lit = follow(bench, &scene, [31, 17], settings.clone(), sine, (&mut seen, &mut narrowed));
    bench.covered(lit[0] > 10, format_args!("{lit:?}"));
    // Numbers of pixels and of photons that fill no workgroup, each alone and in classes.
    lit = [0; 3];
    for size in bench.images() {
        for settings in [Settings { photons: 2039, seed: 5, ..base.clone() }, settings.clone()] {
            let more = follow(bench, &scene, size, settings, sine, (&mut seen, &mut narrowed));
            lit = [0, 1, 2].map(|k| lit[k] + more[k]);
        }
    }
    bench.covered(lit[..2].iter().all(|&n| n > 100), format_args!("{lit:?}"));
    // Footprints by the photons around, which all classes share; some are caustics, which the filter does not average.
    assert_eq!(narrowed, 0, "a radius of one's own is kept");
    lit = [0; 3];
    for (photons, pattern, size) in [(16381, [1, 1], [61, 47]), (2039, [3, 2], [97, 61])] {
        let shared = Settings {
            photons,
            pattern,
            photon_radius: None,
            interleave_photons: false,
            filter: Some(Filter::default()),
            ..base.clone()
        };
        let stretches = Settings { loop_budget: 1152, rounds: 100, ..shared.clone() };
        for settings in [shared, stretches] {
            let more = follow(bench, &scene, size, settings, sine, (&mut seen, &mut narrowed));
            lit = [0, 1, 2].map(|k| lit[k] + more[k]);
        }
    }
    bench.covered(lit.iter().all(|&n| n > 10), format_args!("{lit:?}"));
    log::info!("{narrowed} photons narrower than the radius");
    bench.covered(narrowed > 50, format_args!("{narrowed} photons are narrower than the radius"));
}

pub fn caustics_are_kept_out_of_the_filters(bench: &Bench) {
    let scene = gallery_with_tables();
    let mut numbers = bench.numbers(11);
    let (mut kept, mut left) = ([0; 2], 0);
    for resolution in bench.images().chain([[97, 61]]) {
        let settings = Settings {
            photons: 2,
            particles: 3,
            interleave_photons: false,
            filter: Some(Filter::default()),
            ..Settings::plain()
        };
        let rig = bench.rig(&scene, resolution, settings);
        rig.light();
        let frame = rig.frame();
        let caustics = frame.caustics.as_ref().unwrap();
        // Light at one slot of three.
        let slots = 0..caustics.caustic.bytes() / 16;
        let caustic: Vec<Vec3> = slots.map(|slot| if slot % 3 == 0 { numbers.vec3() } else { Vec3::ZERO }).collect();
        let words: Vec<Vec4> = caustic.iter().map(|light| light.extend(0.0)).collect();
        let mut staging = Staging::new();
        staging.stage_into(bench, &caustics.caustic, 0, &words).must();
        rig.run(|_, rec| staging.record(rec));
        let (raw, filtered) =
            (&frame.shade.lighting.indirect, &frame.discontinuity.as_ref().unwrap().filtered.indirect);
        let before = rig.vec4s(raw);
        rig.run(|frame, rec| {
            frame.caustics.as_ref().unwrap().run_take(rec)?;
            frame.discontinuity.run(rec)
        });
        let (taken, averaged) = (rig.vec4s(raw), rig.vec4s(filtered));
        rig.run(|frame, rec| frame.caustics.as_ref().unwrap().run_add(rec));
        let (given, after) = (rig.vec4s(raw), rig.vec4s(filtered));
        let bits = |v: Vec4| v.to_array().map(f32::to_bits);
        for (slot, caustic) in caustic.into_iter().enumerate() {
            let light = caustic.extend(0.0);
            // Slots without light may hold any value.
            let of = |sum: Vec4, light: Vec4| if light == Vec4::ZERO { sum } else { sum + light };
            assert_eq!(bits(taken[slot]), bits(of(before[slot], -light)), "{resolution:?}, slot {slot}: taken");
            assert_eq!(bits(given[slot]), bits(of(taken[slot], light)), "{resolution:?}, slot {slot}: given back");
            assert_eq!(bits(after[slot]), bits(of(averaged[slot], light)), "{resolution:?}, slot {slot}: added");
            match light == Vec4::ZERO {
                true => left += 1,
                false => kept[usize::from(slot >= rig.parameters.size[2] as usize)] += 1,
            }
        }
    }
    bench.covered(kept.iter().all(|&n| n > 10) && left > 100, format_args!("{kept:?}, {left}"));
}
