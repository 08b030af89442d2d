//! The choice of emitters by contribution: the pass against its oracle, and the walk that follows it.

use std::collections::HashSet;

use super::light::receivers;
use super::walk::{of_lights, same_light};
use crate::conform::rig::{Builder, Rig, SINE, STRAYS, Tally, is_lit, xyz};
use crate::conform::tally::within;
use crate::conform::{Bench, Numbers};
use crate::light::emitters::{EmitterRecord, Emitters};
use crate::pass::importance::{probes, reference};
use crate::pass::layout::PointLight;
use crate::pass::walk_start;
use crate::scene::{Light, Material, Scene};
use crate::settings::{Clip, LightChoice, Settings};
use crate::stage::Stage;
use glam::Vec3;

pub fn by_contribution(settings: Settings) -> Settings {
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

pub fn importance_follows_its_oracle_and_no_emitter_falls_below_the_floor(bench: &Bench) {
    let counts = bench.sizes().flat_map(|n| [(n, 0.2), (n, 0.01)]).map(|c| (c, [31, 17]));
    let images = bench.images().map(|size| ((683, 0.1), size));
    for ((count, power_fraction), size) in counts.chain(images) {
        let scene = lamps(count);
        let clip = Clip::Distance(0.3);
        let settings = by_contribution(Settings { power_fraction, clip, ..Settings::plain() });
        let rig = bench.rig(&scene, size, settings);
        let records = distribution(&rig);
        let emitters = rig.engine.emitters();
        assert_eq!((records.len(), emitters.list.len()), (count, count));
        let primary = receivers(&rig, &rig.frame().eye.points);
        let wo = rig.vec4s(&rig.frame().eye.points.wo);
        let seen: Vec<_> = probes(size).filter(|&p| is_lit(wo[p as usize])).map(|p| primary[p as usize]).collect();
        bench.covered(seen.len() > 30, format_args!("{} probes see the floor", seen.len()));
        let expected = reference(&rig.parameters, emitters, &seen);
        let (mut lower, mut sum, mut kinds) = (0.0, 0.0, HashSet::new());
        for (i, (record, e)) in records.iter().zip(&emitters.list).enumerate() {
            let (p, upper) = (record.normal[3], record.radiance[3]);
            assert!(upper >= lower && p == upper - lower, "emitter {i}: {p} from {lower} to {upper}");
            // The ends are stored with an error of 2^-24 each, sums of thousands of terms with slightly more.
            let floor = power_fraction * e.probability;
            assert!(p >= floor * 0.9999 - 3e-7, "emitter {i}: {p} is below {floor}");
            assert!(
                within(f64::from(p) - expected[i], 1e-3 * expected[i] + 3e-7),
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
        bench.covered(count < 10 || kinds.len() == 7, format_args!("kinds {kinds:?}"));
    }
}

pub fn where_nothing_is_seen_importance_goes_by_power(bench: &Bench) {
    let mut scene = lamps(27);
    let camera = scene.camera.as_mut().unwrap();
    camera.eye = Vec3::Y * 10.0;
    camera.target = camera.eye + Vec3::new(0.0, 1.0, -1.0);
    let rig = bench.rig(&scene, [8, 8], by_contribution(Settings::plain()));
    for (record, e) in distribution(&rig).iter().zip(&rig.engine.emitters().list) {
        assert!(within(record.normal[3] - e.probability, 1e-6), "{} for {}", record.normal[3], e.probability);
    }
}

pub fn particles_start_by_the_distribution_of_importance(bench: &Bench) {
    for (count, size) in bench.sizes().chain([683]).zip([[31, 17], [1, 1], [27, 1], [683, 3], [8, 8]]) {
        let scene = lamps(64);
        let particles = count as u32;
        let plain = Settings { particles, max_depth: 3, photons: 0, mirror_lights: 0, ..Settings::plain() };
        let rig = bench.rig(&scene, size, by_contribution(plain));
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
        log::info!("{count} particles, {size:?}: off by {worst:.1}");
    }
}
