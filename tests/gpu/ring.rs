//! Rings of path images and of path lights (Keller 1997, 4.3): the sum against its oracle, the number of lights, the limit, and what is
//! left of lights that went out.

use glam::{Affine3A, DVec4, Vec3, Vec4};
use lightsum::film::Film;
use lightsum::gpu::{Buffer, Context, Resources, download, upload};
use lightsum::output::{Layers, Wanted};
use lightsum::pass::layout::PointLight;
use lightsum::pass::ring::{self as images, decoded, encoded};
use lightsum::pass::{ShadingPoints, accumulate};
use lightsum::ring::{Form, Ring};
use lightsum::scene::{Camera, Material, Scene, builtin};
use lightsum::settings::Compensation;
use lightsum::{Engine, Renderer, Settings};

use crate::embed::{image, message, ready};
use crate::rig::{Rig, make};
use crate::scenes::{Soup, camera, compare, mean, render};
use crate::support::{AWKWARD_SIZES, gpu_test, unwatched};
use lightsum::conform::Numbers;
use lightsum::conform::checks::film::{Sheet, fill};

fn ring(form: Form, length: u32) -> Option<Ring> {
    Some(Ring { length, ..Ring::new(form) })
}

/// Settings of a ring for quick passes.
fn small(form: Form, length: u32) -> Settings {
    Settings { ring: ring(form, length), photons: 0, seed: 3, ..Settings::plain() }
}

/// The pass over the sheet's film.
fn pass(ctx: &Context, sheet: &Sheet, status: &Buffer) -> images::Ring {
    let shared = Resources::of([("frame", &sheet.frame), ("status", status)]);
    let kept = sheet.film.ring.as_ref().unwrap();
    make(ctx, shared, |kit| images::Ring::new(kit, (&sheet.receivers, &sheet.paths, &sheet.sums), &sheet.film, kept))
}

fn sheet(ctx: &Context, size: [u32; 2], length: u32) -> Sheet {
    let sheet = Sheet::new(ctx, size, 1);
    Sheet { film: Film::new(ctx, size[0] * size[1], false).unwrap().with_ring(ctx, Some(length)).unwrap(), ..sheet }
}

/// The three levels of a sum, added exactly enough.
fn colour(ctx: &Context, film: &Film) -> Vec<DVec4> {
    let levels = film.color[0].0.iter().map(|level| download::<Vec4>(ctx, level).unwrap()).collect::<Vec<_>>();
    (0..film.pixels() as usize).map(|i| levels.iter().map(|level| level[i].as_dvec4()).sum()).collect()
}

#[test]
fn a_ring_follows_its_oracle() {
    gpu_test(|ctx| {
        for size in AWKWARD_SIZES {
            let s = sheet(ctx, [size as u32, 1], 3);
            let n = &mut Numbers(size as u32);
            let all = ShadingPoints::COVERED | ShadingPoints::LIT | ShadingPoints::HIT;
            let flags = |i: u32| ShadingPoints::word(if i.is_multiple_of(3) { 0 } else { all });
            let through = fill(ctx, &s.paths.throughput, n, 1.0, |_| 2.5);
            let normal = fill(ctx, &s.receivers.shading, n, 1.0, |_| 0.0);
            let kd = fill(ctx, &s.receivers.kd, n, 1.0, |_| 1.0);
            let f0 = fill(ctx, &s.receivers.f0, n, 1.0, |_| 1.0);
            fill(ctx, &s.receivers.wo, n, -1.0, flags);
            let (good, bad) = ([0u32; 4], [1u32, 0, 0, 0]);
            let status = upload(ctx, "status", &good).unwrap();
            let pass = pass(ctx, &s, &status);
            ctx.submit_and_wait("clear", None, |rec| s.film.buffers().try_for_each(|buffer| rec.fill(buffer, 0)))
                .unwrap();
            let mut kept = vec![[[0; 2]; 3]; size];
            // Five steps into a ring of three; the second is left out.
            for step in 0..5u32 {
                let emitted = fill(ctx, &s.receivers.emitted, n, 3.0, |_| 0.0);
                let light = [&s.sums.direct, &s.sums.indirect, &s.sums.specular].map(|b| fill(ctx, b, n, 1.0, |_| 0.0));
                let left_out = step == 1;
                ctx.submit_and_wait("a step", None, |rec| {
                    rec.update(&status, 0, bytemuck::cast_slice(if left_out { &bad } else { &good }))?;
                    pass.record(rec, step)
                })
                .unwrap();
                let counts: Vec<u32> = download(ctx, &s.film.counts).unwrap();
                assert_eq!(counts[..2], [[1, 1, 2, 2, 3][step as usize], 0], "step {step}");
                if left_out {
                    continue;
                }
                let sums = colour(ctx, &s.film);
                let of = |sum: &lightsum::film::Sum| download::<Vec4>(ctx, &sum.0[0]).unwrap();
                let [direct, indirect, albedo, normals] =
                    [&s.film.direct, &s.film.indirect, &s.film.albedo, &s.film.normal].map(of);
                for i in 0..size {
                    let lit = !i.is_multiple_of(3);
                    let light = light.each_ref().map(|sums| if lit { sums[i].truncate() } else { Vec3::ZERO });
                    let beta = through[i].truncate();
                    let radiance = accumulate::reference(emitted[i].truncate(), beta, kd[i].truncate(), light);
                    let coverage = if lit { 1.0 } else { 0.0 };
                    kept[i][step as usize % 3] = encoded(radiance.extend(coverage));
                    let expected: DVec4 = kept[i].iter().map(|word| decoded(*word).as_dvec4()).sum();
                    // The radiance itself is rounded differently.
                    let off = (sums[i] - expected).abs().max_element();
                    assert!(off <= 1e-4 * expected.max_element(), "pixel {i}, step {step}: {} for {expected}", sums[i]);
                    let images = counts[0] as f32;
                    let near = |a: Vec4, b: Vec3| (a.truncate() - b * images).abs().max_element() <= 1e-4 * images;
                    let layers = near(direct[i], light[0])
                        && near(indirect[i], light[1])
                        && near(albedo[i], beta * (kd[i] + f0[i]).truncate())
                        && near(normals[i], normal[i].truncate() * coverage);
                    assert!(layers, "layers of pixel {i}, step {step}");
                    if lit {
                        assert!((direct[i].w - 2.5 * sums[i].w as f32).abs() < 1e-3, "depth of pixel {i}");
                    }
                }
            }
        }
    });
}

#[test]
fn the_sum_of_a_ring_stays_exact() {
    gpu_test(|_| {
        const LENGTH: u32 = 7;
        const STEPS: u32 = 10_000;
        let ctx = &unwatched();
        let s = sheet(ctx, [2, 1], LENGTH);
        let status = upload(ctx, "status", &[0u32; 4]).unwrap();
        let pass = pass(ctx, &s, &status);
        let n = &mut Numbers(5);
        // From dim to bright, without common factors: sums in one float would be off after a few steps.
        let radiance = |step: u32, n: &mut Numbers| {
            let scale = [1e-3, 1.0, 1e4][step as usize % 3];
            [0; 2].map(|_| (n.vec3().abs() * scale).extend(0.0))
        };
        let shown: Vec<[Vec4; 2]> = (0..STEPS).map(|step| radiance(step, n)).collect();
        let zeros = |rec: &mut lightsum::gpu::Recorder| {
            let buffers = [&s.receivers.wo, &s.paths.throughput, &s.receivers.kd, &s.receivers.emitted];
            s.film.buffers().chain(buffers).try_for_each(|buffer| rec.fill(buffer, 0))
        };
        ctx.submit_and_wait("clear", None, zeros).unwrap();
        for (chunk, steps) in shown.chunks(1000).enumerate() {
            ctx.submit_and_wait("steps", None, |rec| {
                (0..).zip(steps).try_for_each(|(i, step)| {
                    rec.update(&s.receivers.emitted, 0, bytemuck::cast_slice(step))?;
                    pass.record(rec, 1000 * chunk as u32 + i)
                })
            })
            .unwrap();
        }
        let fresh = |i: usize| {
            let latest = shown.iter().rev().take(LENGTH as usize).map(|step| decoded(encoded(step[i])).as_dvec4());
            latest.sum::<DVec4>()
        };
        assert_eq!(colour(ctx, &s.film), [fresh(0), fresh(1)]);
        // And nothing is left of what has gone.
        ctx.submit_and_wait("black", None, |rec| {
            rec.fill(&s.receivers.emitted, 0)?;
            (STEPS..STEPS + LENGTH).try_for_each(|step| pass.record(rec, step))
        })
        .unwrap();
        for level in &s.film.color[0].0 {
            assert_eq!(download::<Vec4>(ctx, level).unwrap()[..2], [Vec4::ZERO; 2]);
        }
    });
}

#[test]
fn paths_leave_as_many_lights_as_the_paper_says() {
    gpu_test(|ctx| {
        const PATHS: u32 = 1024;
        for rho in [0.25f32, 0.5] {
            let scene = builtin::furnace(rho, 1.0);
            let settings = Settings { max_depth: Settings::MAX_DEPTH, ..small(Form::Lights, PATHS) };
            let rig = Rig::new(ctx, &scene, [1, 1], settings);
            rig.run(|frame, rec| lightsum::stage::Stage::run(&frame.walk, rec));
            let lights: Vec<PointLight> = rig.get(&rig.frame().walk.lights);
            let lit = |light: &&PointLight| light.emit[..3].iter().any(|&e| e > 0.0);
            let mean = lights.iter().filter(lit).count() as f64 / f64::from(PATHS);
            let rho = f64::from(rho);
            let sigma = (rho / (1.0 - rho).powi(2) / f64::from(PATHS)).sqrt();
            let expected = 1.0 / (1.0 - rho);
            assert!((mean - expected).abs() < 3.0 * sigma, "{rho}: {mean} lights for {expected}, sigma {sigma}");
        }
    });
}

/// The Cornell box at a small size.
fn cornell(resolution: [u32; 2]) -> (Scene, Camera) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell/scene.toml");
    let scene = lightsum::scene::load(&path).unwrap();
    let camera = Camera { resolution, ..scene.camera.unwrap() };
    (scene, camera)
}

#[test]
fn rings_have_the_limit_of_the_estimator() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell([24, 18]);
        let plain = Settings { photons: 0, ..Settings::plain() };
        let reference = render(ctx, &scene, camera, &plain, 64);
        let of_ring = |form, length, seed, steps| {
            let settings = Settings { max_depth: plain.max_depth, seed, ..small(form, length) };
            render(&unwatched(), &scene, camera, &settings, steps)
        };
        // Roulette lets fewer paths carry more light, so the error of indirect light is larger than that of as many particles.
        for (length, most) in [(16, 0.7), (256, 0.25)] {
            let (energy, error) = compare(&of_ring(Form::Images, length, 3, length).color, &reference.color);
            println!("images of {length}: energy {energy:.4}, relative error {error:.4}");
            let off = (4.0 * error / f64::from(length).sqrt()).max(0.02);
            assert!((energy - 1.0).abs() < off && error < most, "images of {length}: {energy}, {error}");
        }
        // A step shows one eye ray a pixel, so the irradiance of several seeds is compared.
        let irradiance = |layers: &Layers| layers.direct.iter().zip(&layers.indirect).map(|(a, b)| *a + *b).collect();
        let seeds: Vec<Vec<Vec3>> = (0..16).map(|seed| irradiance(&of_ring(Form::Lights, 64, seed, 1))).collect();
        let means: Vec<Vec3> =
            (0..seeds[0].len()).map(|i| seeds.iter().map(|image| image[i]).sum::<Vec3>() / 16.0).collect();
        let (energy, error) = compare(&means, &irradiance(&reference));
        println!("lights: energy {energy:.4}, relative error {error:.4}");
        assert!((energy - 1.0).abs() < 0.06 && error < 0.25, "lights: {energy}, {error}");
    });
}

/// Two closed rooms, each with a lamp of its own; the camera is in the first.
fn two_rooms() -> (Scene, Camera) {
    let mut soup = Soup::new("two rooms");
    let wall = soup.diffuse(0.5, 0.0);
    // Nearly all paths start at the first.
    let lamps = [3.0, 1e-3].map(|radiance| soup.diffuse(0.0, radiance));
    for (room, lamp) in lamps.into_iter().enumerate() {
        let low = Vec3::X * (5.0 * room as f32);
        soup.room(low, low + Vec3::ONE, [wall, wall, wall, lamp, wall, wall]);
    }
    (soup.0, camera(Vec3::new(0.5, 0.4, 0.1), Vec3::new(0.5, 0.3, 1.0), 70.0, [9, 7]))
}

fn dynamic(ctx: &Context, (scene, camera): (Scene, Camera), settings: &Settings) -> Engine {
    let mut engine = Engine::new_dynamic(ctx, scene, camera, settings.clone()).unwrap();
    ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
    engine.setup_finished();
    engine
}

#[test]
fn lights_that_go_out_are_gone_after_as_many_steps_as_the_ring_has_paths() {
    gpu_test(|ctx| {
        const LENGTH: u32 = 6;
        for form in [Form::Images, Form::Lights] {
            let mut engine = dynamic(ctx, two_rooms(), &Settings { max_depth: 4, ..small(form, LENGTH) });
            let bright = |image: &[[f32; 4]]| image.iter().any(|p| p[..3].iter().any(|&x| x != 0.0));
            assert!(bright(&image(ctx, &mut engine, LENGTH + 2)));
            let lamp = engine.scene().unwrap().materials[1].clone();
            engine.set_material(1, Material { emission: Vec3::ZERO, ..lamp }).unwrap();
            assert_eq!((engine.passes(), engine.passes_unchanged()), (LENGTH + 2, 0), "a ring goes on");
            assert!(bright(&image(ctx, &mut engine, LENGTH - 1)), "{form:?}: one path is left");
            let left = image(ctx, &mut engine, 1);
            assert!(!bright(&left), "{form:?}: {left:?}");
            assert!(left.iter().all(|p| p[3] == 1.0), "{form:?}: coverage");
        }
    });
}

#[test]
fn a_ring_of_lights_is_right_under_motion() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell([24, 18]);
        let settings = Settings { max_depth: 3, compensation: Compensation::Off, ..small(Form::Lights, 16) };
        let mut engine = ready(ctx, &scene, camera, &settings);
        image(ctx, &mut engine, 3);
        let moved = Camera { eye: camera.eye + Vec3::new(60.0, 20.0, 0.0), ..camera };
        engine.set_camera(moved).unwrap();
        assert_eq!(engine.passes(), 3);
        let shown = image(ctx, &mut engine, 1);
        // The same steps with that camera from the start: the same lights, and no trace of the other view.
        let mut fresh = ready(ctx, &scene, moved, &settings);
        let expected = image(ctx, &mut fresh, 4);
        let off = shown.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-3, "{off}");
        // In a ring of images the other view is still there.
        let of_images = Settings { ring: ring(Form::Images, 16), ..settings };
        let mut ghosts = ready(ctx, &scene, camera, &of_images);
        image(ctx, &mut ghosts, 3);
        ghosts.set_camera(moved).unwrap();
        assert_ne!(image(ctx, &mut ghosts, 1), image(ctx, &mut ready(ctx, &scene, moved, &of_images), 4));
    });
}

#[test]
fn rings_go_on_through_changes_and_are_refused_beyond_their_memory() {
    gpu_test(|ctx| {
        let (scene, camera) = cornell([16, 12]);
        for form in [Form::Images, Form::Lights] {
            let settings = Settings { max_depth: 3, ..small(form, 4) };
            let mut renderer =
                Renderer::with_context_dynamic(ctx.clone(), scene.clone(), camera, settings.clone()).unwrap();
            (0..3).for_each(|_| renderer.pass().unwrap());
            let engine = renderer.engine_mut();
            engine.set_transform(1, Affine3A::from_translation(Vec3::Y)).unwrap();
            // Another lens makes another frame, which goes on with the ring.
            engine.set_camera(Camera { aperture: 10.0, ..camera }).unwrap();
            renderer.pass().unwrap();
            assert_eq!((renderer.passes(), renderer.engine().passes_unchanged()), (4, 1), "{form:?}");
            assert_eq!(renderer.error_estimate(), None);
            assert!(mean(&renderer.image(Wanted::Color).unwrap().color).element_sum() > 0.01);
            // The settings that the ring replaces have effect again when it ends.
            let engine = renderer.engine_mut();
            assert_eq!(engine.settings(), &settings);
            assert_eq!(engine.plan().settings.pattern, [1, 1]);
            engine.set_settings(Settings { ring: None, ..settings.clone() }).unwrap();
            assert_eq!((engine.passes(), engine.plan().settings.particles), (0, settings.particles));

            let tight = Ring { memory: 1, length: 1024, form };
            let tight = Settings { ring: Some(tight), max_depth: Settings::MAX_DEPTH, ..settings.clone() };
            let refused = message(engine.set_settings(tight.clone()));
            assert!(refused.contains("--ring-length") && refused.contains("would fit"), "{form:?}: {refused}");
            assert!(message(Engine::new(ctx, &scene, camera, tight)).contains("would fit"));
            let summands = Settings { summands: true, ..settings };
            assert!(message(engine.set_settings(summands)).contains("--summands"));
        }
    });
}
