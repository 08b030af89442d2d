//! Textures on the device: pages, levels, wraps.

use crate::bsdf::sample_filtered;
use crate::conform::tally::within;
use crate::conform::{Bench, Must, Numbers, kernels};
use crate::device_scene::texels::DeviceTextures;
use crate::gpu::{Buffer, Image, Kernel, LayerLimits, Memory, Resources, Staging, download, upload};
use crate::scene::mip::level_count;
use crate::scene::{Alpha, Material, Scene, Texture, Wrap};
use glam::Vec4;

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
fn sampled(bench: &Bench, scene: &Scene, limits: &LayerLimits, wanted: &[Vec4]) -> (Vec<Vec4>, usize) {
    let mut staging = Staging::new();
    let textures = DeviceTextures::within(bench, &mut staging, scene, limits).must();
    let wanted_buffer = upload(bench, "wanted", wanted).must();
    let values = Buffer::new(bench, "values", size_of_val(wanted) as u64, Memory::Device).must();
    let kernel = Kernel::new(bench, &kernels::TEXTURE_SAMPLES).must();
    let own = Resources::of([("wanted", &wanted_buffer), ("values", &values)]);
    let bindings = kernel.bind_from(&[&own], &textures.resources()).must();
    bench
        .submit_and_wait("samples", None, |rec| {
            staging.record(rec)?;
            rec.dispatch(&kernel, &bindings, &[], wanted.len().div_ceil(64) as u64)
        })
        .must();
    (download(bench, &values).must(), textures.pages.len())
}

pub fn lookups_follow_the_oracle_on_every_level_and_page(bench: &Bench) {
    let scene = noisy();
    let mut random = bench.numbers(1);
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
    let whole = Image::layer_limits(bench).must();
    let few = LayerLimits { size: [128, 128], layers: 1, bytes: 4 * 128 * 128 };
    for (limits, expected_pages) in [(whole, 1), (few, 2)] {
        let (found, pages) = sampled(bench, &scene, &limits, &wanted);
        assert!(pages >= expected_pages, "{pages} pages");
        let mut coarse = 0;
        for (at, found) in wanted.iter().zip(found) {
            let (index, uv) = (at.w.to_bits(), at.truncate().truncate());
            let expected = sample_filtered(&scene, index, uv.to_array(), at.z.max(0.0));
            let off = (found - expected).abs().max_element();
            // Places far from the first period are exact to 1e-3 of a texel.
            let bound = if uv.abs().max_element() > 100.0 { 0.05 } else { 2e-4 };
            assert!(within(off, bound), "{index} at {at}: {found} for {expected}");
            coarse += usize::from(expected != sample_filtered(&scene, index, uv.to_array(), 0.0));
        }
        assert!(coarse > 1000, "{coarse} on coarse levels");
    }
}
