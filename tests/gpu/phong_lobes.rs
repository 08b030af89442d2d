//! Lobes by a power of the cosine about the mirror direction: whole images against the path tracer.

use glam::Vec3;
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::scene::{Camera, Material, Scene};
use lightsum::settings::{Settings, Superposition};

use crate::references::path_traced;
use crate::scenes::{Soup, camera, compare, render, settings};
use crate::support::gpu_test;

/// A room with a wide and a narrow lobe beside a coloured wall, lit by a lamp.
fn room() -> (Scene, Camera) {
    let mut soup = Soup::new("phong");
    let grey = soup.diffuse(0.7, 0.0);
    let red = soup.diffuse([0.8, 0.1, 0.1], 0.0);
    let metal = |phong_exponent: f32| Material {
        base_color: Vec3::new(0.9, 0.8, 0.6),
        metallic: 1.0,
        phong_exponent: Some(phong_exponent),
        ..Material::default()
    };
    let (floor, ball) = (soup.material(metal(40.0)), soup.material(metal(4.0)));
    let wall = soup.material(Material {
        base_color: Vec3::splat(0.5),
        specular: Vec3::splat(0.1),
        phong_exponent: Some(12.0),
        ..Material::default()
    });
    soup.room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), [red, wall, floor, grey, grey, grey]);
    soup.ball(Vec3::new(1.9, 0.4, 1.8), 0.4, 24, ball);
    let lamp = soup.diffuse(0.0, 6.0);
    soup.quad(Vec3::new(1.0, 1.98, 1.0), Vec3::X, Vec3::Z, lamp);
    (soup.0, camera(Vec3::new(1.5, 1.1, 0.1), Vec3::new(1.5, 0.6, 2.2), 70.0, [32, 24]))
}

#[test]
fn images_have_the_energy_of_the_path_tracer() {
    gpu_test(|ctx| {
        let (scene, view) = room();
        let options = Options {
            resolution: view.resolution,
            samples: 1024,
            max_depth: 5,
            max_specular: 4,
            seed: 3,
            specular_paths: SpecularPaths::All,
            reflectance: Default::default(),
        };
        let reference = path_traced(&scene, &view, &options);
        let usual = Settings { max_depth: 5, antialias: false, ..Settings::default() };
        let followed = Settings { ..settings(64, 5) };
        let splat = Settings { superposition: Some(Superposition::default()), ..usual.clone() };
        // Of a mirror image surfaces that only the lobe sees are missing, and visible ones stand in for them.
        for (name, settings, slack, limit) in [
            ("defaults", &usual, 0.02, 0.14),
            ("without paths along lobes", &Settings { glossy_paths: false, ..followed.clone() }, 0.03, 0.2),
            ("plain", &followed, 0.02, 0.2),
            ("mirror image of the floor", &splat, 0.04, 0.28),
        ] {
            let image = render(ctx, &scene, view, settings, 48).color;
            let (energy, error) = compare(&image, &reference);
            println!("{name}: energy {energy:.4}, relative RMSE {error:.4}");
            assert!((energy - 1.0).abs() < slack, "{name}: {energy}");
            assert!(error < limit, "{name}: {error}");
        }
    });
}
