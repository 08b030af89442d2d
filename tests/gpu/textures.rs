//! Textures on the device: pages, levels, wraps; and images of textures that are finer than pixels.

use std::path::Path;

use glam::{Vec2, Vec3, Vec4};
use lightsum::Settings;
use lightsum::bsdf::sample_filtered;
use lightsum::device_scene::texels::DeviceTextures;
use lightsum::gpu::{Buffer, Context, Image, Kernel, LayerLimits, Memory, Resources, Staging, download, upload};
use lightsum::scene::mip::level_count;
use lightsum::scene::{Alpha, Camera, Light, Material, Scene, Texture, Wrap};

use crate::renderer::path_traced;
use crate::rig::Numbers;
use crate::scenes::{Soup, camera, compare, render};
use crate::support::{gpu_test, kernels};

const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];

/// Textures of awkward sizes, all wraps and both encodings, full of noise.
fn noisy() -> Scene {
    let sizes = [(1, 1), (27, 3), (13, 17), (2, 97), (64, 64), (101, 1), (31, 33), (128, 128), (5, 4)];
    let mut random = Numbers(7);
    let mut scene = Scene { name: String::from("noise"), ..Scene::default() };
    for (i, (width, height)) in sizes.into_iter().enumerate() {
        let texels = (0..width * height).map(|_| [0; 4].map(|_: u8| (256.0 * random.next()) as u8)).collect();
        let wrap = [WRAPS[i % 3], WRAPS[i / 3 % 3]];
        let name = format!("{width}x{height}");
        scene.textures.push(Texture { name, width, height, texels, srgb: i % 2 == 0, wrap });
        // Every third one counts by alpha.
        let alpha = if i % 3 == 0 { Alpha::Blend { opacity: 0.5 } } else { Alpha::Opaque };
        scene.materials.push(Material { base_texture: Some(i as u32), alpha, ..Material::default() });
    }
    scene
}

/// The values that the device finds at `wanted`.
fn sampled(ctx: &Context, scene: &Scene, limits: &LayerLimits, wanted: &[Vec4]) -> (Vec<Vec4>, usize) {
    let mut staging = Staging::new();
    let textures = DeviceTextures::within(ctx, &mut staging, scene, limits).unwrap();
    let wanted_buffer = upload(ctx, "wanted", wanted).unwrap();
    let values = Buffer::new(ctx, "values", size_of_val(wanted) as u64, Memory::Device).unwrap();
    let kernel = Kernel::new(ctx, &kernels::TEXTURE_SAMPLES).unwrap();
    let own = Resources::of([("wanted", &wanted_buffer), ("values", &values)]);
    let bindings = kernel.bind_from(&[&own], &textures.resources()).unwrap();
    ctx.submit_and_wait("samples", None, |rec| {
        staging.record(rec)?;
        rec.dispatch(&kernel, &bindings, &[], wanted.len().div_ceil(64) as u64)
    })
    .unwrap();
    (download(ctx, &values).unwrap(), textures.pages.len())
}

#[test]
fn lookups_follow_the_oracle_on_every_level_and_page() {
    gpu_test(|ctx| {
        let scene = noisy();
        let mut random = Numbers(1);
        let mut wanted = Vec::new();
        for (i, t) in (0u32..).zip(&scene.textures) {
            let extent = (t.width as f32 * t.height as f32).sqrt();
            let levels = level_count([t.width, t.height]);
            let mut at = |u: f32, v: f32, footprint: f32| wanted.push(Vec4::new(u, v, footprint, f32::from_bits(i)));
            for level in 0..=levels {
                for _ in 0..60 {
                    let [u, v] = [0, 1].map(|_| 8.0 * random.next() - 4.0);
                    at(u, v, (level as f32 + random.next()).exp2() / extent);
                    at(u, v, 0.0);
                    at(u, v, -1.0);
                }
                // At the corners and seams of the texture.
                for (u, v) in [(0.0, 0.0), (1.0, 1.0), (-1e-9, 2.0), (0.5, -1.0), (1e4, -1e4), (2.0, 0.999_999_94)] {
                    at(u, v, (level as f32).exp2() / extent);
                }
            }
            // Wider than anything.
            [1e10, 1e30, f32::INFINITY].into_iter().for_each(|wide| at(0.3, 0.7, wide));
        }
        let whole = Image::layer_limits(ctx).unwrap();
        let few = LayerLimits { size: [128, 128], layers: 1, bytes: 4 * 128 * 128 };
        for (limits, expected_pages) in [(whole, 1), (few, 2)] {
            let (found, pages) = sampled(ctx, &scene, &limits, &wanted);
            assert!(pages >= expected_pages, "{pages} pages");
            let mut coarse = 0;
            for (at, found) in wanted.iter().zip(found) {
                let (index, uv) = (at.w.to_bits(), at.truncate().truncate());
                let expected = sample_filtered(&scene, index, uv.to_array(), at.z.max(0.0));
                let off = (found - expected).abs().max_element();
                // Places far from the first period are exact to 1e-3 of a texel.
                let bound = if uv.abs().max_element() > 100.0 { 0.05 } else { 2e-4 };
                assert!(off <= bound, "{index} at {at}: {found} for {expected}");
                coarse += usize::from(expected != sample_filtered(&scene, index, uv.to_array(), 0.0));
            }
            assert!(coarse > 1000, "{coarse} on coarse levels");
        }
    });
}

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
