//! Emitters with textures: closed forms, and whole images against the path tracer.

use glam::{Vec2, Vec3};
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::scene::{Camera, Material, Scene, Surface, Texture, TextureUse, Wrap, builtin};
use lightsum::settings::{Sequence, Settings};

use crate::references::path_traced;
use crate::scenes::{Soup, camera, compare, mean, original, probe, render, settings};
use crate::support::gpu_test;

fn texture(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 3]) -> Texture {
    let rgba = |i: u32| {
        let [r, g, b] = texel(i % width, i / width);
        [r, g, b, 255]
    };
    Texture {
        name: String::from("pattern"),
        width,
        height,
        texels: (0..width * height).map(rgba).collect(),
        srgb: false,
        wrap: [Wrap::Clamp; 2],
    }
}

fn emitter(radiance: Vec3) -> Material {
    Material { base_color: Vec3::ZERO, emission: radiance, emission_texture: Some(0), ..Material::default() }
}

/// Below the centre of a rectangle of which half is black, irradiance is half that of the whole, wherever the halves meet.
#[test]
fn half_a_lamp_gives_half_the_light() {
    gpu_test(|ctx| {
        for (width, sequence) in [(2, Sequence::Halton), (256, Sequence::Sobol)] {
            let mut soup = Soup::new("half a lamp");
            soup.0.textures.push(texture(width, 1, |x, _| if 2 * x < width { [0; 3] } else { [255; 3] }));
            let floor = soup.diffuse(0.5, 0.0);
            soup.quad(Vec3::new(-9.0, 0.0, -9.0), Vec3::Z * 18.0, Vec3::X * 18.0, floor);
            let lamp = soup.material(emitter(Vec3::splat(3.0)));
            soup.quad(Vec3::new(-1.0, 1.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, lamp);
            let view = probe(Vec3::new(3.0, 0.5, 2.0), Vec3::ZERO);
            let found = mean(&render(ctx, &soup.0, view, &Settings { sequence, ..original(256, 2) }, 64).color).x;
            // Configuration factor of a rectangle of 2 x 2 at distance 1 over its centre.
            let expected = 0.5 * 0.5 * 3.0 * 0.5541264240;
            println!("{width} texels: {found} of {expected}");
            assert!((found / expected - 1.0).abs() < 0.004, "{width} texels: {found} of {expected}");
        }
    });
}

/// A closed room whose walls emit by a grey texture is a furnace.
#[test]
fn a_furnace_of_grey_textures() {
    gpu_test(|ctx| {
        let mut scene = builtin::furnace(0.5, 2.0);
        scene.textures.push(texture(4, 4, |_, _| [51; 3]));
        for material in &mut scene.materials {
            material.emission *= 5.0;
            material.emission_texture = Some(0);
        }
        let view = Camera { resolution: [16, 16], ..scene.camera.unwrap() };
        for depth in [1, 2, 4] {
            let layers = render(ctx, &scene, view, &settings(32, depth), 32);
            let expected = 2.0 * (1.0 - 0.5f64.powi(depth as i32)) / 0.5;
            let ratio = mean(&layers.color) / expected;
            println!("depth {depth}: {ratio}");
            let tolerance = if depth == 1 { 1e-5 } else { 0.003 * f64::from(depth) };
            assert!((ratio - 1.0).abs().max_element() < tolerance, "depth {depth}: {ratio}");
        }
    });
}

/// A television, a stained window and a few lit letters in a room with matt, glossy, mirroring and clear things.
pub fn parlour() -> (Scene, Camera) {
    let mut soup = Soup::new("parlour");
    soup.0.textures.push(texture(64, 36, |x, y| match (x, y) {
        (8..24, 6..20) => [250, 240, 220],
        (40..60, 24..34) => [20, 60, 200],
        _ => [(x % 8) as u8, 2, 4],
    }));
    soup.0.textures.push(texture(16, 16, |x, y| match (x / 4 + y / 4) % 3 {
        0 => [200, 30, 20],
        1 => [20, 160, 40],
        _ => [0, 0, 0],
    }));
    soup.0.textures.push(texture(32, 8, |x, y| if x % 6 < 2 && (1..7).contains(&y) { [255; 3] } else { [0; 3] }));
    let grey = soup.diffuse(0.7, 0.0);
    let floor = soup.material(Material {
        base_color: Vec3::new(0.5, 0.4, 0.3),
        roughness: 0.5,
        specular: Vec3::splat(0.04),
        ..Material::default()
    });
    soup.room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), [grey, grey, floor, grey, grey, grey]);
    let screen = soup.material(emitter(Vec3::splat(6.0)));
    soup.quad(Vec3::new(0.9, 0.5, 2.95), Vec3::Y * 0.7, Vec3::X * 1.2, screen);
    let window = soup.material(Material { emission_texture: Some(1), two_sided: true, ..emitter(Vec3::splat(3.0)) });
    soup.quad(Vec3::new(2.9, 0.6, 1.0), Vec3::Z * 1.2, Vec3::Y * 1.2, window);
    // Letters by the second coordinates, on a strip that is no parallelogram.
    let uses = [0, 1, 2, 3].map(|k| k == TextureUse::Emission as usize);
    let letters = soup.material(Material {
        base_color: Vec3::new(0.2, 0.2, 0.6),
        emission_texture: Some(2),
        second_uvs: uses,
        ..emitter(Vec3::new(8.0, 7.0, 5.0))
    });
    let [a, b, c, d] =
        [Vec3::new(0.1, 0.2, 0.6), Vec3::new(0.1, 0.2, 2.4), Vec3::new(0.1, 0.7, 2.0), Vec3::new(0.1, 0.6, 0.7)];
    let first = soup.0.uvs.len();
    soup.triangle([b, a, d], None, [Vec2::ZERO; 3], letters);
    soup.triangle([b, d, c], None, [Vec2::ZERO; 3], letters);
    soup.0.second_uvs = vec![Vec2::ZERO; first];
    soup.0.second_uvs.extend([Vec2::X, Vec2::ZERO, Vec2::Y, Vec2::X, Vec2::Y, Vec2::ONE]);
    let metal = soup.material(Material {
        base_color: Vec3::new(0.9, 0.7, 0.4),
        metallic: 1.0,
        roughness: 0.35,
        ..Material::default()
    });
    let mirror = soup.material(Material {
        surface: Surface::Mirror,
        base_color: Vec3::ZERO,
        specular: Vec3::splat(0.9),
        ..Material::default()
    });
    soup.ball(Vec3::new(1.0, 0.35, 1.9), 0.35, 24, metal);
    soup.ball(Vec3::new(2.0, 0.3, 1.7), 0.3, 24, mirror);
    soup.0.second_uvs.resize(soup.0.uvs.len(), Vec2::ZERO);
    (soup.0, camera(Vec3::new(1.4, 1.2, 0.1), Vec3::new(1.5, 0.5, 2.2), 70.0, [48, 32]))
}

#[test]
fn a_parlour_against_the_path_tracer() {
    gpu_test(|ctx| {
        let (scene, view) = parlour();
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
        for (name, settings, limit) in [
            ("defaults", Settings { max_depth: 5, antialias: false, ..Settings::default() }, 0.08),
            ("plain", Settings { max_depth: 5, ..settings(64, 5) }, 0.12),
        ] {
            let image = render(ctx, &scene, view, &settings, 64).color;
            let (energy, error) = compare(&image, &reference);
            println!("{name}: energy {energy:.4}, relative RMSE {error:.4}");
            assert!((energy - 1.0).abs() < 0.01, "{name}: {energy}");
            assert!(error < limit, "{name}: {error}");
        }
    });
}
