//! The choice among lights without area against its oracle.

use std::collections::HashMap;

use crate::conform::rig::{Builder, Rig, xyz};
use crate::conform::tally::within;
use crate::conform::{Bench, Must, Numbers};
use crate::pass::delta_choice::{Candidates, ONE, offset, reference};
use crate::pass::layout::{EmitterRecord, PointLight};
use crate::scene::{Light, Scene};
use crate::settings::{LightChoice, Settings};
use crate::stage::Stage;
use glam::Vec3;

/// A floor under `count` lights of all kinds without area, the brightest thousands of times brighter than the others.
pub fn lamps(count: u32) -> Scene {
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
fn choose(rig: &Rig, pass: u32) -> (crate::pass::layout::FrameParameters, Vec<Vec<PointLight>>) {
    let parameters = rig.engine.plan().parameters(pass).must();
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

pub fn delta_choice_follows_its_oracle(bench: &Bench) {
    // Every number of lights at one size of the image, which the choice by contribution depends on.
    let counts = [(2, 1), (27, 5), (64, 63), (2049, 40), (2049, 1), (683, 31), (2, 1), (27, 26)];
    let cases = counts.into_iter().zip([[31, 17]; 3].into_iter().chain(bench.images()));
    let choices = [LightChoice::Power, LightChoice::Contribution];
    for (((count, slots), size), light_choice) in cases.into_iter().flat_map(|c| choices.map(|choice| (c, choice))) {
        let scene = lamps(count);
        let base = Settings { delta_lights: Some(slots), light_choice, pattern: [3, 2], ..Settings::plain() };
        let rig = bench.rig(&scene, size, base);
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
                    assert!(within(share - pi[i], 0.004 * pi[i] + 2e-6), "light {i} of {count}: {share} for {}", pi[i]);
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
        log::info!("{slots} of {count}, {size:?}, {light_choice:?}: off by {worst:.1}");
        for (i, excess) in excess.iter().enumerate() {
            assert!(excess.abs() < most, "light {i} of {count} is chosen {excess} times too often");
        }
    }
}

fn mean3(light: &PointLight) -> f32 {
    xyz(light.emit).element_sum() / 3.0
}
