//! Orthographic cameras: closed forms, the path tracer, and a perspective camera from far away.

use glam::camera::rh;
use glam::{Mat4, Vec3};
use lightsum::engine::ShutterEnd;
use lightsum::scene::{Camera, Material, Scene, Surface, builtin};
use lightsum::settings::{Clip, Compensation, Settings, SoftShadows, Splats, Superposition};
use lightsum::{Engine, Error};

use crate::renderer::{agrees_at_depths, path_traced};
use crate::rig::{gallery, orthographic};
use crate::scenes::{Soup, compare, fov, mean, render, renderer, settings};
use crate::support::gpu_test;

/// A camera that looks at a room's wall from within.
fn within(scene: &Scene, height: f32, resolution: [u32; 2]) -> Camera {
    Camera { height: Some(height), resolution, ..scene.camera.unwrap() }
}

#[test]
fn a_furnace_has_its_radiance_everywhere() {
    gpu_test(|ctx| {
        let (rho, depth) = (0.5, 5);
        let scene = builtin::furnace(rho, 2.0);
        let layers = render(ctx, &scene, within(&scene, 0.5, [16, 16]), &settings(32, depth), 32);
        let expected = 2.0 * (0..depth).map(|j| f64::from(rho).powi(j as i32)).sum::<f64>();
        let found = mean(&layers.color).element_sum() / 3.0;
        println!("{found} for {expected}");
        assert!((found / expected - 1.0).abs() < 0.015, "{found} for {expected}");
        assert!(layers.alpha.iter().all(|alpha| *alpha == 1.0));
    });
}

/// A room with a lamp, a ball and a mirror on its wall, open to the front.
fn room() -> (Scene, Camera) {
    let mut soup = Soup::new("room");
    let [red, green, grey, lamp] = [
        soup.diffuse([0.6, 0.1, 0.1], 0.0),
        soup.diffuse([0.1, 0.5, 0.2], 0.0),
        soup.diffuse(0.6, 0.0),
        soup.diffuse(0.0, [12.0, 11.0, 9.0]),
    ];
    let mirror = soup.material(Material {
        base_color: Vec3::ZERO,
        specular: Vec3::splat(0.9),
        surface: Surface::Mirror,
        ..Material::default()
    });
    soup.room(Vec3::ZERO, Vec3::new(2.0, 1.5, 2.0), [red, green, grey, grey, grey, grey]);
    soup.quad(Vec3::new(0.6, 1.45, 0.6), Vec3::X * 0.8, Vec3::Z * 0.8, lamp);
    soup.quad(Vec3::new(0.3, 0.4, 0.05), Vec3::X * 0.8 + Vec3::Z * 0.15, Vec3::Y * 0.7, mirror);
    soup.ball(Vec3::new(1.5, 0.35, 0.9), 0.3, 12, grey);
    let (eye, target) = (Vec3::new(0.95, 0.85, 1.95), Vec3::new(1.0, 0.6, 0.0));
    let camera = Camera { height: Some(1.1), ..crate::scenes::camera(eye, target, 45.0, [40, 30]) };
    (soup.0, camera)
}

#[test]
fn images_agree_with_the_path_tracer() {
    gpu_test(|ctx| {
        let (scene, camera) = room();
        agrees_at_depths(ctx, &scene, camera);
        // The default settings (near light from pixels, edges, the filter, pools of lights) are as far off as with a perspective camera there.
        let usual = Settings { max_depth: 5, ..Settings::default() };
        let [parallel, perspective] = [camera, Camera { height: None, fov_y: 40.0, ..camera }].map(|camera| {
            let image = render(ctx, &scene, camera, &usual, 128);
            let (energy, rmse) = compare(&image.color, &path_traced(&scene, &camera, 1024, 5));
            println!("default settings, height {:?}: energy {energy:.4}, relative RMSE {rmse:.4}", camera.height);
            assert!(rmse < 0.1, "{camera:?}: {rmse}");
            energy
        });
        assert!((parallel - perspective).abs() < 0.02, "energy {parallel}, and {perspective} of a perspective camera");
    });
}

/// Rays of a perspective camera far away are nearly parallel.
#[test]
fn images_are_those_of_a_perspective_camera_from_far_away() {
    gpu_test(|ctx| {
        let resolution = [64, 48];
        let mut soup = Soup::new("steps");
        let [grey, red, lamp] = [soup.diffuse(0.6, 0.0), soup.diffuse([0.7, 0.2, 0.1], 0.0), soup.diffuse(0.0, 9.0)];
        soup.quad(Vec3::new(-4.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::X * 8.0, grey);
        soup.ball(Vec3::new(0.3, 0.7, 0.2), 0.7, 12, red);
        soup.quad(Vec3::new(-1.4, 0.0, 0.9), Vec3::X * 0.9, Vec3::Y * 0.8, red);
        soup.quad(Vec3::new(-0.5, 2.6, -0.5), Vec3::X, Vec3::Z, lamp);
        let scene = soup.0;
        let (target, away) = (Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.3, 0.5, 1.0).normalize());
        let (height, far) = (3.0, 2000.0);
        let perspective = crate::scenes::camera(target + far * away, target, fov(0.5 * height, far), resolution);
        let parallel = Camera { eye: target + 5.0 * away, height: Some(height), ..perspective };
        let fixed = Settings { clip: Clip::Distance(0.5), ..settings(32, 4) };
        let soft = Settings { soft_shadows: Some(SoftShadows::default()), ..fixed.clone() };
        let near = Settings { compensation: Compensation::Near, antialias: true, ..fixed.clone() };
        let filtered = Settings { filter: Settings::interactive().filter, pattern: [3, 3], ..near.clone() };
        for (what, settings) in
            [("plain", fixed), ("soft shadows", soft), ("near light and edges", near), ("filter", filtered)]
        {
            let [a, b] = [parallel, perspective].map(|camera| render(ctx, &scene, camera, &settings, 8));
            let (energy, rmse) = compare(&a.color, &b.color);
            println!("{what}: energy {energy:.4}, relative RMSE {rmse:.4}");
            assert!((energy - 1.0).abs() < 0.005 && rmse < 0.05, "{what}: energy {energy}, RMSE {rmse}");
            // Depth counts from the plane of the eye.
            let off = a.depth.iter().zip(&b.depth).map(|(a, b)| (a + far - 5.0 - b).abs());
            assert!(off.filter(|off| *off > 0.02).count() * 50 < a.depth.len(), "{what}");
        }
    });
}

#[test]
fn matrices_show_the_image_of_the_camera() {
    gpu_test(|ctx| {
        let (scene, camera) = room();
        let settings = settings(16, 3);
        let mut engine = Engine::new(ctx, &scene, Camera { height: None, ..camera }, settings.clone()).unwrap();
        let view = rh::view::look_at_mat4(camera.eye, camera.target, camera.up);
        let [half_width, half_height] = camera.half_extents();
        let projection = rh::proj::directx::orthographic(-half_width, half_width, -half_height, half_height, 0.0, 10.0);
        engine.set_matrices(view, projection).unwrap();
        let set = *engine.view().camera().unwrap();
        assert!(set.is_orthographic());
        let [a, b] = [camera, set].map(|camera| render(ctx, &scene, camera, &settings, 4));
        let (energy, rmse) = compare(&a.color, &b.color);
        assert!((energy - 1.0).abs() < 1e-3 && rmse < 0.02, "energy {energy}, RMSE {rmse}");
        // Back to a perspective one, whose rays share their origin again.
        engine.set_matrices(view, rh::proj::directx::perspective(1.0, 4.0 / 3.0, 0.1, 10.0)).unwrap();
        assert!(!engine.view().is_orthographic());
        let error = engine.set_matrices(view, Mat4::from_scale(Vec3::new(1.0, 1.0, 0.0))).unwrap_err();
        assert!(error.to_string().contains("singular"), "{error}");
    });
}

/// One renderer whose camera changes between both kinds shows what new ones do.
#[test]
fn cameras_of_both_kinds_take_turns() {
    gpu_test(|ctx| {
        let scene = gallery();
        let perspective = Camera { resolution: [33, 21], ..scene.camera.unwrap() };
        let parallel = Camera { resolution: [33, 21], ..orthographic(scene.clone()).camera.unwrap() };
        let usual = Settings { particles: 6, ..Settings::default() };
        let mut turning = renderer(ctx, &scene, perspective, &usual);
        for camera in [perspective, parallel, perspective] {
            turning.engine_mut().set_camera(camera).unwrap();
            let mut fresh = renderer(ctx, &scene, camera, &usual);
            for renderer in [&mut turning, &mut fresh] {
                (0..2).for_each(|_| renderer.pass().unwrap());
            }
            assert!(turning.layers().unwrap().color == fresh.layers().unwrap().color, "{camera:?}");
        }
    });
}

#[test]
fn splats_show_what_a_far_camera_sees() {
    gpu_test(|ctx| {
        let mut soup = Soup::new("glossy ball");
        let grey = soup.diffuse(0.6, 0.0);
        let gloss = soup.material(Material {
            base_color: Vec3::ZERO,
            specular: Vec3::splat(0.8),
            roughness: 0.5,
            ..Material::default()
        });
        let lamp = soup.diffuse(0.0, 9.0);
        soup.quad(Vec3::new(-4.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::X * 8.0, grey);
        soup.ball(Vec3::new(0.0, 0.8, 0.0), 0.8, 24, gloss);
        soup.quad(Vec3::new(-0.5, 3.0, -0.5), Vec3::X, Vec3::Z, lamp);
        let target = Vec3::new(0.0, 0.7, 0.0);
        let away = Vec3::new(0.0, 0.4, 1.0).normalize();
        let from = |far: f32| crate::scenes::camera(target + far * away, target, fov(1.2, far), [32, 32]);
        let parallel = Camera { eye: target + 4.0 * away, height: Some(2.4), ..from(1.0) };
        let splats = Settings {
            splats: Some(Splats { particles: 20_000, ..Splats::default() }),
            clip: Clip::Distance(0.3),
            ..settings(16, 4)
        };
        let image = render(ctx, &soup.0, parallel, &splats, 8);
        // The difference vanishes as the camera goes away.
        let [near, far] = [250.0, 4000.0].map(|distance| {
            let (energy, rmse) = compare(&image.color, &render(ctx, &soup.0, from(distance), &splats, 8).color);
            println!("from {distance}: energy {energy:.4}, relative RMSE {rmse:.4}");
            assert!((energy - 1.0).abs() < 0.01, "from {distance}: energy {energy}");
            rmse
        });
        assert!(far < 0.5 * near, "RMSE {near} and {far}");
    });
}

/// Settings that need one eye point, and cameras without an image, are refused by name.
#[test]
fn lenses_and_mirror_images_are_refused() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [16, 9], height: Some(3.0), ..scene.camera.unwrap() };
        let refused = |camera: Camera, settings: Settings, parts: &[&str]| {
            let error = Engine::new(ctx, &scene, camera, settings).err().unwrap().to_string();
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        };
        let mirrors = Settings { superposition: Some(Superposition::default()), ..Settings::plain() };
        refused(camera, mirrors, &["--superposition", "use off"]);
        refused(Camera { aperture: 0.1, ..camera }, Settings::plain(), &["aperture 0.1", "orthographic"]);
        for height in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            refused(Camera { height: Some(height), ..camera }, Settings::plain(), &["height"]);
        }
        let still = Settings { particles: 4, ..Settings::plain() };
        let moving = Camera { shutter: 1.0, ..camera };
        let mut engine = Engine::new(ctx, &scene, moving, still).unwrap();
        let end = |camera: Camera| ShutterEnd { camera, objects: Vec::new() };
        let error = engine.set_shutter_ends(Some([end(moving), end(Camera { height: None, ..moving })])).unwrap_err();
        assert!(matches!(error, Error::Setting { name: "camera", .. }), "{error}");
        engine.set_shutter_ends(Some([end(moving), end(Camera { height: Some(3.5), ..moving })])).unwrap();
        assert_eq!(engine.while_open().unwrap().0[1].height, Some(3.5));
        // They are those of an orthographic camera: one of the other kind starts without.
        engine.set_camera(Camera { height: None, ..moving }).unwrap();
        assert_eq!(engine.while_open().unwrap().0.map(|camera| camera.height), [None; 2]);
    });
}
