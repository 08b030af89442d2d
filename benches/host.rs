//! Stages on the host: loading, trees, tables, sequences, files. Needs no device.
//!
//! ```text
//! cargo bench --bench host                 # all
//! cargo bench --bench host -- bvh          # those whose name contains "bvh"
//! ```

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use lightsum::accel::Bvh;
use lightsum::accel::objects::ObjectTrees;
use lightsum::accel::wide::WideBvh;
use lightsum::light::emitters::Emitters;
use lightsum::output::{self, Encoding, Layers, Metadata};
use lightsum::sampling::{halton, sobol};
use lightsum::scene::{self, Scene, builtin};
use lightsum::superposition::kernels::KernelLibrary;
use lightsum::superposition::lobe::Lobe;
use lightsum::superposition::reflectance::ReflectanceMap;

/// Triangles of the generated room, roughly.
const TRIANGLES: u32 = 20_000;
/// Points of a sequence in one measurement, and dimensions of each.
const POINTS: u32 = 4096;
const DIMENSIONS: usize = 8;
/// Size of the images written.
const RESOLUTION: [u32; 2] = [640, 480];

/// Reading a file up to a validated [`Scene`].
fn load(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("load");
    for (name, file) in [
        ("obj/cornell", "scenes/cornell/scene.toml"),
        ("obj/indirect-room", "scenes/indirect-room/scene.toml"),
        ("glb/six-rooms", "scenes/six-rooms/scene.toml"),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        group.bench_function(name, |b| b.iter(|| scene::load(&path).expect("the scene loads")));
    }
}

/// The trees over a room: one over all triangles, the eight-wide one made from it, and one for each object.
fn trees(criterion: &mut Criterion) {
    let room = builtin::room(TRIANGLES);
    let mut group = criterion.benchmark_group("bvh");
    group.throughput(Throughput::Elements(room.triangles.len() as u64));
    group.bench_function("build", |b| b.iter(|| Bvh::build(&room).expect("the room has triangles")));
    let bvh = Bvh::build(&room).expect("the room has triangles");
    group.bench_function("wide", |b| b.iter(|| WideBvh::build(&bvh)));
    group.bench_function("build_objects", |b| {
        b.iter(|| ObjectTrees::build(&room, true).expect("the room has triangles"))
    });
    group.finish();

    // The object with the most triangles moves there and back.
    let object = largest_object(&room);
    let moved = displaced(&room, object, Vec3::new(0.05, 0.0, 0.0));
    let count = room.triangles.iter().filter(|t| t.object == object).count();
    let mut group = criterion.benchmark_group("bvh");
    group.throughput(Throughput::Elements(count as u64));
    group.bench_function("refit", |b| {
        let (mut trees, mut bvh) = ObjectTrees::build(&room, true).expect("the room has triangles");
        let mut there = false;
        b.iter(|| {
            there = !there;
            black_box(trees.update(&mut bvh, if there { &moved } else { &room }, &[object]))
        });
    });
    group.finish();

    criterion.bench_function("emitters", |b| b.iter(|| Emitters::of(&room, true).expect("the room has a lamp")));
}

fn largest_object(scene: &Scene) -> u32 {
    let count = |object: u32| scene.triangles.iter().filter(|t| t.object == object).count();
    (0..scene.objects.len() as u32).max_by_key(|&object| count(object)).expect("the room has objects")
}

/// The scene with one object moved; objects of the room share no vertices.
fn displaced(scene: &Scene, object: u32, by: Vec3) -> Scene {
    let mut scene = scene.clone();
    let mut vertices: Vec<u32> =
        scene.triangles.iter().filter(|t| t.object == object).flat_map(|t| t.vertices).collect();
    vertices.sort_unstable();
    vertices.dedup();
    for vertex in vertices {
        scene.positions[vertex as usize] += by;
    }
    scene
}

/// Tables for glossy planes: the convolution kernels of one lobe, and the reflectance over directions.
fn tables(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("superposition");
    // Some 0.3 s on two idle cores.
    group.sample_size(10).sampling_mode(SamplingMode::Flat).measurement_time(Duration::from_secs(6));
    group.bench_function("kernels", |b| {
        b.iter(|| {
            let mut library = KernelLibrary::new();
            library.add(0, Lobe::Ggx { alpha: 0.1 }).expect("the lobe is valid");
            library
        })
    });
    group.finish();
    let mut group = criterion.benchmark_group("superposition");
    group.bench_function("reflectance", |b| {
        b.iter(|| ReflectanceMap::fresnel(Vec3::splat(0.04)).expect("the reflectance is valid"))
    });
}

/// The low-discrepancy sequences, point by point.
fn sequences(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sampling");
    group.throughput(Throughput::Elements(u64::from(POINTS) * DIMENSIONS as u64));
    group.bench_function("halton", |b| {
        b.iter(|| (0..POINTS).flat_map(|i| (0..DIMENSIONS).map(move |d| halton::halton(d, black_box(i)))).sum::<f32>())
    });
    group.bench_function("sobol", |b| {
        b.iter(|| {
            let points = (0..POINTS).flat_map(|i| (0..DIMENSIONS).map(move |d| sobol::sobol(d, black_box(i))));
            points.map(sobol::unit).sum::<f32>()
        })
    });
}

/// Image files, with all layers that a rendering writes.
fn files(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let layers = gradient(RESOLUTION);
    let (metadata, encoding) = (Metadata::default(), Encoding::default());
    let mut group = criterion.benchmark_group("write");
    group.throughput(Throughput::Elements(u64::from(RESOLUTION[0]) * u64::from(RESOLUTION[1])));
    group.sample_size(10).sampling_mode(SamplingMode::Flat).measurement_time(Duration::from_secs(5));
    for extension in ["exr", "png"] {
        let path: PathBuf = folder.path().join("image").with_extension(extension);
        group.bench_function(extension, |b| {
            b.iter(|| output::write(&path, &layers, &metadata, &encoding).expect("the file can be written"))
        });
    }
}

/// An image that compresses about as well as a rendering: smooth, with a little noise in the low digits.
fn gradient([width, height]: [u32; 2]) -> Layers {
    let count = width * height;
    let value = |i: u32, k: u32| {
        let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
        let noise = (i.wrapping_mul(747_796_405).wrapping_add(k) >> 22) as f32 / 1024.0;
        x * y + 0.01 * noise
    };
    let rgb = |k: u32| (0..count).map(|i| Vec3::new(value(i, k), value(i, k + 1), value(i, k + 2))).collect::<Vec<_>>();
    Layers {
        width,
        height,
        color: rgb(0),
        albedo: rgb(3),
        normal: (0..count).map(|i| Vec3::new(value(i, 6), value(i, 7), 1.0).normalize()).collect(),
        depth: (0..count).map(|i| 1.0 + value(i, 8)).collect(),
        direct: rgb(9),
        indirect: rgb(12),
        alpha: vec![1.0; count as usize],
        ..Layers::default()
    }
}

fn settings() -> Criterion {
    Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3))
}

criterion_group! { name = host; config = settings(); targets = load, trees, tables, sequences, files }
criterion_main!(host);
