//! Visible lights: both kernels against rays traced one by one on the CPU.

use crate::accel::{Bvh, offset_origin};
use crate::conform::findings;
use crate::conform::{Bench, Must};
use crate::device_scene::DeviceScene;
use crate::gpu::{Staging, download};
use crate::pass::TraversalKernels;
use crate::pass::layout::DispatchCounts;
use crate::pass::visibility::{Counts, Inputs, Visibility, Workload, reference};
use crate::scene::{Scene, builtin};
use crate::settings::{Settings, Traversal};
use glam::Vec3;

use crate::conform::rig::gallery;

/// A scene on the device.
struct Stage<'a> {
    bench: &'a Bench,
    scene: DeviceScene,
}

impl Stage<'_> {
    fn new<'a>(bench: &'a Bench, scene: &Scene) -> Stage<'a> {
        let mut staging = Staging::new();
        let scene = DeviceScene::new(bench, &mut staging, scene, true).must();
        bench.submit_and_wait("scene", None, |rec| staging.record(rec)).must();
        Stage { bench, scene }
    }

    fn bvh(&self) -> &Bvh {
        &self.scene.bvh
    }

    fn run(&self, kernels: TraversalKernels, workload: &Workload) -> Visibility {
        let settings = Settings { rounds: 64, ..Settings::plain() };
        let mut staging = Staging::new();
        let inputs = Inputs { kernels, scene: &self.scene, settings: &settings, workload };
        let pass = Visibility::new(self.bench, &mut staging, &inputs).must();
        self.bench.submit_and_wait("rays", None, |rec| staging.record(rec)).must();
        self.bench.submit_and_wait("tracing", None, |rec| pass.record(rec)).must();
        assert_eq!(download::<u32>(self.bench, &pass.status).must()[0], 0, "rays were lost");
        pass
    }

    /// Both kernels agree with the oracle, except for two rays and `strays` of a million more.
    fn check(&self, name: &str, workload: &Workload, strays: u64) {
        let expected = reference(self.bvh(), workload);
        let pairs = (workload.receivers.len() * workload.lights.len()) as u64;
        for traversal in [Traversal::Single, Traversal::Auto] {
            let kernels = workload.kernels(self.bench, traversal).must();
            let seen: Vec<u32> = download(self.bench, &self.run(kernels, workload).visible).must();
            assert_eq!(seen.len(), expected.len());
            let differ: u64 = seen.iter().zip(&expected).map(|(&a, &b)| u64::from(a.abs_diff(b))).sum();
            findings::compared(pairs as usize, differ as usize);
            assert!(
                differ <= 2 + pairs * strays / 1_000_000,
                "{name}, {traversal:?}: {differ} of {pairs} pairs differ"
            );
        }
    }
}

/// `count` points all over the surfaces, in no order, and `lights` lights in the air.
fn all_over(bench: &Bench, scene: &Scene, count: usize, lights: usize) -> Workload {
    let (low, high) = scene.bounds();
    let scale = low.abs().max(high.abs()).max_element();
    let mut numbers = bench.numbers(count as u32);
    let mut workload = Workload::default();
    for _ in 0..count {
        let triangle = (numbers.next() * scene.triangles.len() as f32) as usize;
        let [a, b, c] = scene.triangle_positions(triangle.min(scene.triangles.len() - 1));
        let (u, v) = (numbers.next().sqrt(), numbers.next());
        let n = (b - a).cross(c - a).normalize();
        workload.receivers.push(offset_origin(a * (1.0 - u) + b * (u * (1.0 - v)) + c * (u * v), n, scale));
        workload.normals.push(n);
    }
    workload.lights = (0..lights).map(|_| low + (high - low) * (numbers.vec3() * 0.98 + 0.01)).collect();
    workload
}

pub fn both_kernels_see_what_the_oracle_sees(bench: &Bench) {
    let scenes = [builtin::room(300), builtin::room(20_000), builtin::deep_scene(700), gallery()];
    for scene in &scenes {
        let stage = Stage::new(bench, scene);
        // One cluster spans the whole scene here, since neighbours on the list are not neighbours in space.
        for (count, lights) in [(1, 1), (27, 5), (64, 33), (2049, 9), (4099, 70)] {
            stage.check(&scene.name, &all_over(bench, scene, count, lights), 20);
        }
    }
}

/// The same with area lights in any direction, with edges of up to `share` of the diagonal; every seventh is a line.
fn areas(bench: &Bench, scene: &Scene, count: usize, lights: usize, share: f32) -> Workload {
    let (low, high) = scene.bounds();
    let mut numbers = bench.numbers(count as u32 ^ 0x55);
    let mut edge = |long: bool| {
        let direction = numbers.vec3() * 2.0 - 1.0;
        if long {
            direction.normalize_or(Vec3::X) * (numbers.next() * share * (high - low).length())
        } else {
            Vec3::ZERO
        }
    };
    let edges = (0..lights).map(|j| [edge(true), edge(j % 7 != 6)]).collect();
    Workload { edges, ..all_over(bench, scene, count, lights) }
}

pub fn both_kernels_see_the_points_of_area_lights(bench: &Bench) {
    let scenes = [builtin::room(300), builtin::room(20_000), builtin::deep_scene(700), gallery()];
    for scene in &scenes {
        let stage = Stage::new(bench, scene);
        for (count, lights) in [(1, 1), (27, 5), (64, 33), (2049, 9), (4099, 70)] {
            stage.check(&scene.name, &areas(bench, scene, count, lights, 0.3), 20);
        }
    }
}

pub fn area_lights_on_surfaces_and_in_their_planes(bench: &Bench) {
    let scene = builtin::room(2_000);
    let stage = Stage::new(bench, &scene);
    let mut workload = all_over(bench, &scene, 2_000, 0);
    // Parallelograms twice as large as the triangle that they lie on.
    for triangle in [0, 20, 333, 1_000, 1_600] {
        let [a, b, c] = scene.triangle_positions(triangle);
        let n = (b - a).cross(c - a).normalize();
        workload.lights.push(offset_origin(a, n, stage.bvh().scale()));
        workload.edges.push([b - a, c - a]);
    }
    stage.check("lifted area lights", &workload, 2_000);
}

pub fn degenerate_triangles_hide_no_area_light(bench: &Bench) {
    let mut scene = builtin::room(300);
    let workload = areas(bench, &scene, 500, 12, 0.2);
    let clear = reference(&Bvh::build(&scene).must(), &workload);
    // A point, and lines across the room along an axis and at an angle.
    let (low, high) = scene.bounds();
    let middle = (low + high) * 0.5;
    let ends = [(middle, middle), (Vec3::new(low.x, middle.y, middle.z), middle), (low, high)];
    for (from, to) in ends {
        let first = scene.positions.len() as u32;
        scene.positions.extend([from, to, to]);
        let model = scene.triangles[0];
        scene.triangles.push(crate::scene::Triangle { vertices: [first, first + 1, first + 2], ..model });
    }
    let stage = Stage::new(bench, &scene);
    assert_eq!(reference(stage.bvh(), &workload), clear);
    stage.check("degenerate triangles", &workload, 0);
}

pub fn tiny_area_lights_are_point_lights(bench: &Bench) {
    let scene = builtin::room(20_000);
    let stage = Stage::new(bench, &scene);
    let points = all_over(bench, &scene, 2_049, 33);
    let seen = |workload: &Workload, traversal| -> Vec<u32> {
        let kernels = workload.kernels(bench, traversal).must();
        download(bench, &stage.run(kernels, workload).visible).must()
    };
    let with_edges = |length: f32| {
        let edge = stage.bvh().diagonal() * length;
        Workload { edges: vec![[Vec3::X * edge, Vec3::Z * edge]; 33], ..points.clone() }
    };
    for traversal in [Traversal::Single, Traversal::Auto] {
        let expected = seen(&points, traversal);
        assert_eq!(seen(&with_edges(0.0), traversal), expected, "{traversal:?}");
        let differ = |length: f32| {
            let tiny = seen(&with_edges(length), traversal);
            tiny.iter().zip(&expected).map(|(&a, &b)| u64::from(a.abs_diff(b))).sum::<u64>()
        };
        // The remaining ones of 67,617 rays that pass this close to an edge.
        let (tiny, large) = (differ(1e-6), differ(0.2));
        log::info!("{traversal:?}: {tiny} rays differ for a millionth of the diagonal, {large} for a fifth");
        assert!(tiny <= 20 && large > 2_000, "{traversal:?}: {tiny} and {large} rays differ");
    }
}

pub fn lights_at_vertices_and_on_surfaces(bench: &Bench) {
    let scene = builtin::room(2_000);
    let stage = Stage::new(bench, &scene);
    let mut workload = all_over(bench, &scene, 2_000, 0);
    // Offset as in the walk. This close to a triangle, the planes through light and edges depend on the last bits
    // of the light's position.
    let scale = stage.bvh().scale();
    for triangle in [20, 333, 1_000, 1_600] {
        let [a, b, c] = scene.triangle_positions(triangle);
        let n = (b - a).cross(c - a).normalize();
        workload.lights.extend([a, (a + b) * 0.5, (a + b + c) / 3.0].map(|p| offset_origin(p, n, scale)));
    }
    stage.check("lifted lights", &workload, 2_000);
    // A light inside a sphere is invisible from outside, and vice versa.
    workload.lights = vec![(stage.bvh().min + stage.bvh().max) * 0.5, stage.bvh().max * 3.0];
    stage.check("inside and outside", &workload, 20);
}

pub fn what_faces_away_is_culled_and_counted(bench: &Bench) {
    let scene = builtin::room(2_000);
    let stage = Stage::new(bench, &scene);
    let (low, high) = scene.bounds();
    let middle = (low + high) * 0.5;
    // Two clusters on the floor, one of them facing down.
    let at = |i: usize| Vec3::new(middle.x + i as f32 * 1e-3, low.y + 0.1, middle.z);
    let mut workload = Workload {
        receivers: (0..128).map(at).collect(),
        normals: (0..128).map(|i| if i < 64 { Vec3::Y } else { -Vec3::Y }).collect(),
        lights: (0..40).map(|i| Vec3::new(middle.x, high.y - 0.2, low.z + 0.1 * i as f32)).collect(),
        ..Workload::default()
    };
    let kernels = workload.counting_kernels(bench).must();
    let counts = |workload: &Workload| {
        let pass = stage.run(kernels, workload);
        let words: Vec<u32> = download(bench, &pass.counters).must();
        let culled = download::<DispatchCounts>(bench, &pass.work).must()[0].culled;
        (Counts::new(words[..Counts::LENGTH].try_into().unwrap()), culled)
    };
    let (counted, culled) = counts(&workload);
    assert_eq!((counted.pairs, culled), (40, 40));
    assert_eq!(counted.rays, 40 * 64);
    assert!(counted.nodes >= 40 && counted.children >= counted.nodes - 40 && counted.triangles >= counted.leaves / 8);
    // Neither cluster culls area lights that extend from above the points to below them; rays to targets below the
    // first or above the second are not traced.
    let mut deep = workload.clone();
    deep.lights = vec![Vec3::new(middle.x, at(0).y - 1.0, middle.z); 20];
    deep.edges = vec![[Vec3::X, 2.0 * Vec3::Y]; 20];
    let kernels = deep.counting_kernels(bench).must();
    let pass = stage.run(kernels, &deep);
    let words: Vec<u32> = download(bench, &pass.counters).must();
    assert_eq!((words[0], download::<DispatchCounts>(bench, &pass.work).must()[0].culled), (2 * 20, 0));
    assert_eq!(u64::from(words[1]), deep.segments());
    assert!(deep.segments() > 900 && deep.segments() < 2 * 20 * 64 - 900);

    // Every pair is either culled or traced, also where clusters are not full.
    workload.receivers.truncate(99);
    workload.normals.truncate(99);
    let (counted, culled) = counts(&workload);
    assert_eq!(counted.pairs + culled, 2 * 40);
    assert_eq!(counted.rays, 40 * 64);
}
