//! The choice among lights without area: the pass against its oracle, and its effect on images.

use std::collections::HashMap;

use glam::Vec3;
use lightsum::pass::delta_choice::{Candidates, ONE, offset, reference};
use lightsum::pass::layout::{EmitterRecord, PointLight};
use lightsum::scene::{Camera, Light, Scene};
use lightsum::settings::{LightChoice, Settings};
use lightsum::stage::Stage;

use crate::rig::{AWKWARD_IMAGES, Builder, Numbers, Rig, xyz};
use crate::scenes::{Soup, camera, compare, mean, render, settings};
use crate::support::gpu_test;

/// A floor under `count` lights of all kinds without area, the brightest thousands of times brighter than the others.
fn lamps(count: u32) -> Scene {
    let mut b = Builder::default();
    let mut numbers = Numbers(11);
    let floor = b.material(Default::default());
    b.quad(Vec3::new(-4.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::X * 8.0, floor, 1.0);
    for i in 0..count {
        let position = numbers.vec3() * Vec3::new(8.0, 2.0, 8.0) - Vec3::new(4.0, -0.2, 4.0);
        let strength = 0.01 * numbers.next().powi(-2).min(1e4);
        let direction = (numbers.vec3() - Vec3::new(0.5, 1.5, 0.5)).normalize();
        let intensity = Vec3::new(1.0, 0.7, 0.3) * strength;
        b.0.lights.push(match i % 5 {
            0 | 1 => Light::Point { position, intensity },
            2 => Light::Spot { position, direction, intensity, inner: 0.3, outer: 0.9 },
            3 => Light::Imported { position, normal: direction, power: intensity, exponent: 4.0 },
            _ => Light::Directional { direction, irradiance: intensity * 1e-3 },
        });
    }
    b.finish(Vec3::new(0.1, 1.5, -3.0), Vec3::new(0.0, 0.0, 0.5))
}

/// Identifies a light, whatever its intensity.
fn place(light: &PointLight) -> [u32; 8] {
    let bits = |a: [f32; 4]| a.map(f32::to_bits);
    let (p, n) = (bits(light.position), bits(light.normal));
    std::array::from_fn(|i| if i < 4 { p[i] } else { n[i - 4] })
}

/// The lights of each class that a pass chose.
fn choose(rig: &Rig, pass: u32) -> (lightsum::pass::layout::FrameParameters, Vec<Vec<PointLight>>) {
    let parameters = rig.engine.plan().parameters(pass).unwrap();
    rig.run(|frame, rec| {
        frame.record_start(rec, &parameters)?;
        if frame.importance.is_some() {
            frame.eye.record(rec)?;
            frame.importance.record(rec)?;
        }
        frame.delta_choice.record(rec)
    });
    let plan = &rig.engine.plan().lights;
    let lights: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
    let of_class = |class: &[PointLight]| class[..plan.delta as usize].to_vec();
    (parameters, lights.chunks(plan.slots() as usize).map(of_class).collect())
}

#[test]
fn delta_choice_follows_its_oracle() {
    gpu_test(|ctx| {
        // Every number of lights at one size of the image, which the choice by contribution depends on.
        let counts = [(2, 1), (27, 5), (64, 63), (2049, 40), (2049, 1), (683, 31), (2, 1), (27, 26)];
        let cases = counts.into_iter().zip([[31, 17]; 3].into_iter().chain(AWKWARD_IMAGES));
        let choices = [LightChoice::Power, LightChoice::Contribution];
        for (((count, slots), size), light_choice) in cases.into_iter().flat_map(|c| choices.map(|choice| (c, choice)))
        {
            let scene = lamps(count);
            let base = Settings { delta_lights: Some(slots), light_choice, pattern: [3, 2], ..Settings::plain() };
            let rig = Rig::new(ctx, &scene, size, base);
            let indices: Vec<u32> = rig.engine.emitters().delta.iter().map(|&i| i as u32).collect();
            let all = Candidates::new(&rig.engine.device_scene().delta, &indices);
            let number: HashMap<_, _> = all.lights.iter().enumerate().map(|(i, l)| (place(l), i)).collect();
            assert_eq!(number.len(), count as usize);
            let parallel = |l: &PointLight| l.flags() & PointLight::DIRECTIONAL != 0;
            let parallels = all.lights.iter().filter(|l| parallel(l)).count();
            rig.prefill(&[&rig.frame().walk.lights]);
            let mut excess = vec![0.0; count as usize];
            for pass in 0..48 {
                let (parameters, classes) = choose(&rig, pass);
                let records: Vec<EmitterRecord> = match &rig.frame().importance {
                    Some(importance) => rig.get(&importance.emitters),
                    None => rig.engine.emitters().records(),
                };
                let weight = |&e: &u32| f64::from(records[e as usize].normal[3]);
                let weights: Vec<f64> = all.emitters.iter().map(weight).collect();
                let pi = reference(&weights, slots);
                excess.iter_mut().zip(&pi).for_each(|(excess, pi)| *excess -= 6.0 * pi);
                let mut ends = vec![0.0];
                pi.iter().for_each(|p| ends.push(ends[ends.len() - 1] + p));
                for (class, lights) in classes.iter().enumerate() {
                    let u = f64::from(offset(&parameters, class as u32)) / f64::from(ONE);
                    let mut last = None;
                    for (slot, light) in lights.iter().enumerate() {
                        // The shares sum to a thousandth less than the number of slots.
                        let point = slot as f64 + u;
                        let slack = 0.0015 * f64::from(slots) + 1e-3;
                        if *light == PointLight::default() {
                            assert!(point + slack > f64::from(slots), "slot {slot} of {slots} at {u} is empty");
                            continue;
                        }
                        let i = number[&place(light)];
                        assert!(last < Some(i), "light {i} after {last:?}");
                        last = Some(i);
                        let whole = &all.lights[i];
                        let share = f64::from(mean3(whole)) / f64::from(mean3(light));
                        assert!(
                            (share - pi[i]).abs() < 0.004 * pi[i] + 2e-6,
                            "light {i} of {count}: {share} for {}",
                            pi[i]
                        );
                        assert!(ends[i] - slack < point && point < ends[i + 1] + slack, "light {i}: {point}");
                        assert!(!parallel(light) || slot < parallels, "a parallel light in slot {slot}");
                        let same = PointLight { emit: whole.emit, ..*light };
                        assert!(same == *whole && light.emit[3] == whole.emit[3]);
                        excess[i] += 1.0;
                    }
                }
            }
            // Of 288 times; the offsets are evenly spread over the classes and over the passes of both instances. By
            // contribution the lights before it take more or less of the line from pass to pass, as if at random: five
            // sigma.
            let most = if light_choice == LightChoice::Power { 2.0 } else { 13.0 };
            let worst = excess.iter().fold(0.0f64, |worst, e| worst.max(e.abs()));
            println!("{slots} of {count}, {size:?}, {light_choice:?}: off by {worst:.1}");
            for (i, excess) in excess.iter().enumerate() {
                assert!(excess.abs() < most, "light {i} of {count} is chosen {excess} times too often");
            }
        }
    });
}

fn mean3(light: &PointLight) -> f32 {
    xyz(light.emit).element_sum() / 3.0
}

#[test]
fn with_room_for_all_lights_no_bit_changes() {
    gpu_test(|ctx| {
        let scene = lamps(27);
        let camera = Camera { resolution: [24, 18], ..scene.camera.unwrap() };
        let base = Settings { pattern: [2, 1], ..settings(8, 3) };
        let all = render(ctx, &scene, camera, &base, 4);
        for slots in [27, 28, Settings::MAX_DELTA_LIGHTS] {
            let chosen = render(ctx, &scene, camera, &Settings { delta_lights: Some(slots), ..base.clone() }, 4);
            assert!(chosen.color == all.color && chosen.direct == all.direct, "{slots} slots");
        }
        let chosen = |seed| render(ctx, &scene, camera, &Settings { delta_lights: Some(5), seed, ..base.clone() }, 4);
        assert!(chosen(1).color == chosen(1).color && chosen(1).color != chosen(2).color);
        assert!(chosen(1).color != all.color);
    });
}

/// A hall of 20 x 20 lamps over a floor with boxes on it, and a parallel light; the image is lit by some ten of the lamps.
fn hall() -> (Scene, Camera) {
    let mut soup = Soup::new("a hall of lamps");
    let grey = soup.diffuse(0.7, 0.0);
    soup.quad(Vec3::ZERO, Vec3::Z * 80.0, Vec3::X * 80.0, grey);
    for (x, z) in [(39.2, 40.9), (40.5, 41.2), (39.9, 42.0)] {
        soup.room(Vec3::new(x, 0.0, z), Vec3::new(x + 0.3, 0.4, z + 0.3), [grey; 6]);
        // Seen from outside.
        let first = soup.0.triangles.len() - 12;
        soup.0.triangles[first..].iter_mut().for_each(|t| t.vertices.swap(1, 2));
    }
    for i in 0..400 {
        let position = Vec3::new(2.0 + 4.0 * (i % 20) as f32, 2.5, 2.0 + 4.0 * (i / 20) as f32);
        soup.0
            .lights
            .push(Light::Point { position, intensity: Vec3::new(1.0, 0.9, 0.7) * (0.5 + 0.1 * (i % 7) as f32) });
    }
    let direction = Vec3::new(0.3, -1.0, 0.4).normalize();
    soup.0.lights.push(Light::Directional { direction, irradiance: Vec3::new(0.05, 0.06, 0.08) });
    (soup.0, camera(Vec3::new(40.0, 1.5, 40.0), Vec3::new(40.0, 0.0, 41.0), 60.0, [32, 24]))
}

#[test]
fn chosen_lights_have_the_same_limit() {
    gpu_test(|ctx| {
        let (scene, camera) = hall();
        let all = render(ctx, &scene, camera, &settings(4, 3), 64);
        for (light_choice, pattern, slots) in [
            (LightChoice::Power, [1, 1], 40),
            (LightChoice::Contribution, [1, 1], 8),
            (LightChoice::Contribution, [3, 3], 8),
        ] {
            let base = Settings { light_choice, pattern, delta_lights: Some(slots), ..settings(4, 3) };
            let some = render(ctx, &scene, camera, &base, 256);
            let (ratio, error) = compare(&some.direct, &all.direct);
            println!("{light_choice:?} {pattern:?}: energy {ratio:.4}, relative RMSE {error:.4}");
            assert!((ratio - 1.0).abs() < 0.01 && error < 0.08, "{ratio}, {error}");
            assert!(mean(&all.direct).x > 0.0);
        }
    });
}

#[test]
fn of_four_hundred_lamps_those_that_matter_are_lit() {
    gpu_test(|ctx| {
        let (scene, camera) = hall();
        let limit = render(ctx, &scene, camera, &settings(1, 2), 128).direct;
        let error = |light_choice, delta_lights, passes| {
            let one = |seed| {
                let base = Settings { light_choice, delta_lights, seed, ..settings(1, 2) };
                compare(&render(ctx, &scene, camera, &base, passes).direct, &limit).1
            };
            (0..3).map(one).sum::<f64>() / 3.0
        };
        let contribution = LightChoice::Contribution;
        for passes in [1, 4, 16, 50] {
            let [by_power, chosen] = [LightChoice::Power, contribution].map(|c| error(c, Some(8), passes));
            println!("{} shadow rays: {by_power:.3} by power, {chosen:.3} by contribution", 8 * passes);
            assert!(
                chosen * if passes > 1 { 2.5 } else { 1.1 } < by_power,
                "{passes} passes: {chosen} against {by_power}"
            );
        }
        println!("401 shadow rays to all: {:.3}", error(LightChoice::Power, None, 1));
        assert!(error(contribution, Some(32), 1) < error(contribution, Some(8), 1));
    });
}
