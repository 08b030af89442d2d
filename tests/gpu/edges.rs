//! Antialiased edges: outlines and textures look as after many passes.

use glam::Vec3;
use lightsum::gpu::Context;
use lightsum::scene::{Camera, Light, Material, Scene, Surface, Texture, Wrap};
use lightsum::settings::Settings;

use crate::scenes::{Soup, camera, compare, render};
use crate::support::gpu_test;

/// A white card, turned by some degrees, so far before a wall with squares of two colours, lit from the eye.
fn card_and_squares(eye: Vec3, before: f32) -> Scene {
    let mut soup = Soup::new("card and squares");
    let texel = |i: u32| if (i / 8 + i).is_multiple_of(2) { [240, 220, 40, 255] } else { [20, 40, 90, 255] };
    let texels = (0..64).map(texel).collect();
    let name = String::from("squares");
    soup.0.textures.push(Texture { name, width: 8, height: 8, texels, srgb: false, wrap: [Wrap::Clamp; 2] });
    let wall = soup.material(Material { base_texture: Some(0), base_color: Vec3::ONE, ..Material::default() });
    let card = soup.diffuse(0.9, 0.0);
    soup.quad(Vec3::new(-2.0, -2.0, 0.0), 4.0 * Vec3::X, 4.0 * Vec3::Y, wall);
    let (sin, cos) = 0.3f32.sin_cos();
    soup.quad(Vec3::new(-0.6, -0.5, before), Vec3::new(cos, sin, 0.0), Vec3::new(-sin, cos, 0.0), card);
    soup.0.lights.push(Light::Point { position: eye, intensity: Vec3::splat(100.0) });
    soup.0
}

/// Root mean square, over four seeds, of the relative RMSE of one pass against 512, with and without antialiased edges.
fn errors_of_one_pass(ctx: &Context, scene: &Scene, camera: Camera) -> [f64; 2] {
    let settings = |antialias, seed| Settings { antialias, seed, max_depth: 2, particles: 1, ..Settings::plain() };
    let many = render(ctx, scene, camera, &settings(false, 1000), 512).color;
    let mut squares = [0.0; 2];
    for seed in 0..4 {
        for (square, antialias) in squares.iter_mut().zip([true, false]) {
            let (energy, error) = compare(&render(ctx, scene, camera, &settings(antialias, seed), 1).color, &many);
            println!("seed {seed}, antialiased {antialias}: energy {energy:.4}, relative RMSE {error:.4}");
            *square += error * error;
        }
    }
    squares.map(|sum| (sum / 4.0).sqrt())
}

#[test]
fn one_pass_shows_edges_as_many_do() {
    gpu_test(|ctx| {
        // Nobody sees a shadow, so only eye rays matter.
        let eye = Vec3::new(0.3, 0.2, 6.0);
        let [smooth, plain] =
            errors_of_one_pass(ctx, &card_and_squares(eye, 0.5), camera(eye, Vec3::ZERO, 35.0, [61, 47]));
        assert!(smooth < 0.5 * plain, "{smooth} with more rays at edges, {plain} without");
    });
}

#[test]
fn one_pass_shows_edges_in_a_mirror_as_many_do() {
    gpu_test(|ctx| {
        // The same on the wall, seen in a mirror behind the light: a shadow of the card would show.
        let light = Vec3::new(0.3, 0.2, 6.0);
        let mut soup = Soup(card_and_squares(light, 0.001));
        let silver = soup.material(Material {
            surface: Surface::Mirror,
            base_color: Vec3::ZERO,
            specular: Vec3::new(0.9, 0.8, 0.7),
            ..Material::default()
        });
        soup.quad(Vec3::new(6.0, -6.0, 8.0), -12.0 * Vec3::X, 12.0 * Vec3::Y, silver);
        let eye = Vec3::new(0.1, 0.1, 3.0);
        let [smooth, plain] = errors_of_one_pass(ctx, &soup.0, camera(eye, Vec3::new(0.0, 0.0, 16.0), 12.0, [61, 47]));
        assert!(smooth < 0.6 * plain, "{smooth} with more rays at edges, {plain} without");
    });
}
