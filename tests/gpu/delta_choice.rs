//! The choice among lights without area: its effect on images.

use glam::Vec3;
use lightsum::scene::{Camera, Light, Scene};
use lightsum::settings::{LightChoice, Settings};

use crate::scenes::{Soup, camera, compare, mean, render, settings};
use crate::support::gpu_test;

use lightsum::conform::checks::delta_choice::lamps;

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
