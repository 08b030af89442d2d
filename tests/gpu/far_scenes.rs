//! A scene far from the origin of its file gives the image of the same scene at the origin.

use std::path::Path;

use lightsum::scene::{self, Camera, Scene};
use lightsum::settings::Settings;

use crate::scenes::{compare, render};
use crate::support::gpu_test;

#[test]
fn a_far_cornell_box_is_as_bright_as_a_near_one() {
    gpu_test(|ctx| {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
        let obj = std::fs::read_to_string(source.join("cornell.obj")).unwrap();
        let folder = tempfile::TempDir::new().unwrap();
        std::fs::copy(source.join("cornell.mtl"), folder.path().join("cornell.mtl")).unwrap();
        // 10^4 times its size.
        let by = [5_590_000.0, -3_910_000.0, 1_730_000.0];
        let moved: Vec<String> = (obj.lines())
            .map(|line| match line.strip_prefix("v ") {
                Some(rest) => {
                    let place = rest.split_whitespace().zip(by).map(|(x, by)| x.parse::<f64>().unwrap() + by);
                    format!("v {}", place.map(|x| format!("{x:.3}")).collect::<Vec<_>>().join(" "))
                }
                None => line.to_string(),
            })
            .collect();
        std::fs::write(folder.path().join("cornell.obj"), moved.join("\n")).unwrap();
        let near = scene::load(&source.join("scene.toml")).unwrap();
        let far = scene::load(&folder.path().join("cornell.obj")).unwrap();
        let camera = Camera { resolution: [24, 18], ..near.camera.unwrap() };
        let at = |p: glam::Vec3| far.from_world(p.as_dvec3() + glam::DVec3::from_array(by));
        let far_camera = Camera { eye: at(camera.eye), target: at(camera.target), ..camera };
        for settings in [Settings::plain(), Settings::interactive()] {
            let image = |scene: &Scene, camera| render(ctx, scene, camera, &settings, 2).color;
            let (energy, error) = compare(&image(&far, far_camera), &image(&near, camera));
            println!("energy {energy:.5}, error {error:.5}");
            assert!((energy - 1.0).abs() < 1e-3 && error < 0.01, "energy {energy}, error {error}");
        }
    });
}
