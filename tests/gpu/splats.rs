//! Splats in whole images: against closed forms, against the path tracer, and what they keep.

use glam::{Affine3A, Vec3, Vec4};
use lightsum::bsdf::Reflectance;
use lightsum::engine::Engine;
use lightsum::error::Error;
use lightsum::gpu::{Context, Staging, download};
use lightsum::pass::splat_light::Hit;
use lightsum::pass::splat_start::SplatState;
use lightsum::path_trace::{Options, SpecularPaths};
use lightsum::ring::{Form, Ring};
use lightsum::sampling::halton::halton;
use lightsum::scene::{Camera, Material, Scene};
use lightsum::settings::{Settings, Splats};
use lightsum::stage::Stage;

use crate::references::path_traced;
use crate::renderer::bits;
use crate::rig::Rig;
use crate::scenes::{Soup, camera, mean, render};
use crate::support::{SENTINEL, gpu_test};

fn with_splats(particles: u32) -> Settings {
    let splats = Some(Splats { particles, ..Splats::default() });
    Settings { particles: 16, photons: 0, mirror_lights: 0, max_depth: 5, splats, ..Settings::default() }
}

/// A room with a lamp, a red wall and a glossy box or ball, as objects of their own.
fn room(ball: bool, roughness: f32) -> (Scene, Camera) {
    let mut soup = Soup::new("glossy thing");
    let white = soup.diffuse(0.7, 0.0);
    let red = soup.diffuse([0.7, 0.1, 0.1], 0.0);
    let lamp = soup.diffuse(0.0, 12.0);
    let base_color = Vec3::splat(0.2);
    let shiny = soup.material(Material { base_color, specular: Vec3::splat(0.5), roughness, ..Material::default() });
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    soup.room(Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 4.0, 2.0), [red, white, white, white, white, white]);
    soup.quad(Vec3::new(-0.5, 3.98, -0.5), x, z, lamp);
    let before = soup.0.triangles.len();
    if ball {
        soup.ball(Vec3::new(-0.3, 1.2, -0.4), 1.0, 32, shiny);
    } else {
        let (low, size) = (Vec3::new(-1.0, 0.0, -1.0), 1.4);
        soup.quad(low + z * size, x * size, y * 2.0, shiny);
        soup.quad(low, z * size, y * 2.0, shiny);
        soup.quad(low + x * size + z * size, -z * size, y * 2.0, shiny);
        soup.quad(low + x * size, -x * size, y * 2.0, shiny);
        soup.quad(low + y * 2.0, z * size, x * size, shiny);
    }
    soup.0.objects.push(String::from("thing"));
    soup.0.triangles[before..].iter_mut().for_each(|t| t.object = 1);
    let view = camera(Vec3::new(1.0, 1.8, 1.9), Vec3::new(-0.4, 1.0, -0.4), 60.0, [48, 36]);
    soup.0.camera = Some(view);
    (soup.0, view)
}

#[test]
fn uniform_light_is_reflected_by_the_albedo_of_the_lobe_up_to_the_rims() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("plate");
        let reflectance = Reflectance::new(Vec3::ZERO, 0.0, 0.6, Vec3::splat(0.5));
        let material =
            Material { base_color: Vec3::ZERO, specular: Vec3::splat(0.5), roughness: 0.6, ..Material::default() };
        let (plate, lamp) = (soup.material(material), soup.diffuse(0.0, 1.0));
        soup.quad(Vec3::ZERO, Vec3::X * 2.0, Vec3::Y, plate);
        soup.quad(Vec3::new(0.0, 0.0, 50.0), Vec3::Y, Vec3::X, lamp);
        // Along the normal: the albedo is the same everywhere but for the perspective.
        soup.0.camera = Some(camera(Vec3::new(1.0, 0.5, 20.0), Vec3::new(1.0, 0.5, 0.0), 2.8, [64, 32]));
        let settings =
            Settings { splats: Some(Splats { particles: 40_000, width: 30.0, alpha: 0.1 }), ..with_splats(1) };
        let rig = Rig::new(ctx, &soup.0, [64, 32], Settings { pattern: [1, 1], filter: None, ..settings });
        let splats = rig.frame().splats.as_ref().unwrap();
        // As many hits as fit, each bringing its share of the irradiance pi.
        let n = 20_000;
        let hits: Vec<[[u32; 4]; 2]> = (0..n)
            .map(|i| {
                let [u, v, a, b] = [0, 1, 2, 3].map(|d| halton(d, i));
                let (r, phi) = (a.sqrt(), std::f32::consts::TAU * b);
                let wi = Vec3::new(r * phi.cos(), r * phi.sin(), (1.0 - a).sqrt());
                let position = Vec3::new(2.0 * u, v, 0.0);
                Hit { position, surface: 1, flux: Vec3::splat(2.0 * std::f32::consts::PI), wi, bounces: 1 }.words()
            })
            .collect();
        let state = SplatState { hits: n, particles: n, ..SplatState::default() };
        let mut staging = Staging::new();
        staging.stage_into(ctx, &splats.hits, 0, &hits).unwrap();
        staging.stage_into(ctx, &splats.state, 0, &[state]).unwrap();
        staging.stage_into(ctx, &splats.surface_hits, 0, &[n]).unwrap();
        rig.run(|frame, rec| {
            splats.record_clear(rec, &rig.parameters)?;
            rec.begin();
            staging.record(rec)?;
            splats.record_grid(rec)?;
            frame.eye.record(rec)?;
            splats.record_find(rec)?;
            rec.fill(&frame.shade.lighting.specular, 0)?;
            splats.record(rec)
        });
        let light = rig.vec4s(&rig.frame().shade.lighting.specular);
        let steps = 200_000;
        let albedo = (0..steps).map(|i| {
            let (wi, weight) = reflectance.sample_lobe(&[], false, Vec3::Z, Vec3::Z, halton(0, i), halton(1, i));
            if wi.z > 0.0 { f64::from(weight.x) * (1.0 - f64::from(reflectance.diffuse_probability())) } else { 0.0 }
        });
        let albedo = albedo.sum::<f64>() / f64::from(steps);
        let seen: Vec<f64> = light.iter().filter(|l| l.x > 0.0).map(|l| f64::from(l.x) / albedo).collect();
        let whole = seen.iter().sum::<f64>() / seen.len() as f64;
        let (low, high) = seen.iter().fold((f64::MAX, 0.0f64), |(low, high), &l| (low.min(l), high.max(l)));
        println!("albedo {albedo}: {whole} of it, {low} to {high}, at {} pixels", seen.len());
        assert!(seen.len() > 1500 && (whole - 1.0).abs() < 0.01, "{whole}");
        assert!(low > 0.85 && high < 1.15, "{low} to {high}");
    });
}

/// Mean of an image where the glossy thing shows.
fn on_thing(image: &[Vec3], albedo: &[Vec3]) -> Vec3 {
    let shows = |a: &Vec3| a.x < 0.67 && a.z > 0.4;
    let shown: Vec<Vec3> = image.iter().zip(albedo).filter(|(_, a)| shows(a)).map(|(c, _)| *c).collect();
    assert!(shown.len() > 200, "{} pixels", shown.len());
    mean(&shown).as_vec3()
}

#[test]
fn boxes_and_balls_are_as_bright_as_the_path_tracers() {
    gpu_test(|ctx| {
        for (what, ball, roughness) in [("box", false, 0.6), ("ball", true, 0.7)] {
            let (scene, view) = room(ball, roughness);
            let options = Options {
                resolution: view.resolution,
                samples: 512,
                max_depth: 5,
                max_specular: 8,
                seed: 0,
                reflectance: Default::default(),
                specular_paths: SpecularPaths::All,
            };
            let reference = path_traced(&scene, &view, &options);
            let layers = render(ctx, &scene, view, &with_splats(60_000), 8);
            let [found, expected] = [&layers.color, &reference].map(|image| on_thing(image, &layers.albedo));
            let ratio = found / expected;
            println!("{what}: {found} for {expected}, {ratio}");
            assert!((ratio - 1.0).abs().max_element() < 0.03, "{what}: {ratio}");
        }
    });
}

/// Records a pass, and marks the rays of the particles: they are overwritten where particles are traced.
fn pass_and_mark(ctx: &Context, engine: &mut Engine) {
    ctx.submit_and_wait("a pass", None, |rec| {
        engine.record_pass(rec)?;
        rec.begin();
        rec.fill(&engine.frame().splats.as_ref().unwrap().rays.origin, SENTINEL)
    })
    .unwrap();
}

fn is_marked(ctx: &Context, engine: &mut Engine) -> bool {
    ctx.submit_and_wait("a pass", None, |rec| engine.record_pass(rec)).unwrap();
    let origins: Vec<Vec4> = download(ctx, &engine.frame().splats.as_ref().unwrap().rays.origin).unwrap();
    origins.iter().all(|origin| origin.x.to_bits() == SENTINEL)
}

#[test]
fn a_view_costs_no_particle_and_an_edit_of_the_scene_traces_all() {
    gpu_test(|ctx| {
        let (scene, view) = room(false, 0.6);
        let mut engine = Engine::new_dynamic(ctx, scene, view, with_splats(500)).unwrap();
        ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
        engine.setup_finished();
        pass_and_mark(ctx, &mut engine);
        assert!(is_marked(ctx, &mut engine), "a second pass");
        engine.set_camera(Camera { eye: view.eye + Vec3::X * 0.3, ..view }).unwrap();
        assert!(is_marked(ctx, &mut engine), "another view");
        engine.set_transform(1, Affine3A::from_translation(Vec3::X * 0.2)).unwrap();
        assert!(!is_marked(ctx, &mut engine), "the box has moved");
        // Other lobes than the surfaces were made for.
        let splats = Some(Splats { alpha: 0.3, ..engine.settings().splats.unwrap() });
        let refused = engine.set_settings(Settings { splats, ..engine.settings().clone() });
        assert!(matches!(refused, Err(Error::Setting { name: "--splat-alpha", .. })), "{refused:?}");
    });
}

#[test]
fn more_particles_leave_those_that_are_there() {
    gpu_test(|ctx| {
        let (scene, _) = room(true, 0.7);
        let stored = |particles: u32| {
            let rig = Rig::new(ctx, &scene, [1, 1], with_splats(particles));
            let splats = rig.frame().splats.as_ref().unwrap();
            rig.run(|_, rec| splats.record_particles(rec, &rig.parameters));
            let state = rig.get::<SplatState>(&splats.state)[0];
            let hits: Vec<[[u32; 4]; 2]> = rig.get(&splats.hits);
            (splats.batches(), state, hits[..state.hits as usize].to_vec())
        };
        let (one, few, first) = stored(32_768);
        let (two, more, all) = stored(36_000);
        assert_eq!((one, two), (1, 2));
        assert_eq!((few.particles, more.particles), (32_768, 36_000));
        assert!(few.hits > 1000 && more.hits > few.hits, "{few:?} {more:?}");
        assert!(first == all[..first.len()]);
        // As many hits for each particle.
        let each = |state: &SplatState| f64::from(state.hits) / f64::from(state.particles);
        assert!((each(&few) / each(&more) - 1.0).abs() < 0.02);
    });
}

#[test]
fn splats_keep_bits_and_leave_other_scenes_alone() {
    gpu_test(|ctx| {
        let (mut scene, view) = room(true, 0.7);
        let image = |scene: &Scene, settings: &Settings| bits(&render(ctx, scene, view, settings, 2));
        let settings = with_splats(2000);
        assert!(image(&scene, &settings) == image(&scene, &settings), "the same seed");
        for material in &mut scene.materials {
            material.specular = Vec3::ZERO;
        }
        let without = Settings { splats: None, ..settings.clone() };
        assert!(image(&scene, &settings) == image(&scene, &without), "nothing is glossy");
    });
}

#[test]
fn what_has_no_splats_is_refused() {
    gpu_test(|ctx| {
        let (scene, view) = room(false, 0.6);
        let refusal = |settings: Settings| match Engine::new(ctx, &scene, view, settings) {
            Err(Error::Setting { name, .. }) => name,
            other => panic!("{:?}", other.err()),
        };
        let with = |splats: Splats| Settings { splats: Some(splats), ..with_splats(1) };
        assert_eq!(refusal(with(Splats { particles: 0, ..Splats::default() })), "--splat-particles");
        assert_eq!(refusal(with(Splats { width: f32::NAN, ..Splats::default() })), "--splat-width");
        assert_eq!(refusal(with(Splats { alpha: -0.1, ..Splats::default() })), "--splat-alpha");
        let ring = Some(Ring { form: Form::Images, length: 4, memory: 100 });
        assert_eq!(refusal(Settings { ring, ..with_splats(1) }), "--ring");
        let mut engine = Engine::new(ctx, &scene, view, Settings { splats: None, ..with_splats(1) }).unwrap();
        let refused = engine.set_settings(with_splats(1));
        assert!(matches!(refused, Err(Error::Setting { name: "--glossy", .. })), "{refused:?}");
    });
}
