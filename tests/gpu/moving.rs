//! Scenes that change between passes: effects of edits, restarts, and refused edits.

use glam::{Affine3A, Mat3A, Quat, Vec3};
use lightsum::accel::objects::Changes;
use lightsum::device_scene::DeviceScene;
use lightsum::gpu::{Context, Staging};
use lightsum::scene::{self, Camera, Light, Scene, Surface, builtin};
use lightsum::settings::{Clip, Compensation, Spread, Superposition, Traversal};
use lightsum::{Engine, Renderer, Settings};

use crate::embed::{Host, Readback, image, message, ready, record, small};
use crate::support::{assert_silent, gpu_test};

/// An engine whose scene may change, set up.
fn dynamic(ctx: &Context, scene: &Scene, camera: Camera, settings: &Settings) -> Engine {
    let mut engine = Engine::new_dynamic(ctx, scene.clone(), camera, settings.clone()).unwrap();
    ctx.submit_and_wait("setup", None, |rec| engine.record_setup(rec)).unwrap();
    engine.setup_finished();
    engine
}

/// The Cornell box with an additional point light, spot and sphere light.
fn many_lights() -> (Scene, Camera, Settings) {
    let root = env!("CARGO_MANIFEST_DIR");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let lights = "[lights.a]\ntype = 'point'\nposition = [100, 300, 100]\nintensity = [9e3, 9e3, 9e3]
[lights.b]\ntype = 'spot'\nposition = [400, 500, 100]\ndirection = [0, -1, 0.5]\nintensity = [2e4, 1e4, 1e4]\nouter = 30
[lights.ball]\ntype = 'sphere'\ncenter = [150, 400, 200]\nradius = 30\nradiance = [4, 5, 6]\n";
    std::fs::write(&path, format!("model = '{root}/scenes/cornell/cornell.obj'\n{lights}")).unwrap();
    let (_, camera, settings) = small();
    (scene::load(&path).unwrap(), camera, settings)
}

/// Relative RMSE of an image.
fn difference(image: &[[f32; 4]], reference: &[[f32; 4]]) -> f64 {
    let sum = |f: &dyn Fn(f64, f64) -> f64| {
        image
            .iter()
            .flatten()
            .zip(reference.iter().flatten())
            .map(|(&a, &b)| f(f64::from(a), f64::from(b)))
            .sum::<f64>()
    };
    (sum(&|a, b| (a - b) * (a - b)) / sum(&|_, b| b * b)).sqrt()
}

fn object(engine: &Engine, name: &str) -> u32 {
    engine.scene().unwrap().objects_named(name)[0]
}

fn material(engine: &Engine, name: &str) -> u32 {
    engine.scene().unwrap().materials.iter().position(|m| m.name == name).unwrap() as u32
}

/// Changes a material by its name.
fn change(engine: &mut Engine, name: &str, change: impl Fn(&mut scene::Material)) {
    let index = material(engine, name);
    let mut material = engine.scene().unwrap().materials[index as usize].clone();
    change(&mut material);
    engine.set_material(index, material).unwrap();
}

fn settings_with(engine: &mut Engine, change: impl Fn(&mut Settings)) {
    let mut settings = engine.plan().settings.clone();
    change(&mut settings);
    engine.set_settings(settings).unwrap();
}

type Edit = fn(&mut Engine);

/// Every kind of edit.
const EDITS: [(&str, Edit); 31] = [
    ("an object moves", |e| {
        let turn = Quat::from_rotation_y(0.3);
        let to = Affine3A::from_rotation_translation(turn, Vec3::new(-60.0, 20.0, 30.0));
        e.set_transform(object(e, "tall_block"), to).unwrap();
    }),
    ("an object is stretched", |e| {
        e.set_transform(object(e, "short_block"), Affine3A::from_scale(Vec3::new(1.0, 1.5, 0.9))).unwrap();
    }),
    ("an object gets other vertices", |e| {
        let own = object(e, "short_block");
        let scene = e.scene().unwrap();
        let mut used: Vec<u32> = scene.triangles.iter().filter(|t| t.object == own).flat_map(|t| t.vertices).collect();
        used.sort_unstable();
        used.dedup();
        // The transform is that of the previous edit: these are the positions without it, sheared.
        let original = scene::load(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml").as_ref()).unwrap();
        let mut original = original;
        let range = original.separate_objects()[own as usize].clone();
        let leaned: Vec<Vec3> = original.positions[range].iter().map(|p| *p + Vec3::X * (0.3 * p.y)).collect();
        assert_eq!(leaned.len(), used.len());
        e.set_vertices(own, &leaned, None).unwrap();
    }),
    ("faces of an object lose their area", |e| {
        let own = object(e, "short_block");
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml");
        let mut original = scene::load(path.as_ref()).unwrap();
        let range = original.separate_objects()[own as usize].clone();
        let mut positions = original.positions[range].to_vec();
        let half = positions.len() / 2;
        let to = positions[0];
        positions[..half].fill(to);
        e.set_vertices(own, &positions, None).unwrap();
    }),
    ("an emitter moves", |e| {
        e.set_transform(object(e, "light"), Affine3A::from_translation(Vec3::new(40.0, -100.0, 60.0))).unwrap();
    }),
    ("a sphere light moves and grows", |e| {
        let to = Affine3A::from_scale_rotation_translation(
            Vec3::splat(1.2),
            Quat::from_rotation_x(1.0),
            Vec3::new(60.0, 300.0, -100.0),
        );
        e.set_transform(object(e, "ball"), to).unwrap();
    }),
    ("a wall leaves the box of the scene", |e| {
        e.set_transform(object(e, "back_wall"), Affine3A::from_translation(Vec3::Z * 700.0)).unwrap();
    }),
    ("a material changes its colour", |e| change(e, "red", |m| m.base_color = Vec3::new(0.1, 0.2, 0.6))),
    ("a material begins to emit", |e| change(e, "green", |m| m.emission = Vec3::new(1.0, 0.5, 0.2))),
    ("it ceases to emit", |e| change(e, "green", |m| m.emission = Vec3::ZERO)),
    ("a sphere light changes its colour", |e| change(e, "light ball", |m| m.emission = Vec3::new(9.0, 1.0, 1.0))),
    ("a material becomes glass", |e| {
        change(e, "red", |m| (m.surface, m.thin, m.base_color) = (Surface::Glass, true, Vec3::ONE));
    }),
    ("interleaved sampling", |e| settings_with(e, |s| s.pattern = [2, 1])),
    ("a light changes its intensity", |e| {
        let light = Light::Point { position: Vec3::new(100.0, 250.0, 100.0), intensity: Vec3::new(3e4, 9e3, 1e3) };
        e.set_light(0, light).unwrap();
    }),
    ("a light becomes parallel", |e| {
        let direction = Vec3::new(0.1, -1.0, 0.6).normalize();
        e.set_light(1, Light::Directional { direction, irradiance: Vec3::splat(2.0) }).unwrap();
    }),
    ("the camera moves", |e| {
        let camera = *e.view().camera().unwrap();
        let (eye, target) = (Vec3::new(300.0, 250.0, -700.0), Vec3::new(278.0, 273.0, 0.0));
        e.set_camera(Camera { eye, target, ..camera }).unwrap();
    }),
    ("another seed", |e| settings_with(e, |s| s.seed = 7)),
    ("another clipping distance", |e| settings_with(e, |s| s.clip = Clip::Fraction(0.05))),
    ("more paths", |e| settings_with(e, |s| s.particles = 6)),
    ("no compensation", |e| settings_with(e, |s| s.compensation = Compensation::Off)),
    ("of the lights without area one is chosen", |e| settings_with(e, |s| s.delta_lights = Some(1))),
    ("one of those to choose from moves", |e| {
        let light = Light::Point { position: Vec3::new(400.0, 350.0, 200.0), intensity: Vec3::new(1e4, 4e4, 2e4) };
        e.set_light(0, light).unwrap();
    }),
    ("a wall becomes a mirror", |e| {
        change(e, "green", |m| (m.surface, m.specular) = (Surface::Mirror, Vec3::splat(0.6)));
    }),
    ("fewer mirrored lights", |e| settings_with(e, |s| s.mirror_lights = 1)),
    ("an object moves before the mirror", |e| {
        let to = Affine3A::from_rotation_translation(Quat::from_rotation_y(0.4), Vec3::new(20.0, 0.0, 10.0));
        e.set_transform(0, to).unwrap();
    }),
    ("glossy planes mirror the room", |e| {
        change(e, "white", |m| (m.specular, m.roughness) = (Vec3::splat(0.2), 0.3));
        settings_with(e, |s| s.superposition = Some(Superposition::default()));
    }),
    ("they become rougher", |e| change(e, "white", |m| m.roughness = 0.5)),
    ("a glossy object moves", |e| {
        e.set_transform(object(e, "tall_block"), Affine3A::from_translation(Vec3::new(30.0, 0.0, -20.0))).unwrap();
    }),
    ("they are mirrors", |e| {
        settings_with(e, |s| {
            s.superposition = Some(Superposition { spread: Spread::Mirror, ..Superposition::default() })
        });
    }),
    ("they are glossy no more", |e| change(e, "white", |m| m.roughness = 0.9)),
    ("an emitter emits towards its normal", |e| change(e, "light", |m| m.emission_exponent = 4.0)),
];

#[test]
fn every_edit_starts_over_and_gives_what_a_fresh_engine_gives() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = many_lights();
        let mut engine = dynamic(ctx, &scene, camera, &settings);
        let mut before = image(ctx, &mut engine, 2);
        for (name, edit) in EDITS {
            edit(&mut engine);
            assert_eq!(engine.passes(), 0, "{name}: it starts over");
            let edited = image(ctx, &mut engine, 2);
            assert!(difference(&edited, &before) > 1e-4, "{name}: it shows");
            engine.bvh().validate(engine.scene().unwrap()).unwrap();

            edit(&mut engine);
            assert_eq!(engine.passes(), 2, "{name}: the same again changes nothing");
            let camera = *engine.view().camera().unwrap();
            let mut fresh = dynamic(ctx, engine.scene().unwrap(), camera, engine.settings());
            let expected = image(ctx, &mut fresh, 2);
            let error = difference(&edited, &expected);
            println!("{name}: relative RMSE {error:.2e} against a fresh engine");
            // Refitted trees have other nodes: rays within rounding of an edge may hit another triangle.
            assert!(error < 1e-4, "{name}: {error}");
            if engine.bvh() == fresh.bvh() {
                assert!(edited == expected, "{name}: the tree is the same, the image is not");
            }
            assert_eq!(engine.emitters().list, fresh.emitters().list, "{name}");
            assert_eq!(engine.plan().lights, fresh.plan().lights, "{name}");
            // Further passes add to the sums.
            assert_eq!(image(ctx, &mut engine, 1).len(), edited.len());
            assert_eq!(engine.passes(), 3, "{name}");
            before = edited;
        }
    });
}

#[test]
fn a_dynamic_scene_looks_like_a_still_one() {
    gpu_test(|ctx| {
        let scene = builtin::room(900);
        let camera = Camera { resolution: [33, 21], ..scene.camera.unwrap() };
        let settings = Settings { particles: 4, max_depth: 3, ..Settings::plain() };
        let still = image(ctx, &mut ready(ctx, &scene, camera, &settings), 3);
        let moving = image(ctx, &mut dynamic(ctx, &scene, camera, &settings), 3);
        let error = difference(&moving, &still);
        println!("two trees: relative RMSE {error:.2e}");
        assert!(error < 1e-3, "{error}");
    });
}

#[test]
fn moving_back_gives_the_same_bits() {
    gpu_test(|ctx| {
        let scene = builtin::room(900);
        let camera = Camera { resolution: [33, 21], ..scene.camera.unwrap() };
        let settings = Settings { particles: 4, max_depth: 3, ..Settings::plain() };
        let mut engine = dynamic(ctx, &scene, camera, &settings);
        let first = image(ctx, &mut engine, 2);
        let moved = ["lamp", "table 5", "spheres 2"].map(|name| object(&engine, name));
        for (i, &object) in moved.iter().enumerate() {
            let turn = Quat::from_rotation_z(0.2 * (i + 1) as f32);
            let to = Affine3A::from_rotation_translation(turn, Vec3::new(1.5, 0.4, -1.1));
            engine.set_transform(object, to).unwrap();
            assert_ne!(image(ctx, &mut engine, 2), first);
        }
        for &object in &moved {
            engine.set_transform(object, Affine3A::IDENTITY).unwrap();
        }
        assert!(image(ctx, &mut engine, 2) == first, "the objects are back, the image is not");
    });
}

#[test]
fn frames_in_flight_keep_their_scenes() {
    gpu_test(|_| {
        let host = Host::new(true).unwrap();
        let witness = host.lend().unwrap();
        let (scene, camera, settings) = small();
        let places = [Vec3::ZERO, Vec3::new(-90.0, 0.0, -150.0), Vec3::new(50.0, 30.0, 0.0)];
        let context = host.lend().unwrap();
        let move_to = |engine: &mut Engine, place| {
            let block = object(engine, "tall_block");
            engine.set_transform(block, Affine3A::from_translation(place)).unwrap();
        };
        // The host waits for each frame before it records the next.
        let mut engine = Engine::new_dynamic(&context, scene.clone(), camera, settings.clone()).unwrap();
        let alone = [0, 1, 2].map(|frame| {
            move_to(&mut engine, places[frame]);
            let readback = Readback::new(&host, engine.image().bytes()).unwrap();
            let commands = host.begin().unwrap();
            let recorded = record(&context, commands, &mut engine, frame == 0);
            readback.record_copy(commands, &engine);
            host.submit(commands, recorded).unwrap().wait().unwrap();
            readback.texels()
        });
        assert!(alone[0] != alone[1] && alone[1] != alone[2]);

        // All are recorded before the first is submitted, and the engine is dropped before any has run.
        let mut engine = Engine::new_dynamic(&context, scene, camera, settings).unwrap();
        let readbacks = [0; 3].map(|_| Readback::new(&host, engine.image().bytes()).unwrap());
        let commands = [0; 3].map(|_| host.begin().unwrap());
        let mut recorded = Vec::new();
        for frame in 0..3 {
            move_to(&mut engine, places[frame]);
            recorded.push(record(&context, commands[frame], &mut engine, frame == 0));
            engine.setup_finished();
            readbacks[frame].record_copy(commands[frame], &engine);
        }
        let submissions: Vec<_> = commands.into_iter().zip(recorded).map(|(c, r)| host.submit(c, r).unwrap()).collect();
        drop((engine, context));
        submissions.into_iter().for_each(|submission| submission.wait().unwrap());
        for (frame, readback) in readbacks.iter().enumerate() {
            assert!(readback.texels() == alone[frame], "frame {frame} in flight differs from the same frame alone");
        }
        assert_silent(witness.take_messages());
    });
}

#[test]
fn a_change_that_was_not_submitted_is_uploaded_again() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let mut engine = dynamic(ctx, &scene, camera, &settings);
        image(ctx, &mut engine, 1);
        let block = object(&engine, "tall_block");
        engine.set_transform(block, Affine3A::from_translation(Vec3::X * -80.0)).unwrap();
        let lost = ctx.submit_and_wait("lost", None, |rec| {
            engine.record_pass(rec)?;
            Err(lightsum::Error::Interrupted)
        });
        assert!(lost.is_err());
        engine.upload_again();
        let edited = image(ctx, &mut engine, 2);
        let mut fresh = dynamic(ctx, engine.scene().unwrap(), camera, &settings);
        assert!(difference(&edited, &image(ctx, &mut fresh, 2)) < 1e-4);
    });
}

#[test]
fn refused_edits_name_what_is_wrong_and_change_nothing() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = many_lights();
        let mut engine = dynamic(ctx, &scene, camera, &settings);
        let first = image(ctx, &mut engine, 1);
        let (block, ball) = (object(&engine, "tall_block"), object(&engine, "ball"));
        let flat = Affine3A::from_mat3_translation(Mat3A::from_diagonal(Vec3::new(1.0, 0.0, 1.0)).into(), Vec3::ZERO);
        for (transform, words) in [
            (Affine3A::from_translation(Vec3::new(f32::NAN, 0.0, 0.0)), "not finite"),
            (Affine3A::from_scale(Vec3::splat(f32::INFINITY)), "not finite"),
            (Affine3A::from_scale(Vec3::splat(0.0)), "without volume"),
            (flat, "without volume"),
            (Affine3A::from_scale(Vec3::new(1e-12, 1e6, 1.0)), "no area"),
            (Affine3A::from_scale(Vec3::new(1e37, 1e-3, 1e3)), "vertex"),
        ] {
            let refusal = message(engine.set_transform(block, transform));
            assert!(refusal.contains("\"tall_block\"") && refusal.contains(words), "{words}: {refusal}");
        }
        let refusal = message(engine.set_transform(ball, Affine3A::from_scale(Vec3::new(1.0, 2.0, 1.0))));
        assert!(refusal.contains("\"ball\"") && refusal.contains("no sphere"), "{refusal}");
        assert!(message(engine.set_transform(99, Affine3A::IDENTITY)).contains("object 99"));
        let refusal = message(engine.set_vertices(block, &[Vec3::ZERO; 3], None));
        assert!(refusal.contains("\"tall_block\"") && refusal.contains("3 are given"), "{refusal}");
        let count = scene::load(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell/scene.toml").as_ref())
            .map(|mut scene| scene.separate_objects()[block as usize].len())
            .unwrap();
        let light = object(&engine, "light");
        let corners = engine.scene().map(|scene| scene.vertices_of_objects()[light as usize].len()).unwrap();
        let refusal = message(engine.set_vertices(light, &vec![Vec3::ONE; corners], None));
        assert!(refusal.contains("\"light\"") && refusal.contains("no area"), "{refusal}");
        // Vertices that are not finite, of as many as there are.
        let refusal = message(engine.set_vertices(block, &vec![Vec3::NAN; count], None));
        assert!(refusal.contains("\"tall_block\"") && refusal.contains("vertex"), "{refusal}");

        let red = material(&engine, "red");
        let old = engine.scene().unwrap().materials[red as usize].clone();
        let bright = scene::Material { base_color: Vec3::splat(2.0), ..old.clone() };
        let refusal = message(engine.set_material(red, bright));
        assert!(refusal.contains("\"red\"") && refusal.contains("base_color"), "{refusal}");
        let textured = scene::Material { base_texture: Some(0), ..old };
        assert!(message(engine.set_material(red, textured)).contains("texture 0"));
        let dark = Light::Point { position: Vec3::ZERO, intensity: Vec3::ZERO };
        assert!(message(engine.set_light(0, dark)).contains("intensity"));
        assert!(message(engine.set_light(2, dark)).contains("sphere"));
        let single = Settings { traversal: Traversal::Single, ..settings.clone() };
        assert!(message(engine.set_settings(single)).contains("--traversal"));
        assert!(message(engine.set_settings(Settings { particles: 0, ..settings.clone() })).contains("--particles"));
        assert_eq!(engine.passes(), 1, "nothing started over");
        engine.restart();
        assert!(image(ctx, &mut engine, 1) == first);

        // The only light cannot be switched off.
        let (scene, camera, settings) = small();
        let mut engine = dynamic(ctx, &scene, camera, &settings);
        let light = material(&engine, "light");
        let out = scene::Material { emission: Vec3::ZERO, ..engine.scene().unwrap().materials[light as usize].clone() };
        assert!(message(engine.set_material(light, out)).contains("total power"));
        assert_eq!(engine.scene().unwrap().materials[light as usize], scene.materials[light as usize]);

        let mut still = ready(ctx, &scene, camera, &settings);
        assert!(message(still.set_transform(0, Affine3A::from_translation(Vec3::X))).contains("new_dynamic"));
        assert!(still.scene().is_none());
    });
}

#[test]
fn a_wide_tree_that_is_too_deep_is_given_up_until_it_fits() {
    gpu_test(|ctx| {
        let mut scene = builtin::room(900);
        scene.separate_objects();
        let mut staging = Staging::new();
        let (mut device_scene, trees) = DeviceScene::new_dynamic(ctx, &mut staging, &scene, true).unwrap();
        assert!(device_scene.wide_nodes.is_some());
        let mut update = |wide| {
            let (staging, changes) = (&mut staging, Changes::default());
            device_scene
                .update_hierarchy(ctx, staging, &scene, wide, &changes)
                .map(|r| (r, device_scene.wide_nodes.is_some()))
        };
        let wide = trees.wide.unwrap();
        // The kernel's stack has 16 words, one for each node above the deepest.
        let deep = lightsum::accel::wide::WideBvh { depth: 18, ..wide.clone() };
        let deepest = lightsum::accel::wide::WideBvh { depth: 17, ..wide.clone() };
        assert_eq!(update(Some(&deepest)).unwrap(), (false, true));
        assert_eq!(update(Some(&deep)).unwrap(), (true, false), "passes must be bound again, without clusters");
        assert_eq!(update(Some(&deep)).unwrap(), (false, false));
        assert_eq!(update(Some(&wide)).unwrap(), (true, true));
    });
}

#[test]
fn a_renderer_follows_its_engine() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let mut renderer = Renderer::with_context_dynamic(ctx.clone(), scene, camera, settings.clone()).unwrap();
        renderer.pass().unwrap();
        // The number of lists that are read back changes.
        for change in [
            Settings { compensation: Compensation::Off, ..settings.clone() },
            Settings { max_depth: 5, ..settings.clone() },
            Settings { moving_passes: 9, max_depth: 5, ..settings.clone() },
        ] {
            let engine = renderer.engine_mut();
            engine.set_settings(change.clone()).unwrap();
            let block = object(engine, "short_block");
            engine.set_transform(block, Affine3A::from_translation(Vec3::Y * change.moving_passes as f32)).unwrap();
            renderer.pass().unwrap();
            renderer.pass().unwrap();
            assert!(renderer.last_pass().rays > 0 && renderer.last_pass().record > 0.0);
            assert_eq!(renderer.engine().plan().settings, change);
            let layers = renderer.layers().unwrap();
            assert!(layers.color.iter().any(|c| c.max_element() > 0.0));
        }
        let more = Settings { moving_passes: 2, rounds: 9, max_depth: 5, ..settings };
        renderer.engine_mut().set_settings(more).unwrap();
        assert_eq!(renderer.passes(), 2, "what changes no pass starts nothing over");
        renderer.pass().unwrap();
        assert_eq!(renderer.passes(), 3);
    });
}
