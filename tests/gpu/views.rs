//! Views: resizing, crops, strips, atlases; and merged films.

use std::sync::Arc;

use glam::Vec3;
use lightsum::film::HostFilm;
use lightsum::gpu::Context;
use lightsum::output::Layers;
use lightsum::pass::shade::{self, ShadingPoint};
use lightsum::pass::{ShadingPoints, atlas, surface};
use lightsum::plan;
use lightsum::scene::{Camera, Scene};
use lightsum::settings::{Clip, Compensation, Filter, LightChoice, Settings, Superposition};
use lightsum::stage::Stage;
use lightsum::standalone::Renderer;
use lightsum::view::{Atlas, Moving, Region, Texel, View};
use lightsum::{Engine, tiles};

use crate::rig::{close, gallery, has, is_lit};
use crate::scenes::renderer;
use crate::support::gpu_test;

fn camera_of(scene: &Scene, resolution: [u32; 2]) -> Camera {
    Camera { resolution, ..scene.camera.unwrap() }
}

/// The film after some passes.
fn film(renderer: &mut Renderer, passes: u32) -> HostFilm {
    (0..passes).for_each(|_| renderer.pass().unwrap());
    renderer.film().unwrap()
}

/// Settings whose images use every path through the frame that a crop may take.
pub fn all_kinds() -> Vec<(&'static str, Settings)> {
    let plain = Settings { particles: 6, ..Settings::plain() };
    // Near light from pixels needs the whole image.
    let interactive = Settings { particles: 6, compensation: Compensation::Exact, ..Settings::interactive() };
    vec![
        ("progressive", plain.clone()),
        ("interactive", interactive.clone()),
        (
            "wide filter",
            Settings {
                pattern: [2, 3],
                filter: Some(Filter { window: Some([9, 9]), ..Filter::default() }),
                ..plain.clone()
            },
        ),
        ("light lists", Settings { compensation: Compensation::Off, ..interactive.clone() }),
        ("mirrored lights", Settings { mirror_lights: 2, photons: 50, ..plain.clone() }),
        ("single rays", Settings { traversal: lightsum::settings::Traversal::Single, split: false, ..plain }),
    ]
}

fn assert_same(found: &Layers, expected: &Layers, what: &str) {
    assert_eq!((found.width, found.height), (expected.width, expected.height), "{what}");
    for (name, a, b) in [
        ("color", &found.color, &expected.color),
        ("direct", &found.direct, &expected.direct),
        ("indirect", &found.indirect, &expected.indirect),
        ("normal", &found.normal, &expected.normal),
        ("albedo", &found.albedo, &expected.albedo),
    ] {
        let differ = a.iter().zip(b).filter(|(a, b)| a.to_array().map(f32::to_bits) != b.to_array().map(f32::to_bits));
        assert_eq!(differ.count(), 0, "{what}: pixels of {name}");
    }
    assert_eq!(found.depth, expected.depth, "{what}");
}

/// Passes after which pixels take bias away, as those around them tell it.
const PASSES: u32 = 4;

#[test]
fn the_image_of_a_crop_is_the_crop_of_the_image() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = camera_of(&scene, [83, 61]);
        for (name, settings) in all_kinds() {
            let mut whole = renderer(ctx, &scene, camera, &settings);
            film(&mut whole, PASSES);
            let image = whole.layers().unwrap();
            let mut part = renderer(ctx, &scene, camera, &settings);
            for (origin, size) in [([0, 0], [83, 61]), ([17, 9], [30, 22]), ([82, 60], [1, 1]), ([40, 0], [43, 5])] {
                let crop = Region { origin, size };
                part.set_crop(Some(crop)).unwrap();
                film(&mut part, PASSES);
                assert_same(&part.layers().unwrap(), &image.clone().cut(crop), &format!("{name}, {crop:?}"));
            }
        }
    });
}

/// Regions of 96 x 96 pixels choose lights for their clusters: a part of an image has the regions of the whole.
#[test]
fn parts_of_images_choose_lights_as_the_whole() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = camera_of(&scene, [230, 40]);
        for compensation in [Compensation::Off, Compensation::Exact] {
            let settings = Settings { particles: 6, compensation, ..Settings::interactive() };
            let mut whole = renderer(ctx, &scene, camera, &settings);
            film(&mut whole, 1);
            let crop = Region { origin: [140, 10], size: [60, 20] };
            let mut part = renderer(ctx, &scene, camera, &settings);
            part.set_crop(Some(crop)).unwrap();
            assert_eq!(part.engine().view().size(), [134, 40]);
            film(&mut part, 1);
            assert_same(&part.layers().unwrap(), &whole.layers().unwrap().cut(crop), "a part");
            // Another part of the same view starts anew.
            let other = Region { origin: [150, 12], size: [9, 9] };
            part.set_crop(Some(other)).unwrap();
            film(&mut part, 1);
            assert_same(&part.layers().unwrap(), &whole.layers().unwrap().cut(other), "another part");
        }
    });
}

#[test]
fn crops_that_need_the_whole_image_render_it() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = camera_of(&scene, [40, 30]);
        let crop = Region { origin: [7, 5], size: [20, 11] };
        for settings in [
            Settings { superposition: Some(Superposition::default()), ..Settings::plain() },
            Settings { light_choice: LightChoice::Contribution, ..Settings::plain() },
        ] {
            let mut whole = renderer(ctx, &scene, camera, &settings);
            film(&mut whole, 1);
            let mut part = renderer(ctx, &scene, camera, &settings);
            part.set_crop(Some(crop)).unwrap();
            film(&mut part, 1);
            assert_eq!(part.engine().view().size(), [40, 30]);
            assert_same(&part.layers().unwrap(), &whole.layers().unwrap().cut(crop), "whole");
            // A view of the region alone is refused: it would have other bits.
            let region = Region { origin: [0, 0], size: [24, 16] };
            let view = View::Camera { camera, region };
            assert!(Engine::with_view(ctx, &scene, view, settings).err().unwrap().to_string().contains("whole image"));
        }
        let mut part = renderer(ctx, &scene, camera, &Settings::plain());
        for (origin, size) in [([0, 0], [41, 3]), ([39, 29], [1, 2]), ([5, 5], [0, 4]), ([u32::MAX, 0], [2, 2])] {
            let refused = part.set_crop(Some(Region { origin, size })).unwrap_err().to_string();
            assert!(refused.contains("beyond the image of 40x30"), "{refused}");
        }
    });
}

#[test]
fn strips_have_the_bits_of_the_whole_image() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = camera_of(&scene, [64, 70]);
        for (name, settings) in all_kinds() {
            let mut whole = renderer(ctx, &scene, camera, &settings);
            film(&mut whole, PASSES);
            let strips = tiles::cut(camera.resolution, &settings, 64 * 48);
            assert!(strips.len() > 1, "{name}");
            let mut parts = renderer(ctx, &scene, camera, &settings);
            let mut told = Vec::new();
            let mut image = Layers::default();
            // The second call goes on after the first strip.
            assert!(!tiles::render(&mut parts, &strips, PASSES, &mut image, |done| done <= PASSES).unwrap(), "{name}");
            assert_eq!(image.height, strips[0].size[1], "{name}");
            let whole_image = tiles::render(&mut parts, &strips, PASSES, &mut image, |done| {
                told.push(done);
                true
            });
            assert!(whole_image.unwrap(), "{name}");
            assert_same(&image, &whole.layers().unwrap(), name);
            assert_eq!(told, (PASSES..PASSES * strips.len() as u32).collect::<Vec<_>>());
        }
        // The image fits this device, so there are no strips.
        assert_eq!(tiles::strips(ctx.info(), &scene, &camera, &Settings::plain()).len(), 1);
        let huge = camera_of(&scene, [7680, 4320]);
        let strips = tiles::strips(ctx.info(), &scene, &huge, &Settings::plain());
        let slots = ctx.info().max_storage_buffer_range / 16;
        assert_eq!(strips.len() == 1, 2 * 7680 * 4320 <= slots);
    });
}

#[test]
fn resizing_keeps_the_scene_and_the_kernels() {
    gpu_test(|ctx| {
        let scene = gallery();
        let settings = Settings { particles: 6, ..Settings::interactive() };
        let mut resized = renderer(ctx, &scene, camera_of(&scene, [64, 48]), &settings);
        film(&mut resized, 1);
        let handles = |renderer: &Renderer| {
            let scene = renderer.engine().device_scene();
            [&scene.node_min, &scene.v0, &scene.materials, &scene.emitter_records].map(|buffer| buffer.handle())
        };
        let (before, kernels) = (handles(&resized), ctx.pipeline_count());
        for resolution in [[80, 60], [27, 1], [64, 48]] {
            resized.engine_mut().resize(resolution).unwrap();
            let mut fresh = renderer(ctx, &scene, camera_of(&scene, resolution), &settings);
            let (resized_film, fresh_film) = (film(&mut resized, 2), film(&mut fresh, 2));
            assert_eq!(resized_film.size(), resolution);
            assert!(resized_film == fresh_film, "the bits of an engine of this size: {resolution:?}");
            let image = resized.engine().image();
            assert_eq!([image.width(), image.height()], resolution);
            ctx.submit_and_wait("image", None, |rec| resized.engine().record_image(rec)).unwrap();
        }
        assert_eq!(handles(&resized), before, "the scene's buffers stay");
        assert_eq!(ctx.pipeline_count(), kernels, "no pipeline was made again");
        let too_large = resized.engine_mut().resize([1 << 14, 1 << 14]).unwrap_err().to_string();
        assert!(too_large.contains("more than"), "{too_large}");
        assert_eq!(resized.engine().view().size(), [64, 48], "an error changes nothing");
        film(&mut resized, 1);
    });
}

#[test]
fn films_of_disjoint_passes_merge_to_the_film_of_all() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = camera_of(&scene, [31, 17]);
        for settings in [
            Settings { summands: true, particles: 5, ..Settings::plain() },
            Settings { particles: 5, ..Settings::interactive() },
        ] {
            let mut all = renderer(ctx, &scene, camera, &settings);
            let empty = all.film().unwrap();
            let whole = film(&mut all, 7).canonical();
            let shard = |passes: &[u32]| {
                let mut part = renderer(ctx, &scene, camera, &settings);
                part.load_film(passes[0], &empty).unwrap();
                for &pass in passes {
                    part.engine_mut().set_passes(pass);
                    part.pass().unwrap();
                }
                part.film().unwrap()
            };
            let (first, rest, odd) = (shard(&[0, 1, 2, 6]), shard(&[3, 4, 5]), shard(&[1, 3, 5]));
            let mut merged = rest.clone();
            merged.merge(&first).unwrap();
            assert!(merged == whole, "two shards");
            assert_eq!(merged.passes(), 7);
            let mut merged = shard(&[0, 6]);
            for part in [&odd, &shard(&[4]), &shard(&[2])] {
                merged.merge(part).unwrap();
            }
            assert!(merged == whole, "four shards, in another order");
            assert_same(&merged.mean(), &whole.mean(), "the mean");
            // A merged film continues like any other.
            all.load_film(7, &merged).unwrap();
            let mut through = renderer(ctx, &scene, camera, &settings);
            assert!(film(&mut all, 2).canonical() == film(&mut through, 9).canonical());
        }
    });
}

/// Texels on the triangles of a scene, some on none.
fn texels(scene: &Scene, size: [u32; 2]) -> Atlas {
    let count = size[0] * size[1];
    let texel = |i: u32| {
        let uv = [0.1 + 0.5 * (i % 7) as f32 / 7.0, 0.05 + 0.3 * (i % 5) as f32 / 5.0];
        (i % 11 != 3).then_some(Texel { triangle: i * 13 % scene.triangles.len() as u32, uv, back: i % 4 == 2 })
    };
    Atlas::new(size, (0..count).map(texel).collect())
}

#[test]
fn texels_of_an_atlas_follow_the_shading_oracle() {
    gpu_test(|ctx| {
        let scene = gallery();
        let settings =
            Settings { clip: Clip::Distance(0.0), compensation: Compensation::Off, particles: 9, ..Settings::plain() };
        for size in [[1, 1], [27, 1], [8, 8], [31, 17]] {
            let atlas = Arc::new(texels(&scene, size));
            let view = View::Atlas(atlas.clone());
            let mut engine = Engine::with_view(ctx, &scene, view, settings.clone()).unwrap();
            let parameters = engine.plan().parameters(0).unwrap();
            ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
            engine.setup_finished();
            let frame = engine.frame();
            ctx.submit_and_wait("an atlas", None, |rec| {
                frame.record_start(rec, &parameters)?;
                frame.eye.record(rec)?;
                frame.walk.record(rec)?;
                frame.shade.record(rec)
            })
            .unwrap();
            check_texels(ctx, &scene, &engine, &atlas);
        }
    });
}

/// Texels that lie elsewhere in each pass.
#[derive(Debug)]
struct Wandering(Atlas);

impl Moving for Wandering {
    fn texels(&self, pass: u32) -> Vec<Option<Texel>> {
        let moved =
            |t: &Texel| Texel { uv: [t.uv[0] + 0.05 * (pass % 3) as f32, t.uv[1] + 0.1 * (pass % 2) as f32], ..*t };
        self.0.texels.iter().map(|texel| texel.as_ref().map(moved)).collect()
    }
}

#[test]
fn texels_that_move_have_the_light_of_their_places() {
    gpu_test(|ctx| {
        let scene = gallery();
        let settings = Settings { particles: 9, ..Settings::plain() };
        for size in [[1, 1], [27, 1], [31, 17]] {
            let still = texels(&scene, size);
            let wandering = Wandering(still.clone());
            let of = |atlas: Atlas| Renderer::with_atlas(ctx.clone(), scene.clone(), Arc::new(atlas), settings.clone());
            let mut expected = vec![Vec3::ZERO; still.texels.len()];
            for pass in 0..5 {
                // One pass of this number, its texels in their places.
                let atlas = Atlas::new(size, wandering.texels(pass));
                let mut renderer = of(atlas).unwrap();
                let empty = vec![0; HostFilm::byte_count(size, false)];
                renderer.load_film(pass, &HostFilm::from_bytes(&empty, size, false).unwrap()).unwrap();
                renderer.pass().unwrap();
                let layers = renderer.layers().unwrap();
                expected.iter_mut().zip(&layers.indirect).for_each(|(sum, light)| *sum += *light / 5.0);
            }
            let moving = Atlas { moving: Some(Arc::new(wandering)), ..still.clone() };
            let mut renderer = of(moving.clone()).unwrap();
            (0..3).for_each(|_| renderer.pass().unwrap());
            // It goes on from its state, and another atlas does not.
            let mut resumed = of(moving.clone()).unwrap();
            assert_eq!(renderer.fingerprint(), resumed.fingerprint());
            assert_ne!(renderer.fingerprint(), of(still).unwrap().fingerprint());
            resumed.load_state(3, &renderer.save_state().unwrap()).unwrap();
            for renderer in [&mut renderer, &mut resumed] {
                (3..5).for_each(|_| renderer.pass().unwrap());
            }
            let found = renderer.layers().unwrap();
            assert!(found.indirect == resumed.layers().unwrap().indirect);
            // A renderer that showed other texels, of another size, is as good as a new one.
            let mut taken = of(texels(&scene, [13, 7])).unwrap();
            (0..2).for_each(|_| taken.pass().unwrap());
            let state = renderer.save_state().unwrap();
            for again in 0..2 {
                taken.set_atlas(Arc::new(moving.clone())).unwrap();
                assert_eq!((taken.passes(), taken.fingerprint()), (0, renderer.fingerprint()));
                let first = if again == 0 { 0 } else { 5 };
                if first > 0 {
                    taken.load_state(first, &state).unwrap();
                }
                (first..5).for_each(|_| taken.pass().unwrap());
                assert!(taken.save_state().unwrap() == state);
            }
            assert!(found.indirect.iter().any(|light| light.x > 0.0));
            for (found, expected) in found.indirect.iter().zip(expected) {
                assert!((*found - expected).abs().max_element() <= 1e-4 * (1e-3 + expected.max_element()));
            }
        }
    });
}

/// Compares shading points and their light with the oracles.
fn check_texels(ctx: &Context, scene: &Scene, engine: &Engine, atlas: &Atlas) {
    let get = |buffer| lightsum::gpu::download::<glam::Vec4>(ctx, buffer).unwrap();
    let frame = engine.frame();
    let (points, lighting) = (&frame.eye.points, &frame.shade.lighting);
    let (position, geometric, wo) = (get(&points.position), get(&points.geometric), get(&points.wo));
    let (direct, indirect) = (get(&lighting.direct), get(&lighting.indirect));
    let lights = lightsum::gpu::download(ctx, frame.lights()).unwrap();
    let bvh = engine.bvh();
    let (mut lit, mut compared, mut differ) = (0, 0, 0);
    for (i, texel) in atlas.texels.iter().enumerate() {
        let Some(texel) = texel else {
            assert!(!has(wo[i], ShadingPoints::HIT), "texel {i} lies on nothing");
            continue;
        };
        let (point, d) = atlas::reference(scene, texel);
        let leaf = (0..bvh.triangle_count()).find(|&leaf| bvh.scene_triangle(leaf) == texel.triangle).unwrap();
        let [u, v] = texel.uv;
        let surface = surface::surface_at(scene, bvh, &lightsum::accel::Hit { t: 1.0, u, v, triangle: leaf }, d, 0.0);
        assert!(close(geometric[i].truncate(), -d, 1e-4, 1e-5) && surface.front != texel.back, "normal of texel {i}");
        assert!(close(wo[i].truncate(), -d, 1e-4, 1e-5), "direction of texel {i}");
        let r = &surface.reflectance;
        let reflects = r.kd.max_element() > 0.0 || r.f0.max_element() > 0.0;
        assert_eq!(is_lit(wo[i]), reflects, "texel {i} is lit if it reflects");
        if !reflects {
            continue;
        }
        lit += 1;
        assert!(close(position[i].truncate(), point, 1e-3, 1e-3), "place of texel {i}");
        let receiver = ShadingPoint {
            sampled: None,
            splats: false,
            position: position[i].truncate(),
            geometric: surface.geometric,
            shading: surface.shading,
            reflectance: *r,
            wo: -d,
        };
        let parameters = engine.plan().parameters(0).unwrap();
        let [e_direct, e_indirect, _] = shade::reference(scene, bvh, &receiver, &lights, 0.0, parameters.forward[3]);
        for (found, expected) in [(direct[i], e_direct), (indirect[i], e_indirect)] {
            compared += 1;
            if !close(found.truncate(), expected, 2e-3, 1e-5 * (1.0 + expected.max_element())) {
                differ += 1;
            }
        }
    }
    assert!(atlas.texels.len() < 8 || lit > atlas.texels.len() / 3, "{lit} texels are lit");
    // Rays past edges may differ.
    assert!(differ * 200 <= compared, "{differ} of {compared} differ");
}

#[test]
fn atlases_render_like_images() {
    gpu_test(|ctx| {
        let scene = gallery();
        let atlas = Arc::new(texels(&scene, [24, 16]));
        let settings = Settings { particles: 9, pattern: [2, 2], ..Settings::plain() };
        let mut engine = Engine::new(ctx, &scene, camera_of(&scene, [8, 8]), settings.clone()).unwrap();
        engine.set_atlas(atlas.clone()).unwrap();
        ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
        for _ in 0..4 {
            ctx.submit_and_wait("a pass", None, |rec| engine.record_pass(rec)).unwrap();
        }
        let layers = engine.film().download(ctx, [24, 16]).unwrap().mean();
        let brightest = layers.color.iter().copied().fold(Vec3::ZERO, Vec3::max);
        assert!(layers.color.iter().all(|c| c.is_finite()) && brightest.min_element() > 0.05);
        for (texel, (color, alpha)) in atlas.texels.iter().zip(layers.color.iter().zip(&layers.alpha)) {
            assert_eq!(*alpha, if texel.is_some() { 1.0 } else { 0.0 });
            assert!(texel.is_some() || *color == Vec3::ZERO);
        }
        let refused = |settings: Settings, atlas: Atlas| {
            Engine::with_view(ctx, &scene, View::Atlas(Arc::new(atlas)), settings).err().unwrap().to_string()
        };
        let one = |texel| Atlas::new([1, 1], vec![Some(texel)]);
        let nowhere = Texel { triangle: 1 << 20, uv: [0.0; 2], back: false };
        assert!(refused(settings.clone(), one(nowhere)).contains("does not exist"));
        let outside = Texel { triangle: 0, uv: [0.7, 0.6], back: false };
        assert!(refused(settings.clone(), one(outside)).contains("outside"));
        let nan = Texel { triangle: 0, uv: [f32::NAN, 0.0], back: false };
        assert!(refused(settings.clone(), one(nan)).contains("outside"));
        let short = Atlas::new([2, 2], vec![None]);
        assert!(refused(settings.clone(), short).contains("as many texels"));
        let mut moving = Engine::new_dynamic(ctx, scene.clone(), camera_of(&scene, [8, 8]), settings).unwrap();
        assert!(moving.set_atlas(atlas).is_err());
    });
}

#[test]
fn only_uniforms_change_where_nothing_else_needs_to() {
    gpu_test(|ctx| {
        let scene = gallery();
        let mut engine = Engine::new(ctx, &scene, camera_of(&scene, [16, 16]), Settings::plain()).unwrap();
        let frame = |engine: &Engine| engine.frame().parameters.handle();
        let before = frame(&engine);
        let cheap = [
            Settings { seed: 7, ..Settings::plain() },
            Settings { power_fraction: 0.5, ..Settings::plain() },
            Settings { clip: Clip::Distance(0.3), ..Settings::plain() },
        ];
        for settings in cheap {
            engine.set_settings(settings.clone()).unwrap();
            assert_eq!(frame(&engine), before, "{settings:?}");
            let fresh = plan::derive(engine.device_scene(), &settings, engine.view()).unwrap();
            let (a, b) = (engine.plan().parameters(3).unwrap(), fresh.parameters(3).unwrap());
            assert_eq!(bytemuck::bytes_of(&a), bytemuck::bytes_of(&b));
        }
        engine.set_settings(Settings { particles: 5, ..Settings::plain() }).unwrap();
        assert_ne!(frame(&engine), before);
    });
}
