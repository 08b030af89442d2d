//! Light of one point for each square of pixels: its energy, sharp surfaces, odd sizes, and where it has no effect.

use glam::Vec3;
use lightsum::ring::{Form, Ring};
use lightsum::scene::{Camera, Material, Scene, Texture, Wrap, builtin};
use lightsum::settings::{Settings, SoftShadows, Superposition};
use lightsum::standalone::Renderer;

use crate::rig::gallery;
use crate::scenes::{Soup, camera, compare, mean, render, renderer};
use crate::support::gpu_test;

const HALF: u32 = Settings::MAX_SHADING_RATE;

fn cornell(resolution: [u32; 2]) -> (Scene, Camera) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell/scene.toml");
    let scene = lightsum::scene::load(&path).unwrap();
    let camera = Camera { resolution, ..scene.camera.unwrap() };
    (scene, camera)
}

#[test]
fn a_furnace_has_its_radiance_at_any_size() {
    gpu_test(|ctx| {
        let (rho, depth) = (0.5, 5);
        let scene = builtin::furnace(rho, 2.0);
        let expected = 2.0 * (0..depth).map(|j| f64::from(rho).powi(j as i32)).sum::<f64>();
        for resolution in [[1, 1], [3, 2], [27, 1], [31, 17]] {
            let camera = Camera { resolution, ..scene.camera.unwrap() };
            let settings = Settings { shading_rate: HALF, ..crate::scenes::settings(64, depth) };
            let layers = render(ctx, &scene, camera, &settings, 32);
            let found = mean(&layers.color).element_sum() / 3.0;
            println!("{resolution:?}: {found} for {expected}");
            assert!((found / expected - 1.0).abs() < 0.02, "{resolution:?}: {found} for {expected}");
            assert!(layers.alpha.iter().all(|alpha| *alpha == 1.0));
        }
    });
}

/// The image of half the size, with each pixel repeated.
fn repeated(half: &[Vec3], [width, height]: [usize; 2]) -> Vec<Vec3> {
    let across = width.div_ceil(2);
    (0..width * height).map(|i| half[i % width / 2 + i / width / 2 * across]).collect()
}

#[test]
fn an_image_keeps_its_energy_and_surfaces_are_sharp() {
    gpu_test(|ctx| {
        let size = [131, 97];
        let (scene, camera) = cornell(size);
        let reference = render(ctx, &scene, camera, &Settings { max_depth: 5, ..Settings::default() }, 96).color;
        let mut squares = [0.0; 3];
        let mut energies = 0.0;
        for seed in 0..4 {
            let settings = |shading_rate| Settings { max_depth: 5, seed, shading_rate, ..Settings::default() };
            let whole = render(ctx, &scene, camera, &settings(1), 1).color;
            let upsampled = render(ctx, &scene, camera, &settings(HALF), 1).color;
            let small = Camera { resolution: size.map(|n| n.div_ceil(2)), ..camera };
            let half = render(ctx, &scene, small, &settings(1), 1).color;
            let enlarged = repeated(&half, size.map(|n| n as usize));
            let errors = [&whole, &upsampled, &enlarged].map(|image| compare(image, &reference));
            println!("seed {seed}: energy and error {errors:.4?}");
            energies += errors[1].0 / 4.0;
            squares = [0, 1, 2].map(|i| squares[i] + errors[i].1 * errors[i].1 / 4.0);
        }
        let [whole, upsampled, enlarged] = squares.map(f64::sqrt);
        println!(
            "errors {whole:.4}, of half the points {upsampled:.4}, of half the image {enlarged:.4}; {energies:.4}"
        );
        assert!((energies - 1.0).abs() < 0.01, "{energies}");
        assert!(upsampled < 2.2 * whole, "{upsampled} for {whole}");
        assert!(upsampled < 0.2 * enlarged, "{upsampled} for {enlarged}");
    });
}

/// A wall of squares before which a lamp stands, and beyond it nothing.
fn squares() -> (Scene, Camera) {
    let mut soup = Soup::new("squares");
    let texel = |i: u32| if (i / 16 + i).is_multiple_of(2) { [240, 220, 40, 255] } else { [20, 40, 90, 255] };
    let texels = (0..256).map(texel).collect();
    let name = String::from("squares");
    soup.0.textures.push(Texture { name, width: 16, height: 16, texels, srgb: false, wrap: [Wrap::Clamp; 2] });
    let wall = soup.material(Material { base_texture: Some(0), base_color: Vec3::ONE, ..Material::default() });
    let lamp = soup.diffuse(0.0, 8.0);
    soup.quad(Vec3::new(-2.0, -2.0, 0.0), 4.0 * Vec3::X, 4.0 * Vec3::Y, wall);
    soup.quad(Vec3::new(-1.0, 1.0, 2.0), 2.0 * Vec3::X, Vec3::new(0.0, 0.5, 0.5), lamp);
    (soup.0, camera(Vec3::new(0.3, 0.2, 5.0), Vec3::ZERO, 50.0, [75, 59]))
}

#[test]
fn albedo_normals_and_depth_are_those_of_every_pixel() {
    gpu_test(|ctx| {
        let (scene, camera) = squares();
        let image = |shading_rate| {
            render(ctx, &scene, camera, &Settings { shading_rate, antialias: false, ..Settings::default() }, 3)
        };
        let (whole, half) = (image(1), image(HALF));
        assert!((&whole.albedo, &whole.normal, &whole.depth) == (&half.albedo, &half.normal, &half.depth));
        assert!(whole.alpha == half.alpha);
        // Lamps reflect nothing, so that every pixel has the same emission.
        let lamp = |i: &usize| whole.albedo[*i] == Vec3::ZERO && whole.alpha[*i] == 1.0;
        let lamps: Vec<usize> = (0..whole.color.len()).filter(lamp).collect();
        assert!(lamps.len() > 50 && lamps.iter().all(|&i| whole.color[i] == half.color[i]), "{}", lamps.len());
    });
}

#[test]
fn parts_of_images_take_light_as_the_whole() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [141, 59], ..scene.camera.unwrap() };
        let compensation = lightsum::settings::Compensation::Exact;
        for pattern in [[1, 1], [3, 3]] {
            let settings = Settings {
                particles: 6,
                shading_rate: HALF,
                compensation,
                pattern,
                light_pool: 0,
                ..Settings::interactive()
            };
            let passes = |renderer: &mut Renderer| (0..2).for_each(|_| renderer.pass().unwrap());
            let mut whole = renderer(ctx, &scene, camera, &settings);
            passes(&mut whole);
            let image = whole.layers().unwrap();
            let mut part = renderer(ctx, &scene, camera, &settings);
            for (origin, size) in [([0, 0], [141, 59]), ([61, 31], [30, 12]), ([140, 58], [1, 1])] {
                let crop = lightsum::view::Region { origin, size };
                part.set_crop(Some(crop)).unwrap();
                passes(&mut part);
                assert!(part.layers().unwrap().color == image.clone().cut(crop).color, "{pattern:?}, {crop:?}");
            }
        }
    });
}

/// The contents of buffers before a pass must not change its image.
#[test]
fn a_pass_does_not_depend_on_those_before() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [61, 47], ..scene.camera.unwrap() };
        let settings = Settings { particles: 4, shading_rate: HALF, glossy_paths: false, ..Settings::default() };
        let film = |first: u32| {
            let mut renderer = renderer(ctx, &scene, camera, &settings);
            (0..first).for_each(|_| renderer.pass().unwrap());
            renderer.engine_mut().restart();
            (0..2).for_each(|_| renderer.pass().unwrap());
            renderer.layers().unwrap().color
        };
        assert!(film(0) == film(3));
    });
}

#[test]
fn it_goes_with_other_settings_or_has_no_effect() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [50, 37], ..scene.camera.unwrap() };
        let of = |settings: &Settings, camera, shading_rate| {
            let settings = Settings { particles: 4, shading_rate, ..settings.clone() };
            render(ctx, &scene, camera, &settings, 2)
        };
        // A lens, a shutter and sums of summands are of lit points.
        let lens = Camera { aperture: 0.05, ..camera };
        let defaults = Settings::default();
        assert!(of(&defaults, lens, HALF).color == of(&defaults, lens, 1).color, "a lens");
        let summands = Settings { summands: true, ..Settings::default() };
        assert!(of(&summands, camera, HALF).color == of(&summands, camera, 1).color, "summands");
        let ring = Ring { length: 4, ..Ring::new(Form::Images) };
        for (what, settings) in [
            ("mirror images", Settings { superposition: Some(Superposition::default()), ..Settings::default() }),
            ("soft shadows", Settings { soft_shadows: Some(SoftShadows::default()), ..Settings::default() }),
            ("one path", Settings { split: false, ..Settings::default() }),
            ("single rays", Settings { traversal: lightsum::settings::Traversal::Single, ..Settings::default() }),
            ("a ring", Settings { ring: Some(ring), ..Settings::default() }),
            ("emitters alone", Settings { max_depth: 1, ..Settings::default() }),
        ] {
            let (half, whole) = (of(&settings, camera, HALF), of(&settings, camera, 1));
            let ratio = mean(&half.color).element_sum() / mean(&whole.color).element_sum();
            println!("{what}: {ratio:.4}");
            // Emission is that of each pixel.
            let same = settings.max_depth == 1;
            assert!(half.color.iter().all(|l| l.is_finite()) && (half.color == whole.color) == same, "{what}");
            assert!((ratio - 1.0).abs() < 0.1, "{what}: {ratio}");
        }
    });
}

#[test]
fn hosts_read_buffers_of_every_pixel() {
    gpu_test(|ctx| {
        let (scene, camera) = squares();
        let settings = Settings { shading_rate: HALF, antialias: false, ..Settings::default() };
        let mut renderer = renderer(ctx, &scene, camera, &settings);
        renderer.pass().unwrap();
        let layers = renderer.layers().unwrap();
        let buffers = renderer.engine().pass_buffers().unwrap();
        let read = |buffer| lightsum::gpu::download::<glam::Vec4>(ctx, buffer).unwrap();
        let [albedo, direct, indirect] = [buffers.albedo, buffers.direct, buffers.indirect].map(read);
        let emitters = layers.albedo.iter().zip(&layers.color).filter(|(a, l)| **a == Vec3::ZERO && l.x > 0.0).count();
        let same = |i: &usize| {
            let l = albedo[*i].truncate() / std::f32::consts::PI * (direct[*i] + indirect[*i]).truncate();
            (l - layers.color[*i]).abs().max_element() <= 1e-5 * (1.0 + l.max_element())
        };
        let pixels = layers.color.len();
        assert_eq!((0..pixels).filter(same).count(), pixels - emitters);
    });
}
