//! The engine in a host's command buffers: `examples/embed.rs` unchanged, and other things that a host may do.

use ash::vk;
use lightsum::gpu::{Buffer, Context, ContextOptions, DeviceChoice, Memory, Retained, download};
use lightsum::output::Wanted;
use lightsum::scene::builtin;
use lightsum::settings::Traversal;
use lightsum::{Camera, Engine, Error, RenderOptions, Renderer, Scene, Settings};

use crate::support::{assert_silent, gpu_test};

// The other example has this one as a module.
use crate::hosts::lights_for_rasterizer::embed as example;

pub use example::{Host, Readback};

/// A scene with colour, its camera at a small, odd size, and cheap settings.
pub fn small() -> (Scene, Camera, Settings) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell/scene.toml");
    let scene = lightsum::scene::load(&path).unwrap();
    let camera = Camera { resolution: [33, 21], ..scene.camera.unwrap() };
    (scene, camera, Settings { particles: 4, max_depth: 3, ..Settings::plain() })
}

/// Records setup if asked, one pass and the image.
pub fn record(context: &Context, commands: vk::CommandBuffer, engine: &mut Engine, setup: bool) -> Retained {
    // SAFETY: the command buffer comes from `Host::begin`; all callers hand what is returned to `Host::submit`.
    unsafe {
        context.record_into(commands, None, |rec| {
            if setup {
                engine.record_setup(rec)?;
            }
            engine.record_pass(rec)?;
            engine.record_image(rec)
        })
    }
    .unwrap()
}

/// Renders three passes by the example, and fails unless the renderer shows the same on the device of `witness`.
fn as_rendered(host: &Host, witness: &Context, scene: &Scene, camera: Camera, settings: &Settings) -> example::Picture {
    // The copy states layout GENERAL; the layer checks it against the layout that the engine left.
    let image = example::run(host, scene, camera, settings.clone(), 3).unwrap();
    assert_eq!(image.texels.len(), 33 * 21);

    let device = DeviceChoice::Index(witness.info().index);
    let options = RenderOptions { device, ..RenderOptions::default() };
    let mut renderer = Renderer::new(scene.clone(), camera, settings.clone(), &options).unwrap();
    (0..3).for_each(|_| renderer.pass().unwrap());
    let layers = renderer.layers().unwrap();
    let mean = image.mean();
    for c in 0..3 {
        let expected = layers.color.iter().map(|l| f64::from(l[c])).sum::<f64>() / layers.color.len() as f64;
        assert!(expected > 0.01, "the image is black");
        // The same sums, but the example divides them in single precision.
        assert!((mean[c] - expected).abs() <= 1e-6 * expected, "channel {c}: {} against {expected}", mean[c]);
    }
    image
}

#[test]
fn the_example_renders_what_the_renderer_does() {
    gpu_test(|_| {
        let host = Host::new(true).unwrap();
        // Reports the validation layer's messages, and keeps the device alive while the example starts and ends.
        let witness = host.lend().unwrap();
        let (scene, camera, settings) = small();
        let image = as_rendered(&host, &witness, &scene, camera, &settings);

        // The host's objects are intact, and the same seed gives the same bits.
        let again = example::run(&host, &scene, camera, settings, 3).unwrap();
        assert_eq!(image.texels, again.texels);
        assert_silent(witness.take_messages());
    });
}

#[test]
fn textures_reach_the_device_of_a_host() {
    gpu_test(|_| {
        let host = Host::new(true).unwrap();
        let witness = host.lend().unwrap();
        let scene = crate::rig::gallery();
        let camera = Camera { resolution: [33, 21], ..scene.camera.unwrap() };
        as_rendered(&host, &witness, &scene, camera, &small().2);
        assert_silent(witness.take_messages());
    });
}

#[test]
fn the_example_writes_a_png() {
    let picture = example::Picture { size: [2, 1], texels: vec![[0.0, 1.0, 7.0, 1.0], [0.2140, -1.0, 0.001, 0.0]] };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("picture.png");
    picture.write_png(&path).unwrap();
    let read = image::open(&path).unwrap().into_rgb8();
    // sRGB of 0.2140 is 0.5 (IEC 61966-2-1), of 0.001 it is 0.01292.
    assert_eq!(read.into_raw(), [0, 255, 255, 127, 0, 3]);
}

#[test]
fn two_frames_in_flight_are_two_frames() {
    gpu_test(|_| {
        let host = Host::new(true).unwrap();
        let witness = host.lend().unwrap();
        let (scene, camera, settings) = small();
        let serial = [1, 2].map(|passes| example::run(&host, &scene, camera, settings.clone(), passes).unwrap().texels);

        let context = host.lend().unwrap();
        let mut engine = Engine::new(&context, &scene, camera, settings).unwrap();
        let bytes = engine.image().bytes();
        let readbacks = [Readback::new(&host, bytes).unwrap(), Readback::new(&host, bytes).unwrap()];
        let commands = [host.begin().unwrap(), host.begin().unwrap()];
        let mut recorded = Vec::new();
        for (frame, (&commands, readback)) in commands.iter().zip(&readbacks).enumerate() {
            recorded.push(record(&context, commands, &mut engine, frame == 0));
            readback.record_copy(commands, &engine);
        }
        let submissions: Vec<_> = commands.into_iter().zip(recorded).map(|(c, r)| host.submit(c, r).unwrap()).collect();
        // The engine may be dropped while its commands run: they keep their resources alive.
        engine.setup_finished();
        drop((engine, context));
        submissions.into_iter().for_each(|submission| submission.wait().unwrap());
        for (readback, serial) in readbacks.iter().zip(&serial) {
            assert!(readback.texels() == *serial, "a frame in flight differs from the same frame alone");
        }
        assert_ne!(serial[0], serial[1]);
        assert_silent(witness.take_messages());
    });
}

#[test]
fn two_engines_share_a_device() {
    gpu_test(|_| {
        let host = Host::new(true).unwrap();
        let context = host.lend().unwrap();
        let (scene, camera, settings) = small();
        let other = builtin::furnace(0.5, 1.0);
        let views = [(&scene, camera), (&other, other.camera.unwrap())];
        let alone =
            views.map(|(scene, camera)| example::run(&host, scene, camera, settings.clone(), 1).unwrap().texels);

        // Both in one command buffer, their steps interleaved.
        let mut engines = views.map(|(s, c)| Engine::new(&context, s, c, settings.clone()).unwrap());
        let readbacks = [0, 1].map(|i: usize| Readback::new(&host, engines[i].image().bytes()).unwrap());
        let commands = host.begin().unwrap();
        // SAFETY: as in `record`.
        let recorded = unsafe {
            context.record_into(commands, None, |rec| {
                engines.iter_mut().try_for_each(|engine| engine.record_setup(rec))?;
                engines.iter_mut().try_for_each(|engine| engine.record_pass(rec))?;
                engines.iter().try_for_each(|engine| engine.record_image(rec))
            })
        }
        .unwrap();
        engines.iter().zip(&readbacks).for_each(|(engine, readback)| readback.record_copy(commands, engine));
        host.submit(commands, recorded).unwrap().wait().unwrap();
        for (readback, alone) in readbacks.iter().zip(&alone) {
            assert!(readback.texels() == *alone, "an engine disturbs the other");
        }
        assert_silent(context.take_messages());
    });
}

/// Renders `passes` passes and reads the image.
pub fn image(ctx: &Context, engine: &mut Engine, passes: u32) -> Vec<[f32; 4]> {
    let readback = Buffer::new(ctx, "image", engine.image().bytes(), Memory::Readback).unwrap();
    ctx.submit_and_wait("passes", None, |rec| {
        (0..passes).try_for_each(|_| engine.record_pass(rec))?;
        engine.record_image(rec)?;
        rec.copy_image_to_buffer(engine.image(), &readback)
    })
    .unwrap();
    readback.read().unwrap()
}

pub fn ready(ctx: &Context, scene: &Scene, camera: Camera, settings: &Settings) -> Engine {
    let mut engine = Engine::new(ctx, scene, camera, settings.clone()).unwrap();
    ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
    engine.setup_finished();
    engine
}

pub fn message<T>(result: lightsum::Result<T>) -> String {
    result.err().map(|error: Error| error.to_string()).unwrap_or_default()
}

#[test]
fn another_camera_starts_over() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let other = Camera { eye: camera.eye + glam::Vec3::new(40.0, 30.0, 0.0), ..camera };
        let mut engine = ready(ctx, &scene, camera, &settings);
        assert!(image(ctx, &mut engine, 0).iter().flatten().all(|&x| x == 0.0), "before the first pass all is black");
        let first = image(ctx, &mut engine, 2);
        engine.set_camera(other).unwrap();
        assert_eq!(engine.passes(), 0);
        assert_eq!(image(ctx, &mut engine, 0), first, "the image stays until the next pass");
        let moved = image(ctx, &mut engine, 2);
        assert_ne!(moved, first);
        assert_eq!(moved, image(ctx, &mut ready(ctx, &scene, other, &settings), 2));
        assert_eq!(engine.passes(), 2);
        engine.set_camera(camera).unwrap();
        assert_eq!(image(ctx, &mut engine, 2), first);
        engine.restart();
        assert_eq!(image(ctx, &mut engine, 2), first);

        let wide = Camera { resolution: [34, 21], ..camera };
        assert!(message(engine.set_camera(wide)).contains("33x21"));
        assert!(message(engine.resize([34, 0])).contains("34x0"));
        let blind = Camera { target: camera.eye, ..camera };
        assert!(message(engine.set_camera(blind)).contains("coincide"));
        assert_eq!((engine.passes(), image(ctx, &mut engine, 0)), (2, first.clone()), "all is as before");
        assert!(message(Engine::new(ctx, &scene, blind, settings.clone())).contains("coincide"));
        let mut fresh = Engine::new(ctx, &scene, camera, settings).unwrap();
        let early = message(ctx.submit_and_wait("pass", None, |rec| fresh.record_pass(rec)));
        assert!(early.contains("record_setup"), "{early}");
        assert!(message(fresh.set_rounds(8)).contains("record_setup"));
    });
}

#[test]
fn another_resolution_is_another_image() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let mut engine = ready(ctx, &scene, camera, &settings);
        let first = image(ctx, &mut engine, 2);
        for (resolution, summands) in [([34, 21], false), ([5, 40], true), (camera.resolution, false)] {
            let resized = Camera { resolution, ..camera };
            let settings = Settings { summands, ..settings.clone() };
            engine.set_settings(settings.clone()).unwrap();
            engine.resize(resolution).unwrap();
            assert_eq!(([engine.image().width(), engine.image().height()], engine.passes()), (resolution, 0));
            let black = image(ctx, &mut engine, 0);
            assert_eq!(black.len(), (resolution[0] * resolution[1]) as usize);
            assert!(black.iter().flatten().all(|&x| x == 0.0), "before the first pass all is black");
            let expected = image(ctx, &mut ready(ctx, &scene, resized, &settings), 2);
            assert_eq!(image(ctx, &mut engine, 2), expected, "{resolution:?}");
            engine.resize(resolution).unwrap();
            assert_eq!(engine.passes(), 2, "the same again changes nothing");
        }
        assert_eq!(image(ctx, &mut engine, 0), first);
    });
}

#[test]
fn a_pass_with_lost_rays_is_left_out() {
    gpu_test(|ctx| {
        // Two thousand needles through one point, and 155 steps for each shadow ray: some cannot finish.
        let scene = builtin::deep_scene(2000);
        let camera = Camera { resolution: [9, 7], ..scene.camera.unwrap() };
        let settings = Settings {
            particles: 4,
            max_depth: 2,
            lights_per_dispatch: 64,
            rounds: 1,
            traversal: Traversal::Single,
            ..Settings::plain()
        };
        let mut engine = ready(ctx, &scene, camera, &settings);
        let counts = |engine: &Engine| download::<u32>(ctx, &engine.frame().output.film.counts).unwrap()[..2].to_vec();
        let black = image(ctx, &mut engine, 1);
        assert!(black.iter().flatten().all(|&x| x == 0.0), "a pass with lost rays is in the image");
        assert_eq!(counts(&engine), [0, 0]);

        // With more rounds the next pass succeeds, and the mean is that pass alone.
        engine.set_rounds(256).unwrap();
        let mended = image(ctx, &mut engine, 1);
        engine.setup_finished();
        assert_eq!(counts(&engine), [0, 1]);
        let mut patient = ready(ctx, &scene, camera, &Settings { rounds: 256, ..settings });
        patient.set_passes(1);
        assert_eq!(mended, image(ctx, &mut patient, 1));
        assert!(mended.iter().flatten().any(|&x| x > 0.0));
    });
}

#[test]
fn a_host_may_let_the_library_read_back() {
    gpu_test(|_| {
        let host = Host::new(true).unwrap();
        let witness = host.lend().unwrap();
        let (scene, camera, settings) = small();
        let options = ContextOptions { validation: true, own_work: true, ..ContextOptions::default() };
        // SAFETY: as in `Host::lend`; the host outlives the context.
        let context = unsafe { Context::adopt(host.handles(), &options) }.unwrap();
        let mut engine = Engine::new(&context, &scene, camera, settings).unwrap();
        let commands = host.begin().unwrap();
        let recorded = record(&context, commands, &mut engine, true);
        host.submit(commands, recorded).unwrap().wait().unwrap();
        engine.setup_finished();
        let size = engine.view().size();
        let image = engine.film().mean(&context, size, Wanted::Color).unwrap();
        let mean = image.color.iter().map(|color| color.element_sum()).sum::<f32>() / image.color.len() as f32;
        assert!(mean > 0.01, "the image is black: {mean}");

        // Without leave it does not submit; and what is made from a context is given back with it.
        let reserved = host.lend().unwrap();
        let kept = Buffer::new(&reserved, "kept", 64, Memory::Device).unwrap();
        let error = message(download::<u32>(&reserved, &kept));
        assert!(error.contains("own_work"), "{error}");
        assert!(reserved.allocated_bytes() >= 64 && context.allocated_bytes() > 0);
        drop((kept, engine));
        assert_eq!((reserved.allocated_bytes(), context.allocated_bytes()), (0, 0));
        drop((reserved, context));
        assert_silent(witness.take_messages());
    });
}
