//! Passes put together of tasks: a class of pixels in a band of rows, shaded by renderers that know nothing of one another.

use glam::Vec3;
use lightsum::cluster::points::{PassPoints, Shape, TaskPoints, packing};
use lightsum::engine::ShutterEnd;
use lightsum::gpu::Context;
use lightsum::pass::ShadingPoints;
use lightsum::scene::{Camera, Scene};
use lightsum::settings::{Compensation, Settings, SoftShadows, Splats, Spread, Superposition};
use lightsum::standalone::Renderer;
use lightsum::view::{Region, Task};

use crate::frosted_panes;
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

/// A scene, its camera and settings, and whether its objects and its camera move while the shutter is open.
type Stage = (&'static str, Scene, Camera, Settings, bool);

/// Stages that look at more than a pixel: near light at those of its class, the others at what the points tell.
fn stages() -> Vec<Stage> {
    let size = |scene: &Scene| Camera { resolution: [83, 61], ..scene.camera.unwrap() };
    let interactive = Settings { particles: 6, ..Settings::interactive() };
    let exact = Settings { compensation: Compensation::Exact, ..interactive.clone() };
    let plain = Settings { compensation: Compensation::Off, ..Settings::plain() };
    let spread = |spread| Some(Superposition { spread, ..Superposition::default() });
    let (gallery, panes) = (gallery(), frosted_panes::room());
    let camera = size(&gallery);
    let of_panes = |spread_by| Settings { superposition: spread(spread_by), particles: 4, ..plain.clone() };
    let splats = Some(Splats { particles: 500, ..Splats::default() });
    vec![
        ("near light", gallery.clone(), camera, Settings { filter: None, ..interactive.clone() }, false),
        ("near light, spread", gallery.clone(), camera, interactive.clone(), false),
        ("interactive", gallery.clone(), camera, exact.clone(), false),
        ("mirror images", gallery.clone(), camera, of_panes(Spread::Variant), false),
        ("panes", panes.clone(), size(&panes), of_panes(Spread::Variant), false),
        ("panes, near light", panes.clone(), size(&panes), interactive, false),
        ("kernels of one width", panes.clone(), size(&panes), of_panes(Spread::Invariant), false),
        ("lens", gallery.clone(), Camera { aperture: 0.1, ..camera }, exact.clone(), false),
        ("shutter", gallery.clone(), Camera { shutter: 0.5, ..camera }, exact.clone(), true),
        ("splats", gallery, camera, Settings { splats, ..exact }, false),
    ]
}

/// A renderer of a stage.
fn of_stage(ctx: &Context, (_, scene, camera, settings, moves): &Stage) -> Renderer {
    let mut own = renderer(ctx, scene, *camera, settings);
    if *moves {
        let end = |s: f32| Camera { target: camera.target + s * 0.3 * Vec3::X, ..*camera };
        let ends = [-0.5, 0.5].map(|s| ShutterEnd { camera: end(s), objects: Vec::new() });
        own.set_shutter_ends(Some(ends)).unwrap();
    }
    own
}

#[test]
fn stages_that_look_further_have_the_bits_of_one_renderer() {
    gpu_test(|ctx| {
        for stage in stages() {
            let (name, _, camera, settings, _) = &stage;
            let [mut whole, mut master, mut one, mut other] = [0; 4].map(|_| of_stage(ctx, &stage));
            let shape = Shape::of(master.engine());
            let (mut points, mut bytes) = (PassPoints::new(shape), 0);
            let mut packed = [false, true].map(|on_device| PassPoints::new(shape).unpacked_on_device(on_device));
            let mut mixed = PassPoints::new(shape).unpacked_on_device(true);
            for pass in 0..2 {
                whole.pass().unwrap();
                let parameters = one.engine().plan().parameters(pass).unwrap();
                let tasks = Task::cut(settings, camera.resolution, 12);
                for (i, task) in tasks.iter().rev().enumerate() {
                    let client = if i % 3 == 0 { &mut one } else { &mut other };
                    let own = client.points_of(pass, task).unwrap();
                    points.take(TaskPoints::from_bytes(*task, &own.to_bytes()).unwrap()).unwrap();
                    if pass == 0 {
                        let few = own.pack(&shape, &parameters);
                        assert!(TaskPoints::unpack(*task, &shape, &few[..few.len() - 9]).is_err());
                        bytes += few.len();
                        packed.iter_mut().for_each(|points| points.take_packed(*task, &few).unwrap());
                        match i {
                            1 => mixed.take(TaskPoints::unpack(*task, &shape, &few).unwrap()).unwrap(),
                            _ => mixed.take_packed(*task, &few).unwrap(),
                        }
                    }
                }
                assert!(master.pass_from(pass, &mut points).unwrap());
                points.clear();
            }
            assert!(master.film().unwrap() == whole.film().unwrap(), "{name}: the films differ");
            // In few bytes the first pass is about the same: edges, and pixels of strong contrast without a filter, tell most of the difference.
            let mut exact = of_stage(ctx, &stage);
            exact.pass().unwrap();
            let exact = exact.layers().unwrap().color;
            let whole = exact.iter().map(|l| l.length_squared()).sum::<f32>();
            println!("{name}: {:.2} bytes a pixel", bytes as f64 / f64::from(83 * 61));
            let (mut films, mut images) = (Vec::new(), Vec::new());
            for points in packed.iter_mut().chain([&mut mixed]) {
                let mut rounded = of_stage(ctx, &stage);
                assert!(rounded.pass_from(0, points).unwrap());
                films.push(rounded.film().unwrap());
                let found = rounded.layers().unwrap().color;
                let square: f32 = exact.iter().zip(&found).map(|(a, b)| a.distance_squared(*b)).sum();
                let error = (square / whole).sqrt();
                println!("{name}: relative error {error}");
                assert!(error < 0.05, "{name}: {error}");
                images.push(found);
            }
            let apart: f32 = images[0].iter().zip(&images[1]).map(|(a, b)| a.distance_squared(*b)).sum();
            let apart = (apart / whole).sqrt();
            println!("{name}: unpacked by the device {apart} apart from those of the host");
            assert!(apart < 1e-4, "{name}: {apart}");
            assert!(films[2] == films[0], "{name}: with the points of one task that came exactly the device's differ");
        }
    });
}

/// Values of the points of `to_bytes`, array by array: f32, and the hits.
fn values(bytes: &[u8], slots: usize) -> (Vec<Vec<[f32; 4]>>, Vec<u32>) {
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(bytes);
    let (tiles, count) = (words[0] as usize, words[1] as usize);
    let (values, hits) = words[4 + tiles..].split_at(4 * count);
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
        // All pixels of a class, or none.
        let near = Settings { compensation: Compensation::Near, ..Settings::interactive() };
        assert_eq!(Task::cut(&near, [24, 300], 20).len() as u32, near.classes());
        let mut near = renderer(ctx, &scene, camera, &near);
        let refused = near.points_of(0, &band(0, 8)).unwrap_err().to_string();
        assert!(refused.contains("--cluster-tasks") && refused.contains("near"), "{refused}");
        let soft = Settings { soft_shadows: Some(SoftShadows::default()), ..Settings::plain() };
        let mut soft = renderer(ctx, &scene, camera, &soft);
        let refused = soft.points_of(0, &band(0, 16)).unwrap_err().to_string();
        assert!(refused.contains("--cluster-tasks") && refused.contains("soft shadows"), "{refused}");
    });
}
