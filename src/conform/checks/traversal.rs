//! Shadow rays in clusters against single shadow rays.

use crate::conform::findings;
use crate::conform::{Bench, Must};
use crate::pass::clusters::{self, NO_POINT};
use crate::pass::sort;
use crate::scene::{Alpha, Camera, Light, Material, Scene, Triangle, builtin};
use crate::settings::{Clip, ClusterOrder, Compensation, Settings, Traversal};
use crate::standalone::Renderer;
use glam::Vec3;

use crate::conform::rig::{gallery, gallery_with_alpha, is_lit, xyz};

fn settings(traversal: Traversal) -> Settings {
    Settings {
        traversal,
        particles: 16,
        clip: Clip::Distance(0.0),
        compensation: Compensation::Off,
        ..Settings::plain()
    }
}

/// Irradiance, direct and indirect, of every pixel after one pass.
fn irradiance(bench: &Bench, scene: &Scene, camera: Camera, settings: &Settings) -> Vec<Vec3> {
    let mut renderer = Renderer::with_context(bench.context(), scene.clone(), camera, settings.clone()).must();
    renderer.pass().must();
    let layers = renderer.layers().must();
    layers.direct.into_iter().chain(layers.indirect).collect()
}

/// Compares both kernels; pixels that see a light past an edge may differ, at most `strays` of a thousand.
fn compare(bench: &Bench, name: &str, scene: &Scene, camera: Camera, strays: usize) {
    compare_interleaved(bench, name, scene, camera, [1, 1], strays);
}

/// As [`compare`], with lights for each class of pixels.
fn compare_interleaved(bench: &Bench, name: &str, scene: &Scene, camera: Camera, pattern: [u32; 2], strays: usize) {
    let by = |traversal| irradiance(bench, scene, camera, &Settings { pattern, ..settings(traversal) });
    let (single, auto) = (by(Traversal::Single), by(Traversal::Auto));
    let level = single.iter().sum::<Vec3>() / single.len() as f32;
    assert!(level.max_element() > 0.0, "{name}: nothing is lit");
    let differ = (single.iter().zip(&auto))
        .filter(|(s, c)| !(**s - **c).abs().cmple(s.abs() * 1e-4 + level * 1e-5).all())
        .count();
    findings::compared(single.len(), differ);
    assert!(differ * 1000 <= strays * single.len(), "{name}: {differ} of {} differ", single.len());
}

fn with_camera(scene: Scene, resolution: [u32; 2]) -> (Scene, Camera) {
    let camera = Camera { resolution, ..scene.camera.unwrap() };
    (scene, camera)
}

pub fn clusters_see_what_single_rays_see(bench: &Bench) {
    for n in [300, 20_000] {
        let (scene, camera) = with_camera(builtin::room(n), [83, 61]);
        compare(bench, &format!("room of {n}"), &scene, camera, 4);
    }
    let (scene, camera) = with_camera(builtin::furnace(0.5, 1.0), [31, 17]);
    compare(bench, "furnace", &scene, camera, 4);
    let (scene, camera) = with_camera(builtin::sphere_point_lights(4), [27, 1]);
    compare(bench, "sphere", &scene, camera, 4);
    // Clusters of one class of pixels, of the maximum number of classes, and of more classes than there are pixels.
    for (resolution, pattern) in [([83, 61], [3, 3]), ([83, 61], [8, 8]), ([5, 7], [8, 8]), ([64, 27], [1, 2])] {
        let (scene, camera) = with_camera(builtin::room(2_000), resolution);
        compare_interleaved(bench, &format!("{resolution:?} by {pattern:?}"), &scene, camera, pattern, 4);
    }
}

pub fn clusters_may_span_the_whole_scene(bench: &Bench) {
    // Few pixels see everything, so the shaft of one cluster is the room itself.
    for resolution in [[1, 1], [8, 8], [3, 5]] {
        let (scene, camera) = with_camera(builtin::room(5_000), resolution);
        compare(bench, &format!("{resolution:?}"), &scene, camera, 35);
    }
}

pub fn a_tree_that_outlasts_the_budget_is_finished_ray_by_ray(bench: &Bench) {
    let (scene, camera) = with_camera(builtin::deep_scene(3_000), [16, 16]);
    compare(bench, "deep scene", &scene, camera, 10);
}

pub fn clusters_pass_many_thin_veils_as_single_rays_do(bench: &Bench) {
    for (needles, opacity) in [(300, 0.2), (3_000, 0.03)] {
        let (mut scene, camera) = with_camera(builtin::deep_scene(needles), [16, 16]);
        scene.materials.iter_mut().for_each(|m| m.alpha = Alpha::Blend { opacity });
        compare(bench, &format!("{needles} veils"), &scene, camera, 10);
    }
    let scene = gallery_with_alpha();
    let camera = Camera { resolution: [83, 61], ..scene.camera.unwrap() };
    compare(bench, "gallery", &scene, camera, 4);
    compare_interleaved(bench, "gallery by classes", &scene, camera, [3, 3], 4);
}

pub fn lights_in_awkward_places(bench: &Bench) {
    let (mut scene, camera) = with_camera(builtin::room(2_000), [41, 31]);
    let (low, high) = scene.bounds();
    let vertex = scene.positions[scene.positions.len() / 2];
    let triangle = scene.triangle_positions(scene.triangles.len() / 3);
    let centre = (triangle[0] + triangle[1] + triangle[2]) / 3.0;
    let intensity = Vec3::splat(10.0);
    // A light in the plane of faces touches or grazes them, and rounding decides whether they block it.
    for (name, position, strays) in [
        ("at a vertex", vertex, 200),
        ("on a surface", centre, 200),
        ("outside", high + (high - low), 4),
        ("in a corner", low, 200),
    ] {
        // The room's own light stays, so that there is always some light.
        scene.lights = vec![Light::Point { position, intensity }];
        compare(bench, name, &scene, camera, strays);
    }
    scene.lights = vec![
        Light::Directional { direction: Vec3::new(0.3, -1.0, 0.2).normalize(), irradiance: Vec3::ONE },
        Light::Point { position: (low + high) * 0.5, intensity },
    ];
    compare(bench, "parallel light beside a point", &scene, camera, 4);
}

pub fn a_scene_of_one_triangle(bench: &Bench) {
    let material = Material::default();
    let scene = Scene {
        positions: vec![Vec3::new(-1.0, 0.0, -1.0), Vec3::new(0.0, 0.0, 1.0), Vec3::new(1.0, 0.0, -1.0)],
        normals: vec![Vec3::Y; 3],
        uvs: vec![glam::Vec2::ZERO; 3],
        triangles: vec![Triangle { vertices: [0, 1, 2], material: 0, object: 0, smooth: false }],
        objects: vec![String::from("triangle")],
        materials: vec![material],
        lights: vec![Light::Point { position: Vec3::Y, intensity: Vec3::ONE }],
        ..Scene::default()
    };
    let camera = Camera {
        eye: Vec3::new(0.0, 2.0, 0.1),
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y: 60.0,
        resolution: [27, 19],
        aperture: 0.0,
        focus: None,
        shutter: 0.0,
        height: None,
        frustum: None,
    };
    compare(bench, "one triangle", &scene, camera, 4);
}

pub fn lists_are_sorted_and_the_same_in_every_run(bench: &Bench) {
    let sizes = [[1, 1], [27, 1], [8, 8], [683, 3], [31, 17], [157, 163]];
    let patterns = [[1, 1], [2, 1], [3, 3], [8, 8], [3, 2], [1, 1], [8, 5]];
    for ([width, height], pattern) in sizes.into_iter().cycle().zip(patterns) {
        let scene = gallery();
        let run = || {
            let by_space = Settings { pattern, cluster_order: ClusterOrder::Space, ..settings(Traversal::Auto) };
            let rig = bench.rig(&scene, [width, height], by_space);
            // Second components outside tiles with mirrors and glass are not written; they are not lit.
            rig.prefill(&[&rig.frame().eye.points.wo]);
            rig.walk_and_look();
            let live = rig.work(0).live as usize;
            let list = rig.get::<u32>(&rig.frame().eye.list.entries)[..live].to_vec();
            let positions = rig.vec4s(&rig.frame().eye.points.position).into_iter().map(|p| xyz(p.to_array()));
            let lit = rig.vec4s(&rig.frame().eye.points.wo).into_iter().map(is_lit);
            (list, positions.collect::<Vec<Vec3>>(), lit.collect::<Vec<bool>>(), rig.parameters)
        };
        let (list, positions, lit, parameters) = run();
        if [4, 8, 16, 32, 64].contains(&bench.info().subgroup_size) {
            // Tile by tile, row by row within a tile; first components, then second ones.
            let pixels = width * height;
            let mut slots: Vec<u32> = (0..lit.len() as u32).filter(|&p| lit[p as usize]).collect();
            slots.sort_by_key(|p| {
                let (x, y) = (p % pixels % width, p % pixels / width);
                (p / pixels, y / 8, x / 8, y % 8, x % 8)
            });
            assert_eq!(list, sort::reference(&parameters, &slots, &positions), "{width}x{height}");
            assert_eq!(list, run().0, "{width}x{height}, again");
        } else {
            let mut sorted = list;
            sorted.sort();
            assert!(sorted.iter().copied().eq((0..lit.len() as u32).filter(|&p| lit[p as usize])), "{width}x{height}");
        }
    }
}

pub fn clusters_of_the_screen_follow_their_oracle(bench: &Bench) {
    let sizes = [[1, 1], [27, 1], [8, 8], [683, 3], [31, 17], [157, 163]];
    let patterns = [[1, 1], [2, 1], [3, 3], [8, 8], [3, 2], [1, 1], [8, 5]];
    for ([width, height], pattern) in sizes.into_iter().cycle().zip(patterns) {
        let scene = gallery();
        let rig = bench.rig(&scene, [width, height], Settings { pattern, ..settings(Traversal::Auto) });
        rig.prefill(&[&rig.frame().eye.points.wo]);
        rig.walk_and_look();
        let work = rig.work(0);
        let list = rig.get::<u32>(&rig.frame().eye.list.entries)[..work.total as usize].to_vec();
        let wo = rig.vec4s(&rig.frame().eye.points.wo);
        let lit: Vec<u32> = (0..wo.len() as u32).filter(|&slot| is_lit(wo[slot as usize])).collect();
        assert_eq!(list, clusters::reference(&rig.parameters, &lit), "{width}x{height} by {pattern:?}");
        assert_eq!(work.live as usize, lit.len(), "{width}x{height} by {pattern:?}");
        let [x, y, ..] = work.list_groups;
        assert!(64 * x * y >= work.total, "{width}x{height} by {pattern:?}: {work:?}");
        let listed = rig.get::<[u32; 2]>(&rig.frame().eye.clusters.as_ref().unwrap().listed);
        for (cluster, [class, _]) in list.chunks(64).zip(listed) {
            let of = |slot: &u32| *slot == NO_POINT || sort::class_of(&rig.parameters, *slot) == class;
            assert!(cluster.iter().all(of), "{width}x{height} by {pattern:?}");
        }
    }
}

pub fn both_orders_of_clusters_give_the_same_light(bench: &Bench) {
    for (pattern, resolution) in [([1, 1], [83, 61]), ([3, 3], [83, 61]), ([3, 3], [5, 7]), ([8, 8], [64, 27])] {
        let (scene, camera) = with_camera(builtin::room(2_000), resolution);
        let by = |cluster_order| {
            let settings = Settings { pattern, cluster_order, ..settings(Traversal::Auto) };
            irradiance(bench, &scene, camera, &settings)
        };
        let (space, screen) = (by(ClusterOrder::Space), by(ClusterOrder::Screen));
        let level = space.iter().sum::<Vec3>() / space.len() as f32;
        assert!(level.min_element() > 0.0, "{pattern:?}: nothing is lit");
        // Shafts differ, and so do the tests of triangles that a ray just grazes.
        let apart = |(a, b): &(&Vec3, &Vec3)| !(**a - **b).abs().cmple(a.abs() * 1e-5 + level * 1e-6).all();
        let differ = space.iter().zip(&screen).filter(apart).count();
        assert!(differ * 1000 <= 4 * space.len(), "{pattern:?}: {differ} of {} differ", space.len());
    }
}
