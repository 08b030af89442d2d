//! The whole renderer against the path tracer, and its other guarantees: the same bits for the same seed, states that
//! resume where they stopped, lights that can be read back, consistent layers.

use std::cell::Cell;

use glam::{Vec2, Vec3};
use lightsum::Error;
use lightsum::estimate::relative_error;
use lightsum::gpu::Context;
use lightsum::output::{Layers, Wanted};
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::scene::{self, Alpha, Camera, Material, Scene, Texture, Wrap, builtin};
use lightsum::settings::{Clip, Compensation, Sequence, Settings, Traversal};

use crate::references;
use crate::scenes::{Soup, camera, compare, mean, original, render, renderer, settings};
use crate::support::gpu_test;

/// The Cornell box without its lamp in view: a whole row of pixels at the lamp's edge would measure the number of
/// passes that hit it, and little else.
pub fn cornell() -> (Scene, Camera) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml");
    let scene = scene::load(path.as_ref()).unwrap();
    let target = Vec3::new(278.0, 200.0, 280.0);
    let camera = Camera { target, fov_y: 29.0, resolution: [32, 24], ..scene.camera.unwrap() };
    (scene, camera)
}

/// The path tracer's image of a scene, with mirrors and glass followed as by the renderer.
pub fn path_traced(scene: &Scene, camera: &Camera, samples: u32, max_depth: u32) -> Vec<Vec3> {
    let specular_paths = SpecularPaths::VirtualLights;
    let options = Options {
        resolution: camera.resolution,
        samples,
        max_depth,
        max_specular: 8,
        seed: 7,
        specular_paths,
        reflectance: Default::default(),
    };
    references::path_traced(scene, camera, &options)
}

/// Renders and fails unless the energy is within `energy` and the relative RMSE at most `rmse`.
#[track_caller]
pub fn agrees(what: &str, image: &[Vec3], reference: &[Vec3], energy: f64, rmse: f64) {
    let (ratio, error) = compare(image, reference);
    println!("{what}: energy {ratio:.4}, relative RMSE {error:.4}");
    assert!((ratio - 1.0).abs() <= energy, "{what}: energy ratio {ratio}, allowed is {energy}");
    assert!(error <= rmse, "{what}: relative RMSE {error}, allowed is {rmse}");
}

/// Direct light, which shows the reflectance of every point sharply, and three further reflections. Over seeds the
/// energy varies by 0.0005 and 0.003 (standard deviations), and the error is 0.015 and 0.03 to 0.05 without the
/// reference's noise.
#[track_caller]
pub fn agrees_at_depths(ctx: &Context, scene: &Scene, camera: Camera) {
    let direct = render(ctx, scene, camera, &settings(32, 2), 128);
    agrees("direct light", &direct.color, &path_traced(scene, &camera, 1024, 2), 0.003, 0.03);
    let global = render(ctx, scene, camera, &settings(32, 5), 128);
    agrees("global light", &global.color, &path_traced(scene, &camera, 1024, 5), 0.01, 0.06);
}

#[test]
fn cornell_box_against_the_path_tracer() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        // The reference itself has noise of 0.02.
        let reference = path_traced(&scene, &camera, 2048, 5);
        // 8192 paths: seeds differ by 0.006 in energy; their error is 0.035 to 0.045.
        let standard = render(ctx, &scene, camera, &settings(32, 5), 256);
        agrees("compensated", &standard.color, &reference, 0.015, 0.055);
        let sobol = render(ctx, &scene, camera, &Settings { sequence: Sequence::Sobol, ..settings(32, 5) }, 256);
        agrees("Sobol'", &sobol.color, &reference, 0.015, 0.055);
        let jittered = render(ctx, &scene, camera, &Settings { jitter: true, ..settings(32, 5) }, 256);
        agrees("jittered", &jittered.color, &reference, 0.015, 0.055);
        // Unclipped lights in corners leave bright spots: the energy is right, the error large.
        let plain = render(ctx, &scene, camera, &original(32, 5), 256);
        agrees("original", &plain.color, &reference, 0.015, 0.3);
        // With the same points the difference is the light that clipping removes.
        let clipped =
            render(ctx, &scene, camera, &Settings { compensation: Compensation::Off, ..settings(32, 5) }, 256);
        let (ratio, _) = compare(&clipped.color, &standard.color);
        println!("clipped without compensation: energy {ratio:.4} of the compensated");
        assert!((0.95..0.995).contains(&ratio), "clipping takes some per cent of the light: {ratio}");
    });
}

#[test]
fn the_blur_of_the_default_filter_vanishes() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let settings = Settings { max_depth: 2, ..Settings::default() };
        let reference = path_traced(&scene, &camera, 1024, 2);
        // Three pixels are a tenth of this image: with its blur the filter would leave 0.325 after 64 passes, and 0.136 after 512.
        let [few, many] = [64, 512].map(|passes| {
            let (energy, error) = compare(&render(ctx, &scene, camera, &settings, passes).color, &reference);
            println!("{passes} passes: energy {energy:.4}, relative RMSE {error:.4}");
            assert!((energy - 1.0).abs() < 0.005, "{passes} passes: {energy}");
            error
        });
        assert!(few < 0.08 && many < 0.04, "{few} after 64 passes, {many} after 512");
    });
}

/// A room of coloured walls with a lamp below its ceiling.
fn room(soup: &mut Soup, floor: u32) {
    let [red, green, grey, lamp] = [
        soup.diffuse([0.6, 0.1, 0.1], 0.0),
        soup.diffuse([0.1, 0.5, 0.2], 0.0),
        soup.diffuse(0.6, 0.0),
        soup.diffuse(0.0, [12.0, 11.0, 9.0]),
    ];
    soup.room(Vec3::ZERO, Vec3::new(2.0, 1.5, 2.0), [red, green, floor, grey, grey, grey]);
    soup.quad(Vec3::new(0.6, 1.45, 0.6), Vec3::X * 0.8, Vec3::Z * 0.8, lamp);
}

#[test]
fn glossy_surfaces_against_the_path_tracer() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("glossy");
        // alpha = roughness^2: 0.25 on the floor, 0.36 on the box; below that the lobes of virtual lights are widened.
        let floor = soup.material(Material {
            base_color: Vec3::new(0.3, 0.3, 0.35),
            roughness: 0.5,
            specular: Vec3::splat(0.3),
            ..Material::default()
        });
        let metal = soup.material(Material {
            base_color: Vec3::new(0.9, 0.7, 0.4),
            metallic: 1.0,
            roughness: 0.6,
            ..Material::default()
        });
        room(&mut soup, floor);
        let first = soup.0.triangles.len();
        soup.room(Vec3::new(0.5, 0.0, 0.9), Vec3::new(0.9, 0.6, 1.3), [metal; 6]);
        // Seen from outside.
        soup.0.triangles[first..].iter_mut().for_each(|t| t.vertices.swap(1, 2));
        let camera = camera(Vec3::new(1.0, 0.9, 0.05), Vec3::new(1.0, 0.3, 1.5), 75.0, [32, 24]);
        agrees_at_depths(ctx, &soup.0, camera);
    });
}

/// A checkerboard with a gradient, which has a seam where it repeats.
fn checkers() -> Texture {
    let texel = |i: u32| {
        let (x, y) = (i % 8, i / 8);
        let v = if (x / 2 + y / 2) % 2 == 0 { 40 + 20 * x as u8 } else { 230 };
        [v, 220 - 15 * y as u8, 120, 255]
    };
    Texture {
        name: String::from("checkers"),
        width: 8,
        height: 8,
        texels: (0..64).map(texel).collect(),
        srgb: true,
        wrap: [Wrap::Repeat, Wrap::Mirror],
    }
}

#[test]
fn textures_and_smooth_normals_against_the_path_tracer() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("textured");
        soup.0.textures.push(checkers());
        let floor = soup.material(Material { base_color: Vec3::ONE, base_texture: Some(0), ..Material::default() });
        room(&mut soup, floor);
        // The texture twice along each axis on the floor, whose triangles are the fifth and sixth.
        let vertices: Vec<u32> = soup.0.triangles[4..6].iter().flat_map(|t| t.vertices).collect();
        vertices.iter().for_each(|&v| soup.0.uvs[v as usize] *= Vec2::splat(2.0));
        let white = soup.diffuse([0.7, 0.7, 0.8], 0.0);
        soup.ball(Vec3::new(0.8, 0.4, 1.2), 0.35, 12, white);
        let camera = camera(Vec3::new(1.0, 0.9, 0.05), Vec3::new(1.0, 0.3, 1.5), 75.0, [32, 24]);
        agrees_at_depths(ctx, &soup.0, camera);
    });
}

#[test]
fn normal_maps_and_vertex_colors_against_the_path_tracer() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("bumps");
        let texel = |i: u32| {
            let (x, y) = (i % 8, i / 8);
            [[90, 128, 166][x as usize % 3], [100, 150][y as usize % 2], 230, 255]
        };
        soup.0.textures.push(Texture { texels: (0..64).map(texel).collect(), srgb: false, ..checkers() });
        let bumps = Material { base_color: Vec3::splat(0.8), normal_texture: Some(0), ..Material::default() };
        let floor = soup.material(bumps.clone());
        room(&mut soup, floor);
        let ball = soup.material(Material { specular: Vec3::splat(0.04), roughness: 0.4, ..bumps });
        soup.ball(Vec3::new(0.8, 0.4, 1.2), 0.35, 12, ball);
        let color = |p: &Vec3| Vec3::new(1.0, 0.5 + 0.25 * p.x, 0.6).min(Vec3::ONE);
        soup.0.colors = soup.0.positions.iter().map(color).collect();
        let camera = camera(Vec3::new(1.0, 0.9, 0.05), Vec3::new(1.0, 0.3, 1.5), 75.0, [32, 24]);
        agrees_at_depths(ctx, &soup.0, camera);
    });
}

#[test]
fn leaves_and_panes_against_the_path_tracer() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("leaves and panes");
        let floor = soup.diffuse(0.7, 0.0);
        room(&mut soup, floor);
        // A disc in each quarter of the card.
        let texel = |i: u32| {
            let (x, y) = (i % 32 % 16, i / 32 % 16);
            let (dx, dy) = (x as f32 - 7.5, y as f32 - 7.5);
            [90, 200, 80, if dx * dx + dy * dy < 36.0 { 255 } else { 0 }]
        };
        let texels = (0..32 * 32).map(texel).collect();
        soup.0.textures.push(Texture { width: 32, height: 32, texels, ..checkers() });
        let leaf = Alpha::Mask { opacity: 1.0, cutoff: 0.5 };
        let leaf = soup.material(Material { base_texture: Some(0), alpha: leaf, ..Material::default() });
        soup.quad(Vec3::new(0.2, 0.9, 0.7), Vec3::X * 0.8, Vec3::new(0.0, 0.1, 0.8), leaf);
        let pane = Alpha::Blend { opacity: 0.2 };
        let pane = soup.material(Material { base_color: Vec3::new(0.3, 0.5, 0.9), alpha: pane, ..Material::default() });
        for k in 0..10 {
            soup.quad(Vec3::new(1.1, 0.1, 0.8 + 0.08 * k as f32), Vec3::X * 0.6, Vec3::Y * 0.8, pane);
        }
        let camera = camera(Vec3::new(1.0, 0.9, 0.05), Vec3::new(1.0, 0.5, 1.5), 75.0, [32, 24]);
        // Of the panes each pass shows one or another.
        for (depth, energy, rmse) in [(2, 0.003, 0.03), (5, 0.01, 0.06)] {
            let image = render(ctx, &soup.0, camera, &settings(32, depth), 512);
            agrees("leaves and panes", &image.color, &path_traced(&soup.0, &camera, 2048, depth), energy, rmse);
        }
    });
}

#[test]
fn exported_lights_give_the_same_image() {
    gpu_test(|ctx| {
        let (mut scene, camera) = cornell();
        scene.camera = Some(camera);
        let settings = Settings { compensation: Compensation::Off, ..settings(32, 4) };
        let mut first = renderer(ctx, &scene, camera, &settings);
        first.pass().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lights.gltf");
        let count = first.export_lights(&path).unwrap();
        // All but those of particles that left through the open front.
        let lit = first.lights().unwrap().iter().filter(|l| l.emit[..3].iter().any(|&e| e > 0.0)).count();
        assert_eq!(count, lit);
        let slots = first.engine().plan().lights.slots() as usize;
        assert!(count < slots && count > slots / 2, "{count} of {slots}");

        let again = scene::load(&path).unwrap();
        assert!(!again.emitters_are_lights);
        assert_eq!(again.camera.map(|c| (c.eye, c.fov_y)), Some((camera.eye, camera.fov_y)));
        // Every light is exported unchanged: one pass over them is the whole image, with the same settings. The clipping
        // distance and the pixels' offset stay.
        let mut second = renderer(ctx, &again, camera, &settings);
        second.pass().unwrap();
        let (a, b) = (first.layers().unwrap(), second.layers().unwrap());
        let (energy, error) = compare(&b.color, &a.color);
        println!("re-imported: energy {energy:.6}, relative RMSE {error:.6}");
        // Positions are moved off their surfaces a second time, by 256 units in the last place; this shows at grazing
        // angles.
        assert!((energy - 1.0).abs() < 1e-4 && error < 0.002, "energy {energy}, relative RMSE {error}");

        // Near light of the imported lights is restored as well. The file does not tell their reflections, so near hits are
        // lit by all of them, also where this makes paths longer than allowed: more energy, below one percent.
        let settings = Settings { compensation: Compensation::Exact, ..settings };
        let [a, b] = [&scene, &again].map(|scene| {
            let mut renderer = renderer(ctx, scene, camera, &settings);
            renderer.pass().unwrap();
            renderer.layers().unwrap()
        });
        let (energy, error) = compare(&b.color, &a.color);
        println!("with compensation: energy {energy:.6}, relative RMSE {error:.6}");
        assert!((energy - 1.0).abs() < 0.01 && error < 0.15, "energy {energy}, relative RMSE {error}");
    });
}

/// Bits of every layer of an image.
pub fn bits(layers: &Layers) -> Vec<u32> {
    let vectors = [&layers.color, &layers.albedo, &layers.normal, &layers.direct, &layers.indirect];
    let scalars = [&layers.depth, &layers.alpha];
    let words = vectors.into_iter().flatten().flat_map(|v| v.to_array());
    words.chain(scalars.into_iter().flatten().copied()).map(f32::to_bits).collect()
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let base = settings(16, 5);
        let first = render(ctx, &scene, camera, &base, 3);
        let same = |settings: Settings| bits(&render(ctx, &scene, camera, &settings, 3)) == bits(&first);
        assert!(same(base.clone()), "a second renderer");
        assert!(!same(Settings { seed: 1, ..base.clone() }), "another seed");
        assert!(!same(Settings { jitter: true, ..base.clone() }), "jitter");
        assert!(!same(Settings { sequence: Sequence::Sobol, ..base.clone() }), "another sequence");
        // The division of work must not affect the image.
        assert!(same(Settings { lights_per_dispatch: 1, ..base.clone() }), "one light in each dispatch");
        assert!(same(Settings { lights_per_dispatch: 64, ..base.clone() }), "all lights in one dispatch");
        assert!(same(Settings { rounds: 1, ..base.clone() }), "one round");
        assert!(same(Settings { rounds: 9, ..base }), "nine rounds");
    });
}

#[test]
fn times_and_rays_of_the_passes_add_up() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let mut renderer = renderer(ctx, &scene, camera, &settings(4, 3));
        assert_eq!(renderer.last_pass().rays, 0);
        let mut passes = Vec::new();
        for _ in 0..3 {
            renderer.pass().unwrap();
            passes.push(renderer.last_pass().clone());
        }
        let statistics = renderer.statistics();
        assert_eq!(passes.iter().map(|p| p.rays).sum::<u64>(), statistics.rays);
        assert!(passes.iter().all(|p| p.rays > 32 * 24));

        // Points take the lights that their clusters choose, not the pool.
        let settings = Settings { compensation: Compensation::Off, ..Settings::default() };
        let mut chosen = crate::scenes::renderer(ctx, &scene, camera, &settings);
        chosen.pass().unwrap();
        let (plan, [width, height]) = (chosen.engine().plan().clone(), chosen.engine().view().size());
        let pixels = u64::from(width * height);
        let walked = plan.lights.survivors[1..].iter().sum::<u32>() * settings.classes();
        let most = pixels * u64::from(1 + plan.lists.slots()) + u64::from(walked);
        assert!((pixels..=most).contains(&chosen.last_pass().rays), "{} of {most}", chosen.last_pass().rays);
        let render = statistics.stages.iter().find(|(name, _)| name == "render").unwrap().1;
        let seconds = passes.iter().map(|p| p.seconds).sum::<f64>();
        assert!(seconds <= render && seconds > 0.9 * render, "{seconds} s of {render} s");
        for (i, (name, sum)) in statistics.gpu_passes.iter().enumerate() {
            let each: f64 = passes.iter().map(|p| p.gpu_passes[i].1).sum();
            assert!(passes.iter().all(|p| p.gpu_passes[i].0 == *name) && (each - sum).abs() < 1e-9, "{name}");
        }
    });
}

#[test]
fn rays_that_run_out_of_steps_are_carried_on() {
    gpu_test(|ctx| {
        // With 64 lights in a dispatch a ray has some 150 steps in a round, and this scene needs more.
        let scene = builtin::deep_scene(1500);
        let camera = Camera { resolution: [16, 16], ..scene.camera.unwrap() };
        // Clusters leave rays to the kernel for single ones, which rounds differently; with single rays alone no bit
        // may change.
        let single = Settings { traversal: Traversal::Single, ..settings(16, 3) };
        let few = Settings { lights_per_dispatch: 1, ..single.clone() };
        let many = Settings { lights_per_dispatch: 64, rounds: 1, ..single };
        let expected = render(ctx, &scene, camera, &few, 2);
        let mut renderer = renderer(ctx, &scene, camera, &many);
        renderer.pass().unwrap();
        renderer.pass().unwrap();
        assert!(renderer.engine().plan().settings.rounds > 1, "the scene is not deep enough");
        assert!(bits(&renderer.layers().unwrap()) == bits(&expected));
    });
}

#[test]
fn a_saved_state_goes_on_bit_for_bit() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let settings = settings(8, 5);
        let unbroken = render(ctx, &scene, camera, &settings, 8);
        for stop in [1, 5] {
            let mut first = renderer(ctx, &scene, camera, &settings);
            (0..stop).for_each(|_| first.pass().unwrap());
            let state = first.save_state().unwrap();
            let mut second = renderer(ctx, &scene, camera, &settings);
            assert_eq!(first.fingerprint(), second.fingerprint());
            second.load_state(stop, &state).unwrap();
            assert_eq!(second.passes(), stop);
            (stop..8).for_each(|_| second.pass().unwrap());
            assert!(bits(&second.layers().unwrap()) == bits(&unbroken), "broken off after {stop} passes");
            (stop..8).for_each(|_| first.pass().unwrap());
            assert!(second.error_estimate().is_some());
            assert_eq!(second.error_estimate(), first.error_estimate());
            // A film tells nothing of the error of its passes.
            second.load_film(8, &first.film().unwrap()).unwrap();
            second.pass().unwrap();
            assert_eq!(second.error_estimate(), None);
            assert!(second.save_state().unwrap() != state);
        }
        let mut other = renderer(ctx, &scene, Camera { resolution: [31, 24], ..camera }, &settings);
        let mut whole = renderer(ctx, &scene, camera, &settings);
        let state = whole.save_state().unwrap();
        let refused = other.load_state(1, &state).unwrap_err().to_string();
        assert!(refused.contains("--resume"), "{refused}");
        assert!(whole.load_state(1, &state[1..]).is_err());
    });
}

#[test]
fn a_pass_that_is_broken_off_does_not_count() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let settings = settings(8, 5);
        let unbroken = render(ctx, &scene, camera, &settings, 3);
        let mut renderer = renderer(ctx, &scene, camera, &settings);
        let asked = Cell::new(0);
        let mut broken = 0;
        // Broken off at the first question, then at later ones, up to a pass that is done.
        for last in 0.. {
            asked.set(0);
            let stop = || asked.replace(asked.get() + 1) == last;
            let passes = renderer.passes();
            let done = renderer.pass_unless(&stop).unwrap();
            assert_eq!(renderer.passes(), passes + u32::from(done));
            if done {
                break;
            }
            broken += 1;
            assert_eq!(asked.get(), last + 1);
            if last == 3 {
                assert!(renderer.pass_unless(&|| false).unwrap());
            }
        }
        assert!(broken > 6, "a pass has several parts: {broken}");
        renderer.pass().unwrap();
        assert_eq!(renderer.passes(), 3);
        assert!(bits(&renderer.layers().unwrap()) == bits(&unbroken));
    });
}

#[test]
fn the_estimate_is_as_large_as_the_error() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        // The limit of the estimator itself, clipping included: many passes of other seeds.
        let halton = Settings { compensation: Compensation::Off, ..settings(32, 4) };
        let numbers = |image: &[Vec3]| image.iter().flat_map(|v| v.as_dvec3().to_array()).collect::<Vec<f64>>();
        let image = |seed: u64, passes| {
            numbers(&render(ctx, &scene, camera, &Settings { seed, ..halton.clone() }, passes).color)
        };
        let mut limit = image(99, 512);
        limit.iter_mut().zip(image(98, 512)).for_each(|(a, b)| *a = (*a + b) * 0.5);
        for sequence in [Sequence::Halton, Sequence::Sobol] {
            let (mut estimates, mut errors) = (0.0, 0.0);
            for seed in 0..4 {
                let mut renderer = renderer(ctx, &scene, camera, &Settings { seed, sequence, ..halton.clone() });
                assert_eq!(renderer.error_estimate(), None);
                renderer.pass().unwrap();
                assert_eq!(renderer.error_estimate(), None, "one pass says nothing");
                (1..48).for_each(|_| renderer.pass().unwrap());
                let estimate = f64::from(renderer.error_estimate().unwrap());
                let error = relative_error(&numbers(&renderer.layers().unwrap().color), &limit);
                println!("{sequence:?}, seed {seed}: error {error:.4}, estimated {estimate:.4}");
                // So few pixels, without interleaving, have much of their errors in common: the error of a run scatters.
                assert!((0.5..2.0).contains(&(estimate / error)), "estimated {estimate}, true {error}");
                estimates += estimate * estimate;
                errors += error * error;
            }
            // If the instances shared anything the estimate would be too small for all seeds.
            let ratio = (estimates / errors).sqrt();
            println!("{sequence:?}: over all seeds the estimate is {ratio:.3} of the error");
            assert!((0.77..1.3).contains(&ratio), "{sequence:?}: {ratio}");
        }
    });
}

#[test]
fn an_image_reads_what_is_wanted_and_has_the_bits_of_the_film() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        // More pixels than one piece of the film's mean, and not a multiple of it.
        let camera = Camera { resolution: [67, 41], ..camera };
        for summands in [false, true] {
            let mut renderer = renderer(ctx, &scene, camera, &Settings { summands, ..settings(8, 3) });
            for passes in [1, 3] {
                while renderer.passes() < passes {
                    renderer.pass().unwrap();
                }
                let all = renderer.layers().unwrap();
                assert!(all == renderer.film().unwrap().mean(), "{passes} passes, summands: {summands}");
                assert!(all.indirect.iter().any(|e| *e != Vec3::ZERO) && all.specular.is_empty() != summands);
                let color = renderer.image(Wanted::Color).unwrap();
                assert!(color.color == all.color && color.alpha == all.alpha, "{passes} passes, summands: {summands}");
                let left_out = [&color.albedo, &color.normal, &color.direct, &color.indirect, &color.specular];
                assert!(left_out.iter().all(|layer| layer.is_empty()) && color.depth.is_empty());
            }
        }
    });
}

#[test]
fn layers_make_sense() {
    gpu_test(|ctx| {
        let (scene, _) = cornell();
        let camera = Camera { resolution: [32, 24], ..scene.camera.unwrap() };
        let layers = render(ctx, &scene, camera, &settings(32, 5), 16);
        let white = Vec3::new(0.885809, 0.698859, 0.666422);
        let colors = [white, Vec3::new(0.105421, 0.37798, 0.076425), Vec3::new(0.570068, 0.0430135, 0.0443706)];
        let mut seen = [0; 3];
        for i in 0..layers.color.len() {
            if layers.alpha[i] < 1.0 {
                continue;
            }
            let (n, depth, albedo) = (layers.normal[i], layers.depth[i], layers.albedo[i]);
            assert!((n.length() - 1.0).abs() < 1e-4, "{n}");
            // The box begins at z = 0 and ends at 559.2; the eye is at -800.
            assert!((790.0..1370.0).contains(&depth), "{depth}");
            for (color, count) in colors.iter().zip(&mut seen) {
                *count += u32::from((albedo - color).abs().max_element() < 1e-4);
            }
            // A Lambertian scene: L = albedo E / pi where nothing emits and the pixel shows one material.
            if colors.iter().any(|c| (albedo - c).abs().max_element() < 1e-4) {
                let l = albedo * (layers.direct[i] + layers.indirect[i]) / std::f32::consts::PI;
                let difference = (l - layers.color[i]).abs().max_element();
                assert!(difference <= 1e-4 * l.max_element().max(1e-3), "{l} and {}", layers.color[i]);
            }
        }
        println!("pixels of white, green, red: {seen:?}");
        assert!(seen.iter().all(|&n| n > 20), "{seen:?}");
        assert!(layers.alpha.contains(&0.0), "the image is wider than the box");
        for (i, &alpha) in layers.alpha.iter().enumerate().filter(|(_, alpha)| **alpha == 0.0) {
            assert_eq!((layers.color[i], layers.normal[i], alpha), (Vec3::ZERO, Vec3::ZERO, 0.0));
            assert_eq!(layers.depth[i], f32::INFINITY);
        }
        assert!(mean(&layers.direct).min_element() > 0.0 && mean(&layers.indirect).min_element() > 0.0);
        // The red wall is at the left, seen from the front: x = 552.8.
        let row = 12 * 32;
        let left = (0..32).find(|&x| layers.alpha[row + x] == 1.0).unwrap();
        assert!(layers.albedo[row + left + 1].x > 0.5 && layers.albedo[row + left + 1].y < 0.1);
        assert!((layers.normal[row + left + 1] - Vec3::NEG_X).length() < 0.05);
    });
}

#[test]
fn emitters_alone_are_seen_at_depth_one() {
    gpu_test(|ctx| {
        let (scene, _) = cornell();
        // Some pixels lie within the lamp in every pass.
        let camera = Camera { resolution: [96, 72], ..scene.camera.unwrap() };
        let layers = render(ctx, &scene, camera, &settings(32, 1), 4);
        let brightest = layers.color.iter().copied().reduce(Vec3::max).unwrap();
        assert!((brightest - Vec3::new(18.387, 13.9873, 6.75357)).abs().max_element() < 1e-3, "{brightest}");
        assert!(layers.direct.iter().chain(&layers.indirect).all(|e| *e == Vec3::ZERO));
    });
}

#[test]
fn what_cannot_be_rendered_is_refused() {
    fn refusal(ctx: &Context, scene: &Scene, camera: Camera, settings: Settings) -> Error {
        match lightsum::standalone::Renderer::with_context(ctx.clone(), scene.clone(), camera, settings) {
            Ok(_) => panic!("accepted"),
            Err(error) => error,
        }
    }
    gpu_test(|ctx| {
        let (scene, camera) = cornell();
        let wrong = [
            Settings { particles: 0, ..Settings::plain() },
            Settings { max_depth: 17, ..Settings::plain() },
            Settings { max_specular: 65, ..Settings::plain() },
            Settings { photons: 1 << 19, pattern: [2, 2], ..Settings::plain() },
            Settings { photon_radius: Some(0.0), ..Settings::plain() },
            Settings { rounds: 0, ..Settings::plain() },
            Settings { lights_per_dispatch: 65, ..Settings::plain() },
            Settings { clip: Clip::Distance(f32::NAN), ..Settings::plain() },
        ];
        for (settings, flag) in wrong.into_iter().zip([
            "--particles",
            "--max-depth",
            "--max-specular",
            "--photons",
            "--photon-radius",
            "--rounds",
            "--lights-per-dispatch",
            "--clip",
        ]) {
            let message = refusal(ctx, &scene, camera, settings).to_string();
            assert!(message.contains(flag), "{message}");
        }
        for resolution in [[0, 5], [100_000, 100_000]] {
            let message = refusal(ctx, &scene, Camera { resolution, ..camera }, Settings::plain()).to_string();
            assert!(message.contains("--resolution"), "{message}");
        }
        let mut dark = scene.clone();
        dark.materials.iter_mut().for_each(|m| m.emission = Vec3::ZERO);
        let message = refusal(ctx, &dark, camera, Settings::plain()).to_string();
        assert!(message.contains("light"), "{message}");
    });
}
