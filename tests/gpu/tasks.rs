//! Passes put together of tasks: a class of pixels in a band of rows, shaded by renderers that know nothing of one another.

use lightsum::cluster::points::{PassPoints, Shape, TaskPoints, packing};
use lightsum::pass::ShadingPoints;
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
                    points.take(TaskPoints::from_bytes(*task, &bytes).unwrap()).unwrap();
                }
                assert!(master.pass_from(pass, &mut points).unwrap());
                points.clear();
            }
            assert!(master.film().unwrap() == whole.film().unwrap(), "{name}: the films differ");
            assert_eq!(one.film().unwrap().passes(), 0, "{name}: a client adds nothing to its film");
        }
    });
}

/// Values of the points of `to_bytes`, array by array: f32, and the hits.
fn values(bytes: &[u8], slots: usize) -> (Vec<Vec<[f32; 4]>>, Vec<u32>) {
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(bytes);
    let (tiles, count) = (words[0] as usize, words[1] as usize);
    let (values, hits) = words[3 + tiles..].split_at(4 * count);
    let values: Vec<[f32; 4]> = values.chunks(4).map(|v| [v[0], v[1], v[2], v[3]].map(f32::from_bits)).collect();
    assert_eq!(values.len(), 11 * slots.max(count / 11));
    (values.chunks(count / 11).map(<[_]>::to_vec).collect(), hits.to_vec())
}

#[test]
fn packed_points_err_by_at_most_their_bounds() {
    gpu_test(|ctx| {
        let scene = gallery();
        let camera = Camera { resolution: [83, 61], ..scene.camera.unwrap() };
        let settings = all_kinds().swap_remove(1).1;
        let mut one = renderer(ctx, &scene, camera, &settings);
        let whole = Task { region: Region::whole(camera.resolution), class: None };
        let points = one.points_of(0, &whole).unwrap();
        let (shape, parameters) = (Shape::of(one.engine()), one.engine().plan().parameters(0).unwrap());
        let packed = points.pack(&shape, &parameters);
        let unpacked = TaskPoints::unpack(whole, &shape, &packed).unwrap();
        for end in [0, 1, 100, packed.len() - 9] {
            assert!(TaskPoints::unpack(whole, &shape, &packed[..end]).is_err(), "{end} bytes");
        }
        let ((exact, hits), (found, found_hits)) = (values(&points.to_bytes(), 0), values(&unpacked.to_bytes(), 0));
        let as_far = |a: u32, b: u32| {
            let [a, b] = [a, b].map(f32::from_bits);
            (a - b).abs() <= packing::DEPTH_ERROR * a.abs()
        };
        assert_eq!(hits.len(), found_hits.len());
        for (a, b) in hits.chunks(2).zip(found_hits.chunks(2)) {
            assert!(a[0] == b[0] && as_far(a[1], b[1]), "first hits {a:?} and {b:?}");
        }
        let largest = |v: [f32; 4]| v[0].max(v[1]).max(v[2]);
        let mut near = 0;
        for array in 0..11 {
            let most = exact[array]
                .iter()
                .zip(&exact[5])
                .filter(|(_, wo)| ShadingPoints::flags(wo[3]) & ShadingPoints::LIT != 0 || array < 8);
            let most = most.map(|(v, _)| largest(*v)).fold(0.0, f32::max);
            for (i, (a, b)) in exact[array].iter().zip(&found[array]).enumerate() {
                let flags = ShadingPoints::flags(exact[5][i][3]);
                let (hit, lit) = (flags & ShadingPoints::HIT != 0, flags & ShadingPoints::LIT != 0);
                let bound = match array {
                    0 if hit => packing::POSITION_ERROR * parameters.eye[3],
                    1 | 2 | 5 if hit => packing::NORMAL_ERROR,
                    3 | 4 => 1.0 / 509.0,
                    6 | 7 => (largest(*a) * 1.001 / 512.0).max(most * (-38f32).exp2()),
                    8..=10 if lit => (largest(*a) * 1.001 / 512.0).max(most * (-38f32).exp2()),
                    _ => continue,
                };
                let apart = [0, 1, 2].map(|axis| a[axis] - b[axis]);
                let error = match array {
                    1 | 2 | 5 => glam::Vec3::from(apart).length(),
                    _ => glam::Vec3::from(apart).abs().max_element(),
                };
                assert!(error <= bound, "array {array}, slot {i}: {a:?} and {b:?}, {error} over {bound}");
                near += usize::from(error > 0.5 * bound);
                match array {
                    // f90 and alpha of those that have a lobe.
                    1 | 2 if flags & ShadingPoints::GLOSSY != 0 => assert_eq!(a[3], b[3]),
                    0 if hit => assert!(as_far(a[3].to_bits(), b[3].to_bits()), "distances {} and {}", a[3], b[3]),
                    5 => assert_eq!(flags, ShadingPoints::flags(b[3])),
                    7 if hit => {
                        assert!((a[3] - b[3]).abs() <= packing::DEPTH_ERROR * a[3].abs(), "depth {} and {}", a[3], b[3])
                    }
                    _ => {}
                }
            }
        }
        assert!(near > 1000, "{near} errors near their bounds");
    });
}

/// Below 12 bytes a pixel, and an image whose error is far below that of a display.
#[test]
fn packed_passes_are_small_and_nearly_the_same() {
    gpu_test(|ctx| {
        let scene = lightsum::scene::load(std::path::Path::new("scenes/cornell/scene.toml")).unwrap();
        let camera = Camera { resolution: [160, 120], ..scene.camera.unwrap() };
        let settings = Settings { compensation: Compensation::Off, particles: 4, ..Settings::interactive() };
        let [mut whole, mut master, mut client] = [0; 3].map(|_| renderer(ctx, &scene, camera, &settings));
        let shape = Shape::of(master.engine());
        let parameters = client.engine().plan().parameters(0).unwrap();
        let (mut points, mut bytes) = (PassPoints::new(shape), 0);
        for task in Task::cut(&settings, camera.resolution, 1) {
            let packed = client.points_of(0, &task).unwrap().pack(&shape, &parameters);
            bytes += packed.len();
            points.take_packed(task, &packed).unwrap();
        }
        assert!(master.pass_from(0, &mut points).unwrap());
        whole.pass().unwrap();
        let a_pixel = bytes as f64 / (160.0 * 120.0);
        let [a, b] = [&whole, &master].map(|renderer| renderer.layers().unwrap().color);
        let square: f32 = a.iter().zip(&b).map(|(a, b)| a.distance_squared(*b)).sum();
        let error = (square / a.iter().map(|a| a.length_squared()).sum::<f32>()).sqrt();
        println!("{a_pixel:.2} bytes a pixel, relative error {error}");
        assert!(a_pixel < 12.0, "{a_pixel} bytes a pixel");
        assert!(error < 2e-3 && error > 0.0, "{error}");
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
        points.take(upper.clone()).unwrap();
        let refused = one.pass_from(0, &mut points).unwrap_err().to_string();
        assert!(refused.contains("192 pixels of the pass are missing"), "{refused}");
        let bytes = upper.to_bytes();
        assert!(points.take(TaskPoints::from_bytes(band(0, 7), &bytes).unwrap()).is_err());
        assert!(TaskPoints::from_bytes(band(0, 8), &bytes[1..]).is_err());
        assert!(TaskPoints::from_bytes(band(0, 8), &bytes[..5]).is_err());
        assert!(one.points_of(0, &band(8, 9)).unwrap_err().to_string().contains("beyond the image"));
        let near = Settings { compensation: Compensation::Near, ..Settings::interactive() };
        let mut near = renderer(ctx, &scene, camera, &near);
        let refused = near.points_of(0, &band(0, 16)).unwrap_err().to_string();
        assert!(refused.contains("--cluster-tasks") && refused.contains("near"), "{refused}");
    });
}
