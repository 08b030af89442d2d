//! Near light from the irradiance of pixels: who sends rays, and its energy against the exact way.

use lightsum::pass::near_points;
use lightsum::settings::{Compensation, Filter, Settings};

use crate::scenes::render;
use crate::support::gpu_test;

#[test]
fn every_class_sends_near_rays_as_often_as_any() {
    let frame = |pass: u32, classes: u32| lightsum::pass::layout::FrameParameters {
        size: [1, 1, 1, pass / 2],
        keys: [0, 0, 0, pass % 2],
        pattern: [classes, 1, classes, 0],
        ..Default::default()
    };
    for classes in [1, 2, 3, 4, 9, 64] {
        for (class, first) in (0..classes).flat_map(|class| [(class, 0), (class, 7)]) {
            let rays = (first..first + 5).filter(|&pass| near_points::has_near_ray(&frame(pass, classes), 0, class, 0));
            assert!(rays.count() >= 1, "class {class} of {classes} after pass {first}");
        }
        // On average each pixel counts once.
        for class in 0..classes {
            let rays =
                (0..classes).filter(|&pass| near_points::has_near_ray(&frame(pass, classes), 0, class, 0)).count();
            let sum = rays as f32 * near_points::ray_weight(&frame(0, classes), 0, 0);
            assert!((sum / classes as f32 - 1.0).abs() < 1e-5, "class {class} of {classes}: {sum}");
        }
    }
}

#[test]
fn near_light_has_the_energy_of_the_exact_way() {
    gpu_test(|ctx| {
        let scene = lightsum::scene::load(std::path::Path::new("scenes/indirect-room/scene.toml")).unwrap();
        let camera = lightsum::scene::Camera { resolution: [64, 48], ..scene.camera.unwrap() };
        let energy = |compensation: Compensation| {
            // The same lights for all three, so that their noise cancels: the exact way has no pool.
            let base = Settings { particles: 20, light_pool: 0, ..Settings::interactive() };
            let settings = Settings { compensation, filter: Some(Filter::default()), ..base };
            let image = render(ctx, &scene, camera, &settings, 64);
            image.color.iter().map(|c| f64::from(c.element_sum())).sum::<f64>()
        };
        let [off, near, exact] = [Compensation::Off, Compensation::Near, Compensation::Exact].map(energy);
        println!("off {:.4}, near {:.4} of the exact energy", off / exact, near / exact);
        assert!((near / exact - 1.0).abs() < 0.01 && off / exact < 0.95);
    });
}
