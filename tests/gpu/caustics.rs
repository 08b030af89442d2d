//! Caustics by photons: against closed forms, against the path tracer, and their other guarantees.

use glam::{Vec3, Vec4};
use lightsum::gpu::Context;
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::scene::{Camera, Light, Material, Scene, Surface, builtin};
use lightsum::settings::Settings;
use lightsum::stage::Stage;

use crate::references::path_traced;
use crate::renderer::bits;
use crate::rig::{Rig, gallery, hit_of};
use crate::scenes::{Soup, camera, mean, render, settings};
use crate::support::gpu_test;

/// A perfect mirror.
fn perfect() -> Material {
    Material { surface: Surface::Mirror, base_color: Vec3::ZERO, specular: Vec3::ONE, ..Material::default() }
}

fn shooting(photons: u32) -> Settings {
    Settings { photons, ..settings(4, 5) }
}

/// The photons of a pass as they start: flux of those that hit their target.
fn flux_at_targets(ctx: &Context, scene: &Scene, photons: u32) -> f64 {
    let rig = Rig::new(ctx, scene, [8, 8], shooting(photons));
    rig.run(|frame, rec| frame.photons.as_ref().unwrap().record_start(rec));
    let p = rig.frame().photons.as_ref().unwrap();
    let (hits, flux) = (rig.vec4s(&p.rays.hits), rig.vec4s(&p.flux));
    let aimed = |(hit, flux): (&Vec4, &Vec4)| {
        let hit = hit_of(*hit)?;
        let targets = &rig.engine.device_scene().targets;
        targets.meets(flux.w.to_bits(), hit.triangle).then_some(f64::from(flux.x))
    };
    hits.iter().zip(&flux).filter_map(aimed).sum::<f64>() / f64::from(photons)
}

#[test]
fn the_flux_at_mirrors_and_glass_is_what_lights_send_there() {
    gpu_test(|ctx| {
        let pi = std::f64::consts::PI;
        let view = camera(Vec3::new(0.0, 1.0, -5.0), Vec3::ZERO, 60.0, [8, 8]);
        let check = |what: &str, mut soup: Soup, expected: f64, tolerance: f64| {
            soup.0.camera = Some(view);
            let found = flux_at_targets(ctx, &soup.0, 16_384);
            println!("{what}: {found} W for {expected}");
            assert!((found / expected - 1.0).abs() < tolerance, "{what}: {found} for {expected}");
        };
        // A point light and a ball: I Omega; the ball's faces are slightly inside it.
        let mut soup = Soup::new("ball");
        let glass = soup.material(Material { surface: Surface::Glass, ior: 1.5, ..Material::default() });
        soup.ball(Vec3::ZERO, 0.5, 96, glass);
        soup.0.lights.push(Light::Point { position: Vec3::Y * 2.0, intensity: Vec3::splat(3.0) });
        check("a point and a ball", soup, 3.0 * 2.0 * pi * (1.0 - (1.0f64 - 1.0 / 16.0).sqrt()), 0.005);

        // Parallel light on a slanted mirror: E A cos.
        let mut soup = Soup::new("slanted");
        let mirror = soup.material(perfect());
        soup.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, mirror);
        let direction = Vec3::new(0.6, -0.8, 0.0);
        soup.0.lights.push(Light::Directional { direction, irradiance: Vec3::splat(2.0) });
        check("parallel light and a mirror", soup, 2.0 * 4.0 * 0.8, 0.01);

        // A square lamp over a square mirror, 2 x 2 and 2 apart: the form factor of parallel squares of side s = distance.
        let mut soup = Soup::new("squares");
        let mirror = soup.material(perfect());
        let lamp = soup.diffuse(0.0, 5.0);
        soup.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, mirror);
        soup.quad(Vec3::new(-1.0, 2.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, lamp);
        let form_factor = {
            let (one, two) = (1.0f64, 2.0f64);
            2.0 / pi
                * ((two * two / (one + two)).sqrt().ln() + 2.0 * two.sqrt() * (one / two.sqrt()).atan()
                    - 2.0 * one.atan())
        };
        check("a square lamp and a mirror", soup, form_factor * 5.0 * pi * 4.0, 0.01);
    });
}

#[test]
fn a_paraboloid_brings_parallel_light_to_its_focus() {
    gpu_test(|ctx| {
        // y = r^2 / (4 f) up to r = 1, and a plate at the focus that looks down into it.
        let (f, half, rings, sectors) = (0.8f32, 0.05f32, 48, 96);
        let mut soup = Soup::new("paraboloid");
        let (mirror, plate) = (soup.material(perfect()), soup.diffuse(0.5, 0.0));
        let point = |ring: usize, sector: usize| {
            let (r, phi) = (ring as f32 / rings as f32, std::f32::consts::TAU * sector as f32 / sectors as f32);
            let (x, z) = (r * phi.cos(), r * phi.sin());
            let normal = Vec3::new(-x / (2.0 * f), 1.0, -z / (2.0 * f)).normalize();
            (Vec3::new(x, r * r / (4.0 * f), z), normal)
        };
        for ring in 0..rings {
            for sector in 0..sectors {
                let next = (sector + 1) % sectors;
                let [a, b, c, d] =
                    [point(ring, sector), point(ring, next), point(ring + 1, next), point(ring + 1, sector)];
                for face in [(ring > 0).then_some([a, b, c]), Some([a, c, d])].into_iter().flatten() {
                    soup.triangle(face.map(|v| v.0), Some(face.map(|v| v.1)), [Default::default(); 3], mirror);
                }
            }
        }
        soup.quad(Vec3::new(-half, f, -half), Vec3::X * 2.0 * half, Vec3::Z * 2.0 * half, plate);
        soup.0.lights.push(Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(2.0) });
        soup.0.camera = Some(camera(Vec3::new(0.3, 0.3, 0.0), Vec3::Y * f, 40.0, [8, 8]));
        let photons = 8192;
        let rig = Rig::new(ctx, &soup.0, [8, 8], shooting(photons));
        rig.run(|frame, rec| frame.photons.record(rec));
        let p = rig.frame().photons.as_ref().unwrap();
        let stored: Vec<(Vec3, f32)> = rig
            .vec4s(&p.position)
            .iter()
            .zip(rig.vec4s(&p.flux))
            .filter(|(place, _)| place.w == 1.0)
            .map(|(place, flux)| (place.truncate(), flux.x))
            .collect();
        // All light that enters the polygon of the rim outside the plate's shadow, without loss.
        let n = sectors as f32;
        let rim = 0.5 * n * (std::f32::consts::TAU / n).sin();
        let expected = 2.0 * (rim - 4.0 * half * half);
        let energy = stored.iter().map(|s| s.1).sum::<f32>() / photons as f32;
        let weight: f32 = stored.iter().map(|s| s.1).sum();
        let middle = stored.iter().map(|s| s.0 * s.1).sum::<Vec3>() / weight;
        let spread = (stored.iter().map(|s| s.0.distance_squared(middle) * s.1).sum::<f32>() / weight).sqrt();
        println!("{} photons, {energy} W for {expected}, around {middle}, spread {spread}", stored.len());
        assert!((energy / expected - 1.0).abs() < 0.01, "{energy} W for {expected}");
        assert!(middle.distance(Vec3::Y * f) < 1e-3 && spread < 5e-3, "{middle} {spread}");
    });
}

/// Light over mirrors and glass by the path tracer: all light minus the light that the renderer finds without photons.
fn thrown(scene: &Scene, camera: &Camera, samples: u32, max_depth: u32) -> Vec<Vec3> {
    let image = |specular_paths: SpecularPaths| {
        let resolution = camera.resolution;
        let options = Options {
            resolution,
            samples,
            max_depth,
            max_specular: 8,
            seed: 7,
            specular_paths,
            reflectance: Default::default(),
        };
        path_traced(scene, camera, &options)
    };
    image(SpecularPaths::All).iter().zip(image(SpecularPaths::Eye)).map(|(all, eye)| *all - eye).collect()
}

/// A ball of glass over a dark floor under a lamp, and the floor seen from the side.
fn lens() -> (Scene, Camera) {
    let mut soup = Soup::new("lens");
    let (floor, lamp) = (soup.diffuse(0.1, 0.0), soup.diffuse(0.0, 50.0));
    let glass = soup.material(Material { surface: Surface::Glass, ior: 1.5, ..Material::default() });
    soup.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, floor);
    soup.ball(Vec3::new(0.0, 0.9, 0.0), 0.5, 48, glass);
    soup.quad(Vec3::new(-0.3, 3.0, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6, lamp);
    (soup.0, camera(Vec3::new(1.2, 0.7, 0.0), Vec3::new(0.0, 0.0, 0.0), 40.0, [32, 24]))
}

#[test]
fn the_caustic_of_a_ball_against_the_path_tracer() {
    gpu_test(|ctx| {
        let (scene, camera) = lens();
        let reference = thrown(&scene, &camera, 1024, 6);
        let image = |photons: u32| {
            let settings = Settings { photons, photon_radius: Some(0.01), ..settings(4, 6) };
            render(ctx, &scene, camera, &settings, 32).color
        };
        let (on, off) = (image(4000), image(0));
        let sum = |region: &dyn Fn(usize) -> bool, value: &dyn Fn(usize) -> f32| -> f64 {
            (0..reference.len()).filter(|&i| region(i)).map(|i| f64::from(value(i))).sum()
        };
        let (found, expected) = (|i: usize| on[i].y - off[i].y, |i: usize| reference[i].y);
        let peak = reference.iter().map(|v| v.y).fold(0.0, f32::max);
        let bright = |i: usize| reference[i].y > 0.3 * peak;
        let pixels = (0..reference.len()).filter(|&i| bright(i)).count();
        let energy = sum(&|_| true, &found) / sum(&|_| true, &expected);
        let core = sum(&bright, &found) / sum(&bright, &expected);
        println!("energy {energy:.4} of the path tracer's, {core:.4} in the {pixels} pixels of the core");
        assert!((energy - 1.0).abs() < 0.03, "{energy}");
        assert!(pixels > 5 && (core - 1.0).abs() < 0.06, "{core} in {pixels} pixels");
        // Without photons the ball's shadow is dark.
        assert!(sum(&bright, &|i| off[i].y) < 0.1 * sum(&bright, &|i| on[i].y));
    });
}

/// A metal floor whose lobes eye paths follow, before a mirror: what a point light sends over the mirror looks like a second light. No pixel shows the
/// mirror, which would show that light once more.
#[test]
fn lobes_that_are_followed_show_caustics_of_point_lights() {
    gpu_test(|ctx| {
        let light = |x: f32| Light::Point { position: Vec3::new(x, 1.0, 0.0), intensity: Vec3::splat(3.0) };
        let view = camera(Vec3::new(0.0, 1.0, 1.6), Vec3::new(-0.1, 0.0, -0.1), 30.0, [32, 24]);
        let scene = |mirrored: bool, lights: &[Light]| {
            let mut soup = Soup::new("metal before a mirror");
            let metal = Material { base_color: Vec3::splat(0.8), metallic: 1.0, roughness: 0.6, ..Material::default() };
            let (metal, mirror) = (soup.material(metal), soup.material(perfect()));
            soup.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 3.0, metal);
            if mirrored {
                soup.quad(Vec3::new(1.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::Y * 6.0, mirror);
            }
            soup.0.lights.extend_from_slice(lights);
            soup.0
        };
        let energy = |scene: &Scene, photons: u32| {
            let radius = Some(0.04);
            let settings =
                Settings { photons, photon_radius: radius, mirror_lights: 0, glossy_paths: true, ..settings(2, 4) };
            mean(&render(ctx, scene, view, &settings, 24).color).y
        };
        let with_mirror = scene(true, &[light(0.0)]);
        let by_photons = energy(&with_mirror, 20_000) - energy(&with_mirror, 0);
        let by_image = energy(&scene(false, &[light(0.0), light(2.0)]), 0) - energy(&scene(false, &[light(0.0)]), 0);
        println!("over the mirror {by_photons:.4}, from its image {by_image:.4}");
        assert!((by_photons / by_image - 1.0).abs() < 0.03, "{by_photons} for {by_image}");
    });
}

#[test]
fn the_same_seed_gives_the_same_caustics() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [31, 17], ..scene.camera.unwrap() };
        let base = Settings { photons: 300, pattern: [2, 2], ..settings(8, 3) };
        let image = |settings: Settings| bits(&render(ctx, &scene, camera, &settings, 2));
        let first = image(base.clone());
        assert!(image(base.clone()) == first, "a second renderer");
        assert!(image(Settings { rounds: 9, ..base.clone() }) == first, "nine rounds");
        assert!(image(Settings { photons: 0, ..base.clone() }) != first, "no photons");
        assert!(image(Settings { photon_radius: Some(0.5), ..base.clone() }) != first, "another radius");
    });
}

#[test]
fn scenes_without_mirrors_and_glass_have_no_photons() {
    gpu_test(|ctx| {
        let scene = builtin::single_triangle_light();
        let rig = Rig::new(ctx, &scene, [8, 8], shooting(100));
        assert!(rig.frame().photons.is_none() && rig.engine.device_scene().target_buffers.is_none());
        // Only emitters are seen, or no ideal surface is followed.
        let scene = gallery();
        for settings in [Settings { max_depth: 1, ..shooting(100) }, Settings { max_specular: 0, ..shooting(100) }] {
            assert!(Rig::new(ctx, &scene, [8, 8], settings).frame().photons.is_none());
        }
        // Targets are kept, so that settings may enable photons later.
        assert!(Rig::new(ctx, &scene, [8, 8], shooting(0)).frame().photons.is_none());
    });
}

/// A closed room with a mirror for a wall, a ball of glass, and a lamp that shines at both.
#[test]
fn all_light_of_a_room_with_mirror_and_glass_is_there() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("mirror and glass");
        let (grey, red, lamp) = (soup.diffuse(0.6, 0.0), soup.diffuse([0.6, 0.3, 0.2], 0.0), soup.diffuse(0.0, 8.0));
        let mirror = soup.material(Material {
            surface: Surface::Mirror,
            base_color: Vec3::ZERO,
            specular: Vec3::splat(0.9),
            ..Material::default()
        });
        let glass =
            soup.material(Material { surface: Surface::Glass, base_color: Vec3::ONE, ior: 1.5, ..Material::default() });
        soup.room(Vec3::ZERO, Vec3::splat(2.0), [grey, mirror, grey, grey, red, grey]);
        soup.ball(Vec3::new(1.3, 0.45, 1.2), 0.4, 24, glass);
        soup.quad(Vec3::new(0.7, 1.9, 0.7), Vec3::X * 0.6, Vec3::Z * 0.6, lamp);
        let view = camera(Vec3::new(1.9, 1.2, 0.2), Vec3::new(0.0, 0.7, 1.6), 60.0, [24, 18]);
        soup.0.camera = Some(view);
        let traced = |specular_paths: SpecularPaths| {
            let options = Options {
                resolution: view.resolution,
                samples: 2048,
                max_depth: 7,
                max_specular: 8,
                seed: 7,
                specular_paths,
                reflectance: Default::default(),
            };
            mean(&path_traced(&soup.0, &view, &options)).x
        };
        let image = |photons: u32, mirror_lights: u32| {
            let base = Settings { photons, mirror_lights, max_depth: 7, particles: 64, ..Settings::plain() };
            mean(&render(ctx, &soup.0, view, &base, 96).color).x
        };
        let [eye, lights, all] = [SpecularPaths::Eye, SpecularPaths::VirtualLights, SpecularPaths::All].map(traced);
        let (without, with, mirrored) = (image(0, 0), image(4000, 0), image(4000, 2));
        println!(
            "of all light: eye paths {:.4}, and virtual lights {:.4} (rendered {:.4}), with photons {:.4}, mirrored lights {:.4}",
            eye / all,
            lights / all,
            without / all,
            with / all,
            mirrored / all
        );
        assert!((without / lights - 1.0).abs() < 0.02, "without photons {without} of {lights}");
        assert!(eye / all < 0.8, "{eye} of {all}");
        // Photons fade within their radius of an edge; mirrored lights do not.
        assert!((with / all - 1.0).abs() < 0.02 && (mirrored / all - 1.0).abs() < 0.01, "{with}, {mirrored} of {all}");
    });
}
