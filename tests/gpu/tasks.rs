//! Passes put together of tasks: a class of pixels in a band of rows, shaded by renderers that know nothing of one another.

use lightsum::cluster::points::{PassPoints, Shape, TaskPoints};
use lightsum::scene::Camera;
use lightsum::settings::{Compensation, Settings};
use lightsum::view::{Region, Task};

use crate::rig::gallery;
use crate::scenes::renderer;
use crate::support::gpu_test;
use crate::views::all_kinds;

#[test]
fn tasks_of_several_renderers_have_the_bits_of_one() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [83, 61], ..scene.camera.unwrap() };
        for (name, settings) in all_kinds().into_iter().take(4) {
            let [mut whole, mut master, mut one, mut other] = [0; 4].map(|_| renderer(ctx, &scene, camera, &settings));
            let mut points = PassPoints::new(Shape::of(master.engine()));
            for pass in 0..2 {
                whole.pass().unwrap();
                let mut tasks = Task::cut(&settings, camera.resolution, 3);
                // In any order, and sent as bytes.
                tasks.reverse();
                for (i, task) in tasks.iter().enumerate() {
                    let client = if i % 3 == 0 { &mut one } else { &mut other };
                    let bytes = client.points_of(pass, task).unwrap().to_bytes();
                    assert!(!points.is_complete());
                    points.take(&TaskPoints::from_bytes(*task, &bytes).unwrap()).unwrap();
                }
                assert!(master.pass_from(pass, &points).unwrap());
                points.clear();
            }
            assert!(master.film().unwrap() == whole.film().unwrap(), "{name}: the films differ");
            assert_eq!(one.film().unwrap().passes(), 0, "{name}: a client adds nothing to its film");
        }
    });
}

#[test]
fn strange_points_and_settings_are_refused() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [24, 16], ..scene.camera.unwrap() };
        let settings = Settings { particles: 2, ..Settings::plain() };
        let mut one = renderer(ctx, &scene, camera, &settings);
        let band = |y, rows| Task { region: Region { origin: [0, y], size: [24, rows] }, class: None };
        let mut points = PassPoints::new(Shape::of(one.engine()));
        let upper = one.points_of(0, &band(0, 8)).unwrap();
        points.take(&upper).unwrap();
        let refused = one.pass_from(0, &points).unwrap_err().to_string();
        assert!(refused.contains("192 pixels of the pass are missing"), "{refused}");
        let bytes = upper.to_bytes();
        assert!(points.take(&TaskPoints::from_bytes(band(0, 7), &bytes).unwrap()).is_err());
        assert!(TaskPoints::from_bytes(band(0, 8), &bytes[1..]).is_err());
        assert!(TaskPoints::from_bytes(band(0, 8), &bytes[..5]).is_err());
        assert!(one.points_of(0, &band(8, 9)).unwrap_err().to_string().contains("beyond the image"));
        let near = Settings { compensation: Compensation::Near, ..Settings::interactive() };
        let mut near = renderer(ctx, &scene, camera, &near);
        let refused = near.points_of(0, &band(0, 16)).unwrap_err().to_string();
        assert!(refused.contains("--cluster-tasks") && refused.contains("near"), "{refused}");
    });
}
