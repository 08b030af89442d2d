//! Lobes by a power of the cosine about the mirror direction, GGX lobes of two widths, and lobes from tables: whole images against the path tracer.

use glam::Vec3;
use lightsum::accel::Bvh;
use lightsum::path_trace::{Options, SpecularPaths, eye_ray};
use lightsum::scene::{Camera, Material, Scene};
use lightsum::settings::{Settings, Superposition};

use crate::lobe_tables;
use crate::references::path_traced;
use crate::scenes::{Soup, camera, compare, render, settings};
use crate::support::gpu_test;

/// Index of the floor's material.
const FLOOR: u32 = 2;

/// A room with a floor, a ball and a wall of these materials beside a coloured wall, lit by a lamp.
fn room(name: &str, [floor, ball, wall]: [Material; 3]) -> (Scene, Camera) {
    let mut soup = Soup::new(name);
    let grey = soup.diffuse(0.7, 0.0);
    let red = soup.diffuse([0.8, 0.1, 0.1], 0.0);
    let [floor, ball, wall] = [floor, ball, wall].map(|material| soup.material(material));
    soup.room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), [red, wall, floor, grey, grey, grey]);
    soup.ball(Vec3::new(1.9, 0.4, 1.8), 0.4, 24, ball);
    let lamp = soup.diffuse(0.0, 6.0);
    soup.quad(Vec3::new(1.0, 1.98, 1.0), Vec3::X, Vec3::Z, lamp);
    (soup.0, camera(Vec3::new(1.5, 1.1, 0.1), Vec3::new(1.5, 0.6, 2.2), 70.0, [32, 24]))
}

fn metal() -> Material {
    Material { base_color: Vec3::new(0.9, 0.8, 0.6), metallic: 1.0, ..Material::default() }
}

fn paint() -> Material {
    Material { base_color: Vec3::splat(0.5), specular: Vec3::splat(0.1), ..Material::default() }
}

#[test]
fn images_have_the_energy_of_the_path_tracer() {
    let lobe = |material: Material, d: f32| Material { phong_exponent: Some(d), ..material };
    check(&room("phong", [lobe(metal(), 40.0), lobe(metal(), 4.0), lobe(paint(), 12.0)]), true);
}

#[test]
fn images_with_lobes_of_two_widths_have_the_energy_of_the_path_tracer() {
    let lobe = |material: Material, roughness: f32, anisotropy: f32, anisotropy_rotation: f32| Material {
        roughness,
        anisotropy,
        anisotropy_rotation,
        ..material
    };
    let materials = [lobe(metal(), 0.25, 0.3, 0.6), lobe(metal(), 0.4, 0.8, 0.0), lobe(paint(), 0.3, 0.4, 1.3)];
    // The tail of the floor's lobe sees the lamp, which the mirror image does not show.
    check(&room("two widths", materials), false);
}

#[test]
fn images_with_lobes_from_tables_have_the_energy_of_the_path_tracer() {
    let [floor, ball, wall] =
        [lobe_tables::retro_reflective(), lobe_tables::off_specular(), lobe_tables::ggx(0.3, 33)].map(Some);
    let materials =
        [Material { lobe: floor, ..metal() }, Material { lobe: ball, ..metal() }, Material { lobe: wall, ..paint() }];
    // Light that goes back to where it comes from makes no mirror image.
    check(&room("tables", materials), false);
}

/// `mirrors`: with mirror images too.
fn check((scene, view): &(Scene, Camera), mirrors: bool) {
    gpu_test(|ctx| {
        let options = Options {
            resolution: view.resolution,
            samples: 1024,
            max_depth: 5,
            max_specular: 4,
            seed: 3,
            specular_paths: SpecularPaths::All,
            reflectance: Default::default(),
        };
        let reference = path_traced(scene, view, &options);
        // Planes that mirror the room do not count as segments: what the metal floor shows is lit as if seen directly.
        let deeper = if mirrors { path_traced(scene, view, &Options { max_depth: 6, ..options }) } else { Vec::new() };
        let bvh = Bvh::build(scene).unwrap();
        let on_floor = |i: usize| {
            let [x, y] = [i % 32, i / 32].map(|k| k as f32 + 0.5);
            let hit = bvh.closest(&eye_ray(view, view.resolution, x, y));
            hit.is_some_and(|hit| bvh.material(hit.triangle) == FLOOR)
        };
        let mirrored: Vec<Vec3> =
            (0..deeper.len()).map(|i| if on_floor(i) { deeper[i] } else { reference[i] }).collect();
        let usual = Settings { max_depth: 5, antialias: false, ..Settings::default() };
        let followed = settings(64, 5);
        let splat = Settings { superposition: Some(Superposition::default()), ..usual.clone() };
        // Of a mirror image surfaces that only the lobe sees are missing, and visible ones stand in for them.
        for (name, settings, slack, limit) in [
            ("defaults", &usual, 0.02, 0.14),
            ("without paths along lobes", &Settings { glossy_paths: false, ..followed.clone() }, 0.03, 0.2),
            ("plain", &followed, 0.02, 0.2),
            ("mirror image of the floor", &splat, 0.02, 0.17),
        ] {
            if settings.superposition.is_some() && !mirrors {
                continue;
            }
            let image = render(ctx, scene, *view, settings, 48).color;
            let truth = if settings.superposition.is_some() { &mirrored } else { &reference };
            let (energy, error) = compare(&image, truth);
            println!("{name}: energy {energy:.4}, relative RMSE {error:.4}");
            assert!((energy - 1.0).abs() < slack, "{name}: {energy}");
            assert!(error < limit, "{name}: {error}");
        }
    });
}
