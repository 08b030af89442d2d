//! Scenes of any size, and geometry as nobody would model it: the image is right, or the scene is refused with the reason.

use std::path::Path;

use glam::Vec3;
use lightsum::gpu::Context;
use lightsum::scene::{self, Camera, Scene, Triangle};
use lightsum::settings::Settings;

use crate::scenes::{compare, render};
use crate::support::gpu_test;

/// The Cornell box, 559 units wide.
fn cornell() -> Scene {
    let mut scene = scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell/scene.toml")).unwrap();
    let camera = scene.camera.unwrap();
    scene.camera = Some(Camera { resolution: [24, 18], ..camera });
    scene
}

fn scaled(scene: &Scene, by: f32) -> Scene {
    let mut scaled = scene.clone();
    scaled.positions.iter_mut().for_each(|p| *p *= by);
    scaled.camera = scene.camera.map(|c| Camera { eye: c.eye * by, target: c.target * by, ..c });
    scaled.validate(Path::new("scaled")).unwrap();
    scaled
}

/// Energy of another scene's image over that of the original, both of 16 passes (two seeds differ by 1 %), and its error, in which the error between two seeds of the original is 1.
fn against_noise(ctx: &Context, other: &Scene, original: &Scene) -> (f64, f64) {
    let image = |scene: &Scene, seed: u64| {
        let settings = Settings { seed, ..Settings::interactive() };
        render(ctx, scene, scene.camera.unwrap(), &settings, 16).color
    };
    let reference = image(original, 0);
    let (_, noise) = compare(&image(original, 1), &reference);
    let (energy, error) = compare(&image(other, 0), &reference);
    (energy, error / noise)
}

fn image(ctx: &Context, scene: &Scene) -> Vec<Vec3> {
    render(ctx, scene, scene.camera.unwrap(), &Settings::interactive(), 2).color
}

#[test]
fn the_unit_of_length_changes_no_bit() {
    gpu_test(|ctx| {
        let scene = cornell();
        let original = image(ctx, &scene);
        // Rooms of 2 thousandths to 600 million units.
        for exponent in [-18, -9, 10, 20] {
            let other = image(ctx, &scaled(&scene, (exponent as f32).exp2()));
            assert!(other == original, "another image at 2^{exponent}: {:?}", compare(&other, &original));
        }
    });
}

#[test]
fn tiny_rooms_are_as_bright() {
    gpu_test(|ctx| {
        let scene = cornell();
        // 3e-10 units. Squares of lengths come to an end of single precision, which changes random choices.
        for exponent in [-30, -41] {
            let (energy, error) = against_noise(ctx, &scaled(&scene, (exponent as f32).exp2()), &scene);
            println!("2^{exponent}: energy {energy:.5}, error {error:.3} of the noise");
            assert!((energy - 1.0).abs() < 0.02 && error < 2.0, "2^{exponent}: energy {energy}, error {error}");
        }
    });
}

/// Adds triangles to an object of their own.
fn add(scene: &mut Scene, like: Triangle, triangles: &[[Vec3; 3]]) {
    let object = scene.objects.len() as u32;
    scene.objects.push(String::from("added"));
    for corners in triangles {
        let first = scene.positions.len() as u32;
        scene.positions.extend(corners);
        scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], object, ..like });
    }
    scene.normals.resize(scene.positions.len(), Vec3::Y);
    scene.uvs.resize(scene.positions.len(), Default::default());
    scene.validate(Path::new("added")).unwrap();
}

/// A triangle of a surface that does not emit.
fn plain(scene: &Scene) -> Triangle {
    let emits = |t: &Triangle| scene.materials[t.material as usize].emission.max_element() > 0.0;
    *scene.triangles.iter().find(|t| !emits(t)).unwrap()
}

#[test]
fn slivers_and_duplicates_change_no_bit() {
    gpu_test(|ctx| {
        let scene = cornell();
        let original = image(ctx, &scene);
        let like = plain(&scene);
        let mut slivers = scene.clone();
        let sliver = |i: usize| {
            let at = Vec3::new(20.0 + 5.0 * (i % 100) as f32, -0.01, 20.0 + 100.0 * (i / 100) as f32);
            [at, at + Vec3::Z * 20.0, at + Vec3::X * 1e-3]
        };
        add(&mut slivers, like, &(0..500).map(sliver).collect::<Vec<_>>());
        assert_eq!(slivers.triangles.len(), scene.triangles.len() + 500);
        let found = image(ctx, &slivers);
        assert!(found == original, "slivers below the floor: {:?}", compare(&found, &original));

        let mut twice = scene.clone();
        let copies: Vec<Triangle> = twice.triangles.clone();
        let lamp = |t: &Triangle| scene.materials[t.material as usize].emission.max_element() > 0.0;
        twice.triangles.extend(copies.into_iter().filter(|t| !lamp(t)));
        twice.validate(Path::new("twice")).unwrap();
        let found = image(ctx, &twice);
        assert!(found == original, "every face twice: {:?}", compare(&found, &original));
    });
}

#[test]
fn a_triangle_a_million_times_the_room_changes_little() {
    gpu_test(|ctx| {
        let scene = cornell();
        let like = plain(&scene);
        let far = 559e6;
        // It falls away from the room, which is open in front, and reflects no light of it back.
        let falling = [Vec3::new(-far, -1e3, -far), Vec3::new(0.0, -1e3, far), Vec3::new(far, -0.2 * far, -far)];
        // It stands a million rooms behind the back wall.
        let behind = [Vec3::new(-far, -far, far), Vec3::new(0.0, far, far), Vec3::new(far, -far, far)];
        for (name, corners) in [("falling", falling), ("behind", behind)] {
            let mut with = scene.clone();
            add(&mut with, like, &[corners]);
            let (energy, error) = against_noise(ctx, &with, &scene);
            println!("{name}: energy {energy:.5}, error {error:.3} of the noise");
            assert!((energy - 1.0).abs() < 0.02 && error < 2.0, "{name}: energy {energy}, error {error}");
        }
    });
}

#[test]
fn what_single_precision_cannot_hold_is_refused_with_the_reason() {
    let scene = cornell();
    let refused = |by: f32| {
        let mut scene = scene.clone();
        scene.positions.iter_mut().for_each(|p| *p *= by);
        scene.camera = None;
        scene.validate(Path::new("a.obj")).unwrap_err().to_string()
    };
    for by in [1e-15, 1e-20, 1e-30] {
        assert!(refused(by).contains("area"), "{}", refused(by));
    }
    assert!(refused(1e38).contains("not finite"), "{}", refused(1e38));
    for by in [1e7, 1e12, 1e30] {
        let message = refused(by);
        assert!(message.contains("1e9 from the scene's origin") && message.contains("unit of length"), "{message}");
    }
}
