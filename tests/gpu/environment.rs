//! Light from all around: closed forms, and whole images against the path tracer.

use std::sync::Arc;

use glam::Vec3;
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::scene::{Camera, Environment, Material, Scene, Surface, builtin};
use lightsum::settings::Settings;
use lightsum::summary::Summary;

use crate::references::path_traced;
use crate::scenes::{Soup, camera, compare, mean, render, renderer};
use crate::support::gpu_test;

/// The memory that a summary tells is that of the buffers.
#[test]
fn the_summary_knows_the_memory() {
    gpu_test(|ctx| {
        for scene in [builtin::room(3000), outdoors(1.0).0] {
            let told = Summary::of(&scene).unwrap().device_bytes as f64;
            let view = camera(Vec3::Z, Vec3::ZERO, 40.0, [8, 8]);
            let renderer = renderer(ctx, &scene, view, &Settings::default());
            let device = renderer.engine().device_scene();
            let more = device
                .target_buffers
                .as_ref()
                .map_or(0, |t| t.list.bytes() + t.triangles.bytes() + t.of_triangle.bytes());
            let found = (device.bytes() - more) as f64;
            assert!((told / found - 1.0).abs() < 0.02, "{}: {told} of {found} bytes", scene.name);
        }
    });
}

/// A convex body is lit by the environment alone: its radiance is the albedo times that of the environment.
#[test]
fn a_furnace_of_constant_light() {
    gpu_test(|ctx| {
        let radiance = Vec3::new(1.0, 0.5, 0.25);
        let mut soup = Soup::new("ball in a furnace");
        let grey = soup.diffuse(0.6, 0.0);
        soup.ball(Vec3::ZERO, 1.0, 32, grey);
        let scene = Scene { environment: Some(Arc::new(Environment::constant(radiance))), ..soup.0 };
        let view = camera(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, 40.0, [33, 31]);
        for settings in [Settings::default(), Settings::interactive(), Settings::plain()] {
            let layers = render(ctx, &scene, view, &settings, 32);
            let at = |x: usize, y: usize| layers.color[33 * y + x];
            for (x, y) in [(0, 0), (32, 0), (0, 30), (32, 30)] {
                assert!((at(x, y) - radiance).abs().max_element() < 1e-6, "{}", at(x, y));
            }
            assert!(layers.alpha.iter().all(|&a| (a - 1.0).abs() < 1e-6), "the environment covers all");
            let ball: Vec<Vec3> = (12..19).flat_map(|y| (13..20).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect();
            let ratio = mean(&ball) / (0.6 * radiance).as_dvec3();
            println!("{ratio}");
            assert!((ratio - 1.0).abs().max_element() < 0.01, "{ratio}");
        }
    });
}

/// Balls of all kinds on a floor before a wall, under a sky with a sun of so much radiance.
fn outdoors(sun: f32) -> (Scene, Camera) {
    let mut soup = Soup::new("outdoors");
    let floor = soup.diffuse([0.6, 0.5, 0.4], 0.0);
    let blue = soup.diffuse([0.2, 0.3, 0.7], 0.0);
    let mirror = soup.material(Material {
        surface: Surface::Mirror,
        base_color: Vec3::ZERO,
        specular: Vec3::splat(0.9),
        ..Material::default()
    });
    let metal = |roughness: f32| Material {
        base_color: Vec3::new(0.9, 0.7, 0.4),
        metallic: 1.0,
        roughness,
        specular: Vec3::splat(0.04),
        ..Material::default()
    };
    let (smooth, rough) = (soup.material(metal(0.3)), soup.material(metal(0.7)));
    let glass = soup.material(Material { surface: Surface::Glass, ior: 1.5, ..Material::default() });
    soup.quad(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, floor);
    soup.quad(Vec3::new(-3.0, 0.0, -2.0), Vec3::X * 6.0, Vec3::Y * 1.5, blue);
    for (i, material) in [blue, mirror, smooth, rough, glass].into_iter().enumerate() {
        soup.ball(Vec3::new(1.1 * i as f32 - 2.2, 0.5, 0.0), 0.5, 48, material);
    }
    let texel = |i: u32| match (i % 32, i / 32) {
        (20, 4) => Vec3::splat(sun),
        (_, y @ 0..8) => Vec3::new(0.4, 0.6, 1.0) * (1.0 - 0.08 * y as f32),
        _ => Vec3::splat(0.15),
    };
    let texels = (0..512).map(texel).collect();
    let environment = Environment { width: 32, height: 16, texels, ..Environment::constant(Vec3::ONE) };
    let scene = Scene { environment: Some(Arc::new(environment)), ..soup.0 };
    (scene, camera(Vec3::new(0.0, 1.6, 4.0), Vec3::new(0.0, 0.5, 0.0), 45.0, [48, 30]))
}

#[test]
fn a_sky_with_and_without_a_sun_against_the_path_tracer() {
    gpu_test(|ctx| {
        for sun in [0.4, 60.0] {
            let (scene, view) = outdoors(sun);
            let options = Options {
                resolution: view.resolution,
                samples: 1024,
                max_depth: 5,
                max_specular: 8,
                seed: 7,
                specular_paths: SpecularPaths::All,
                reflectance: Default::default(),
            };
            let reference = path_traced(&scene, &view, &options);
            // Rays at the silhouette of a mirror ball take the light of the next pixel, which may show the sun.
            let settings = Settings { max_depth: 5, antialias: false, ..Settings::default() };
            let image = render(ctx, &scene, view, &settings, 64).color;
            let (energy, error) = compare(&image, &reference);
            println!("sun {sun}: energy {energy:.4}, relative RMSE {error:.4}");
            assert!((energy - 1.0).abs() < 0.01, "sun {sun}: {energy}");
            assert!(error < 0.08, "sun {sun}: {error}");
        }
    });
}
