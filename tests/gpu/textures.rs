//! Images of textures that are finer than pixels.

use std::path::Path;

use glam::{Vec2, Vec3};
use lightsum::Settings;
use lightsum::scene::{Camera, Light, Material, Scene, Texture, Wrap};

use crate::renderer::path_traced;
use crate::scenes::{Soup, camera, compare, render};
use crate::support::gpu_test;

/// A plane with checks of four texels each to the horizon, lit from the eye, and its camera.
fn plane_to_the_horizon(resolution: [u32; 2]) -> (Scene, Camera) {
    let mut soup = Soup::new("plane");
    let texel = |i: u32| if (i % 16 / 4 + i / 64).is_multiple_of(2) { [235, 225, 200, 255] } else { [25, 30, 60, 255] };
    let (name, wrap) = (String::from("checks"), [Wrap::Repeat; 2]);
    let texels = (0..256).map(texel).collect();
    soup.0.textures.push(Texture { name, width: 16, height: 16, texels, srgb: true, wrap });
    let checks = soup.material(Material { base_color: Vec3::ONE, base_texture: Some(0), ..Material::default() });
    soup.quad(Vec3::new(-200.0, 0.0, 200.0), Vec3::X * 400.0, Vec3::NEG_Z * 400.0, checks);
    soup.0.uvs.iter_mut().for_each(|uv| *uv *= Vec2::splat(200.0));
    let direction = Vec3::new(-0.3, -1.0, -0.2).normalize();
    soup.0.lights.push(Light::Directional { direction, irradiance: Vec3::splat(3.0) });
    soup.0.validate(Path::new("plane")).unwrap();
    (soup.0, camera(Vec3::new(0.3, 1.0, 0.2), Vec3::new(0.5, 0.8, -4.0), 50.0, resolution))
}

#[test]
fn one_pass_of_a_checkered_plane_does_not_glitter() {
    gpu_test(|ctx| {
        let (scene, camera) = plane_to_the_horizon([96, 64]);
        let settings = |seed| Settings { seed, max_depth: 2, particles: 1, filter: None, ..Settings::plain() };
        let reference = path_traced(&scene, &camera, 4096, 2);
        // One pass without levels would show one point of each pixel.
        let point = path_traced(&scene, &camera, 1, 2);
        let (_, plain) = compare(&point, &reference);
        for (passes, energy, most) in [(1, 0.02, 0.55 * plain), (16, 0.01, 0.3 * plain), (256, 0.005, 0.1 * plain)] {
            let (ratio, error) = compare(&render(ctx, &scene, camera, &settings(3), passes).color, &reference);
            println!("{passes} passes: energy {ratio:.4}, relative RMSE {error:.4}, {plain:.4} of one point a pixel");
            assert!((ratio - 1.0).abs() < energy, "{passes} passes: energy {ratio}");
            assert!(error < most, "{passes} passes: relative RMSE {error} of at most {most}");
        }
    });
}
