//! Memory that an engine takes: as it is estimated without taking it, and its limit.

use lightsum::bake::{self, Bake};
use lightsum::gpu::{Context, ContextOptions};
use lightsum::scene::{Camera, Scene, builtin};
use lightsum::settings::{Settings, Splats};
use lightsum::{Engine, Error, RenderOptions, Renderer, View};

use crate::rig::gallery;
use crate::support::{gpu_test, options};

/// A scene as it is and the settings that take memory in other ways.
fn cases() -> Vec<(&'static str, Scene, [u32; 2], Settings)> {
    let plain = Settings { particles: 16, ..Settings::default() };
    let rich = Settings { photons: 20_000, summands: true, max_depth: 4, ..plain.clone() };
    let interactive = Settings { particles: 64, ..Settings::interactive() };
    let splats = Settings { splats: Some(Splats::default()), ..plain.clone() };
    vec![
        ("a furnace", builtin::furnace(0.5, 1.0), [64, 48], plain.clone()),
        ("a furnace with layers", builtin::furnace(0.5, 1.0), [333, 201], Settings { summands: true, ..plain.clone() }),
        ("a room", builtin::room(5_000), [200, 150], plain.clone()),
        ("a room, interactive", builtin::room(5_000), [320, 200], interactive),
        ("mirrors, glass and photons", gallery(), [160, 120], rich),
        ("splats", gallery(), [96, 72], splats),
        ("half the points", gallery(), [97, 71], Settings { shading_rate: 2, ..plain }),
    ]
}

#[test]
fn the_estimate_is_what_the_allocator_takes() {
    gpu_test(|ctx| {
        for (name, scene, resolution, settings) in cases() {
            let camera = Camera { resolution, ..scene.camera.unwrap() };
            let estimate = Engine::memory_of(ctx, &scene, View::whole(camera), settings.clone()).unwrap();
            assert_eq!(ctx.allocated_bytes(), 0, "{name}: the estimate takes nothing");
            let engine = Engine::with_view(ctx, &scene, View::whole(camera), settings).unwrap();
            let taken = ctx.allocated_bytes();
            println!("{name}: estimate {}, taken {taken}, the most for {:?}", estimate.total(), &estimate.by_name[..3]);
            assert_eq!(ctx.memory_use(), estimate, "{name}");
            let ratio = estimate.total() as f64 / taken as f64;
            assert!((ratio - 1.0).abs() < 0.01, "{name}: {ratio}");
            drop(engine);
            assert_eq!(ctx.memory_use().total(), 0, "{name}");
        }
    });
}

#[test]
fn a_bake_tells_its_memory() {
    gpu_test(|ctx| {
        for (scene, density) in [(builtin::room(2_000), 3.0), (builtin::furnace(0.5, 1.0), 60.0)] {
            let settings = bake::settings(Settings { particles: 16, ..Settings::default() });
            let options = bake::Options { density: Some(density), ..bake::Options::default() };
            let bake = Bake::new(ctx, &scene, settings, options).unwrap();
            let [told, _] = bake.memory().unwrap();
            let renderer = bake.renderer(0, None).unwrap();
            let taken = ctx.memory_use().device;
            println!("{told} bytes told, {taken} taken, {} texels", bake.texels());
            assert!((told as f64 / taken as f64 - 1.0).abs() < 0.1, "{told} of {taken}");
            drop(renderer);
        }
    });
}

#[test]
fn what_does_not_fit_is_refused_before_rendering() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [96, 64], ..scene.camera.unwrap() };
        let settings = Settings { particles: 8, photons: 100_000, ..Settings::default() };
        let needed = Engine::memory_of(ctx, &scene, View::whole(camera), settings.clone()).unwrap().of_device();
        let within = |max_memory: u64| {
            let limited = Context::headless(&ContextOptions { max_memory: Some(max_memory), ..options() }).unwrap();
            Renderer::with_context(limited, scene.clone(), camera, settings.clone())
        };
        // What is read back comes in addition.
        within(needed + (1 << 20)).unwrap();
        for max_memory in [needed - 1, needed / 2, 1000] {
            let error = within(max_memory).err().unwrap();
            assert!(
                matches!(error, Error::TooMuchMemory { needed: n, limit, .. } if n == needed && limit == max_memory)
            );
            let message = error.to_string();
            assert!(message.contains("lower --photons") && message.contains(&needed.to_string()), "{message}");
        }
        let refused = RenderOptions { max_memory: Some(1 << 16), ..RenderOptions::default() };
        assert!(Renderer::new(scene, camera, Settings::default(), &refused).is_err());
    });
}
