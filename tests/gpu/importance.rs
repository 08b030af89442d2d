//! The choice of emitters by contribution: the pass against its oracle, the walk that follows it, and its effect on
//! images.

use std::collections::HashSet;

use glam::Vec3;
use lightsum::light::emitters::{EmitterRecord, Emitters};
use lightsum::pass::importance::{probes, reference};
use lightsum::pass::layout::PointLight;
use lightsum::pass::walk_start;
use lightsum::scene::{Light, Material, Scene};
use lightsum::settings::{Clip, LightChoice, Settings};
use lightsum::stage::Stage;

use crate::passes_light::receivers;
use crate::passes_walk::{of_lights, same_light};
use crate::renderer::cornell;
use crate::rig::{AWKWARD_IMAGES, Builder, Numbers, Rig, SINE, STRAYS, Tally, is_lit, xyz};
use crate::scenes::{Soup, camera, compare, mean, render, settings};
use crate::support::{AWKWARD_SIZES, gpu_test};

fn by_contribution(settings: Settings) -> Settings {
    Settings { light_choice: LightChoice::Contribution, ..settings }
}

/// A floor under `count` emitters: triangles, parallelograms, and if there is room, one of each kind of scene light.
fn lamps(count: usize) -> Scene {
    let mut b = Builder::default();
    let mut numbers = Numbers(5);
    let floor = b.material(Material {
        base_color: Vec3::new(0.7, 0.5, 0.3),
        specular: Vec3::splat(0.1),
        ..Material::default()
    });
    let glow = |two_sided: bool| Material { emission: Vec3::new(3.0, 2.0, 1.0), two_sided, ..Material::default() };
    let materials = [false, true].map(|two_sided| b.material(glow(two_sided)));
    let narrow = b.material(Material { emission_exponent: 7.5, ..glow(true) });
    b.quad(Vec3::new(-4.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::X * 8.0, floor, 1.0);
    let listed = if count > 10 { 6 } else { 0 };
    for i in 0..count - listed {
        let at = numbers.vec3() * Vec3::new(8.0, 2.0, 8.0) - Vec3::new(4.0, -0.2, 4.0);
        let size = 0.1 + 0.2 * numbers.next();
        let (u, v) = ((numbers.vec3() - 0.5) * size, (numbers.vec3() - 0.5) * size);
        let material = if i % 5 == 4 { narrow } else { materials[i % 2] };
        if i % 3 == 0 { b.quad(at, u, v, material, 1.0) } else { b.triangle([at, at + u, at + v], material) }
    }
    if listed > 0 {
        for (center, inward) in [(Vec3::new(1.0, 0.6, 0.5), false), (Vec3::new(9.0, 0.5, 0.0), true)] {
            let object = b.sphere(center, 0.3, 1, materials[0], inward);
            b.0.lights.push(Light::Sphere { center, radius: 0.3, radiance: Vec3::ONE, inward, object });
        }
        let (position, intensity) = (Vec3::new(0.2, 0.9, -0.4), Vec3::new(0.2, 0.3, 0.1));
        b.0.lights.push(Light::Point { position, intensity });
        let direction = Vec3::new(0.1, -1.0, 0.2).normalize();
        b.0.lights.push(Light::Spot { position, direction, intensity, inner: 0.3, outer: 0.7 });
        b.0.lights.push(Light::Directional { direction, irradiance: Vec3::splat(0.02) });
        let power = Vec3::new(0.1, 0.2, 0.3);
        b.0.lights.push(Light::Imported { position, normal: direction, power, exponent: 3.0 });
    }
    b.finish(Vec3::new(0.1, 1.5, -3.0), Vec3::new(0.0, 0.0, 0.5))
}

/// The emitters after the pass, which follows the eye stage.
fn distribution(rig: &Rig) -> Vec<EmitterRecord> {
    let emitters = &rig.frame().importance.as_ref().unwrap().emitters;
    rig.prefill(&[emitters]);
    rig.run(|frame, rec| {
        frame.eye.record(rec)?;
        frame.importance.record(rec)
    });
    rig.get(emitters)
}

#[test]
fn importance_follows_its_oracle_and_no_emitter_falls_below_the_floor() {
    gpu_test(|ctx| {
        let counts = AWKWARD_SIZES.into_iter().flat_map(|n| [(n, 0.2), (n, 0.01)]).map(|c| (c, [31, 17]));
        let images = AWKWARD_IMAGES.into_iter().map(|size| ((683, 0.1), size));
        for ((count, power_fraction), size) in counts.chain(images) {
            let scene = lamps(count);
            let clip = Clip::Distance(0.3);
            let settings = by_contribution(Settings { power_fraction, clip, ..Settings::plain() });
            let rig = Rig::new(ctx, &scene, size, settings);
            let records = distribution(&rig);
            let emitters = rig.engine.emitters();
            assert_eq!((records.len(), emitters.list.len()), (count, count));
            let primary = receivers(&rig, &rig.frame().eye.points);
            let wo = rig.vec4s(&rig.frame().eye.points.wo);
            let seen: Vec<_> = probes(size).filter(|&p| is_lit(wo[p as usize])).map(|p| primary[p as usize]).collect();
            assert!(seen.len() > 30, "{} probes see the floor", seen.len());
            let expected = reference(&rig.parameters, emitters, &seen);
            let (mut lower, mut sum, mut kinds) = (0.0, 0.0, HashSet::new());
            for (i, (record, e)) in records.iter().zip(&emitters.list).enumerate() {
                let (p, upper) = (record.normal[3], record.radiance[3]);
                assert!(upper >= lower && p == upper - lower, "emitter {i}: {p} from {lower} to {upper}");
                // The ends are stored with an error of 2^-24 each, sums of thousands of terms with slightly more.
                let floor = power_fraction * e.probability;
                assert!(p >= floor * 0.9999 - 3e-7, "emitter {i}: {p} is below {floor}");
                assert!(
                    (f64::from(p) - expected[i]).abs() < 1e-3 * expected[i] + 3e-7,
                    "emitter {i}: {p} for {}",
                    expected[i]
                );
                // Probabilities below the spacing of numbers just below 1 are lost, as in a choice by power.
                let power = xyz(record.flux) * p;
                let kept = (power - e.power).length() <= 1e-5 * e.power.length();
                assert!(kept || p == 0.0 && expected[i] < 2e-7, "emitter {i}: {power} for {}", e.power);
                assert_eq!((record.p0, record.e1, record.e2), {
                    let before = emitters.records()[i];
                    (before.p0, before.e1, before.e2)
                });
                lower = upper;
                sum += f64::from(p);
                kinds.insert(e.kind as u32);
            }
            assert!((sum - 1.0).abs() < 1e-6 && lower == 1.0, "the probabilities sum up to {sum}");
            assert!(count < 10 || kinds.len() == 7, "kinds {kinds:?}");
        }
    });
}

#[test]
fn where_nothing_is_seen_importance_goes_by_power() {
    gpu_test(|ctx| {
        let mut scene = lamps(27);
        let camera = scene.camera.as_mut().unwrap();
        camera.eye = Vec3::Y * 10.0;
        camera.target = camera.eye + Vec3::new(0.0, 1.0, -1.0);
        let rig = Rig::new(ctx, &scene, [8, 8], by_contribution(Settings::plain()));
        for (record, e) in distribution(&rig).iter().zip(&rig.engine.emitters().list) {
            assert!((record.normal[3] - e.probability).abs() < 1e-6, "{} for {}", record.normal[3], e.probability);
        }
    });
}

#[test]
fn particles_start_by_the_distribution_of_importance() {
    gpu_test(|ctx| {
        for (count, size) in AWKWARD_SIZES.into_iter().chain([683]).zip([[31, 17], [1, 1], [27, 1], [683, 3], [8, 8]]) {
            let scene = lamps(64);
            let rig = Rig::new(ctx, &scene, size, by_contribution(settings(count as u32, 3)));
            let records = distribution(&rig);
            rig.run(|frame, rec| frame.walk.record_start(rec));
            let mut emitters: Emitters = rig.engine.emitters().clone();
            emitters.cdf = records.iter().map(|r| r.radiance[3]).collect();
            emitters.list.iter_mut().zip(&records).for_each(|(e, r)| e.probability = r.normal[3]);
            let lights: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
            let first = rig.parameters.depths[0][1];
            let mut tally = Tally::new(format!("walk_start by contribution, {count} particles, {size:?}"));
            let mut started = vec![0.0f32; emitters.list.len()];
            for i in 0..count as u32 {
                let (light, ..) = walk_start::reference(&rig.parameters, (&emitters, &rig.scene.textures), i);
                let found = &lights[(first + i) as usize];
                // Points on discs and spheres are placed by sine and cosine.
                tally.check_values(same_light(found, &light, SINE * 10.0), &of_lights(found, &light), || {
                    format!("particle {i}: {found:?}\nfor {light:?}")
                });
                started[emitters.choose(walk_start::first_light_numbers(&rig.parameters, i)[0]).0 as usize] += 1.0;
            }
            tally.finish(STRAYS);
            let mut worst = 0.0f32;
            for (e, found) in emitters.list.iter().zip(started) {
                let expected = count as f32 * e.probability;
                worst = worst.max((found - expected).abs());
                assert!((found - expected).abs() < 3.6, "{:?}: {found} for {expected}", e.kind);
            }
            println!("{count} particles, {size:?}: off by {worst:.1}");
        }
    });
}

#[test]
fn with_one_emitter_the_choice_changes_no_bit() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let base = settings(16, 4);
        let by_power = render(ctx, &scene, camera, &base, 4);
        let chosen = render(ctx, &scene, camera, &by_contribution(base), 4);
        assert!(by_power.color == chosen.color && by_power.indirect == chosen.indirect);
    });
}

#[test]
fn both_choices_have_the_same_limit() {
    gpu_test(|ctx| {
        // Two rooms and a wall of half their height between them, which blocks most of the light that the strong lamps
        // beyond it would contribute.
        let mut soup = Soup::new("two rooms");
        let [grey, red] = [soup.diffuse(0.6, 0.0), soup.diffuse([0.7, 0.2, 0.2], 0.0)];
        let [weak, strong] = [soup.diffuse(0.0, 4.0), soup.diffuse(0.0, [20.0, 25.0, 30.0])];
        soup.room(Vec3::ZERO, Vec3::new(4.0, 2.0, 2.0), [red, grey, grey, grey, grey, grey]);
        soup.room(Vec3::new(1.95, 0.0, 0.0), Vec3::new(2.05, 1.0, 2.0), [grey; 6]);
        // The room's faces look inwards; the wall is seen from outside.
        let wall = soup.0.triangles.len() - 12;
        soup.0.triangles[wall..].iter_mut().for_each(|t| t.vertices.swap(1, 2));
        soup.quad(Vec3::new(0.8, 1.95, 0.8), Vec3::X * 0.4, Vec3::Z * 0.4, weak);
        for k in 0..3 {
            let corner = Vec3::new(2.2 + 0.6 * k as f32, 1.2, 0.9);
            soup.quad(corner, Vec3::X * 0.3, Vec3::Z * 0.3, strong);
        }
        let camera = camera(Vec3::new(1.8, 1.0, 1.0), Vec3::new(0.0, 0.8, 1.0), 70.0, [24, 18]);
        let by_power = render(ctx, &soup.0, camera, &settings(64, 5), 256);
        let chosen = render(ctx, &soup.0, camera, &by_contribution(settings(64, 5)), 256);
        for (what, a, b) in [
            ("all light", &chosen.color, &by_power.color),
            ("direct light", &chosen.direct, &by_power.direct),
            ("indirect light", &chosen.indirect, &by_power.indirect),
        ] {
            let (ratio, error) = compare(a, b);
            println!("{what}: energy {ratio:.4}, relative RMSE {error:.4}");
            assert!(mean(b).x > 0.0 && (ratio - 1.0).abs() < 0.02 && error < 0.1, "{what}: {ratio}, {error}");
        }
    });
}

#[test]
fn of_a_thousand_lights_those_that_matter_are_chosen() {
    gpu_test(|ctx| {
        // A field of 50 x 20 lamps; some ten of them light the visible part.
        let mut soup = Soup::new("a thousand lamps");
        let [grey, lamp] = [soup.diffuse(0.7, 0.0), soup.diffuse(0.0, 10.0)];
        soup.quad(Vec3::ZERO, Vec3::Z * 80.0, Vec3::X * 200.0, grey);
        for i in 0..1000 {
            let corner = Vec3::new(2.0 + 4.0 * (i % 50) as f32, 2.0, 2.0 + 4.0 * (i / 50) as f32);
            soup.quad(corner, Vec3::X * 0.2, Vec3::Z * 0.2, lamp);
        }
        let camera = camera(Vec3::new(40.0, 1.5, 40.0), Vec3::new(40.0, 0.0, 41.0), 60.0, [24, 18]);
        // No shading point is nearer than the clip distance to a lamp, so nothing is gathered.
        let clip = Clip::Distance(0.5);
        let limit = render(ctx, &soup.0, camera, &Settings { clip, ..settings(4096, 2) }, 16).color;
        let (mut by_power, mut chosen) = (0.0, 0.0);
        for seed in 0..3 {
            let base = Settings { seed, clip, ..settings(32, 2) };
            by_power += compare(&render(ctx, &soup.0, camera, &base, 16).color, &limit).1;
            chosen += compare(&render(ctx, &soup.0, camera, &by_contribution(base), 16).color, &limit).1;
        }
        println!("relative RMSE of 512 particles: {:.3} by power, {:.3} by contribution", by_power / 3.0, chosen / 3.0);
        assert!(chosen * 10.0 < by_power, "{chosen} against {by_power}");
    });
}
