//! Choice of the traversal kernel for shadow rays on a device, by a short measurement that is kept next to the pipeline cache.
//!
//! Lights a room by a few lights, once with single rays and once with clusters, and chooses the faster kernel; clusters only if
//! their visibility agrees with that of single rays. It takes about as long as compiling both kernels.
//!
//! File: one line of JSON with the device, its driver, this version of the program, and the measurement.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::accel::{Bvh, Ray, offset_origin};
use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::gpu::{Context, DeviceInfo, Staging, download};
use crate::output::write_cache;
use crate::pass::TraversalKernels;
use crate::pass::visibility::{Inputs, Visibility, Workload};
use crate::scene::{Camera, builtin};
use crate::settings::{Settings, Traversal};

/// Triangles of the room.
const TRIANGLES: u32 = 5_000;
/// Shading points along each axis of the image.
const SIDE: u32 = 96;
/// Repeats of each measurement; the fastest counts.
const REPEATS: u32 = 3;
/// Fraction of shading points whose number of visible lights may differ: rays within rounding of an edge.
const STRAYS: f64 = 0.01;

/// A measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Measured {
    /// Device, driver and program of the measurement.
    of: String,
    /// Seconds by single rays.
    single: f64,
    /// Seconds by clusters; `None` if their visibility disagreed.
    cluster: Option<f64>,
}

/// [`Traversal::Auto`] if clusters are faster, else [`Traversal::Single`].
///
/// Reads an earlier measurement from the file next to the pipeline cache `cache`, or measures and writes it there. A device
/// without a kernel for clusters needs no measurement.
pub fn choose(context: &Context, cache: &Path) -> Result<Traversal> {
    if TraversalKernels::visibility(context, Traversal::Auto, false)?.cluster.is_none() {
        return Ok(Traversal::Single);
    }
    let (file, of) = (beside(cache), describe(context.info()));
    let known = std::fs::read_to_string(&file).ok().and_then(|text| serde_json::from_str::<Measured>(&text).ok());
    let measured = match known.filter(|known| known.of == of) {
        Some(known) => known,
        None => {
            let measured = measure(context, of)?;
            if let Err(error) = write(&file, &measured) {
                log::warn!("the choice of kernel is not kept: {error}");
            }
            measured
        }
    };
    log::info!("shadow rays: {:.4} s one by one, {:?} s in clusters", measured.single, measured.cluster);
    Ok(if measured.cluster.is_some_and(|cluster| cluster < measured.single) {
        Traversal::Auto
    } else {
        Traversal::Single
    })
}

/// Whether a device's choice needs a measurement. lavapipe's does not: it takes that driver more than a second to compile what is
/// measured, and clusters have been 7 to 14 times as fast wherever it was measured (docs/benchmarks.md).
pub fn is_open(info: &DeviceInfo) -> bool {
    info.driver != "llvmpipe"
}

fn beside(cache: &Path) -> PathBuf {
    let mut name = cache.as_os_str().to_owned();
    name.push(".traversal.json");
    PathBuf::from(name)
}

fn describe(info: &DeviceInfo) -> String {
    format!("{}, lightsum {}", info.identity(), env!("CARGO_PKG_VERSION"))
}

fn write(file: &Path, measured: &Measured) -> Result<()> {
    let text = serde_json::to_string(measured).map_err(|e| Error::file(file, e.to_string()))?;
    write_cache(file, text.as_bytes())
}

fn measure(context: &Context, of: String) -> Result<Measured> {
    let scene = builtin::room(TRIANGLES);
    let mut staging = Staging::new();
    let device_scene = DeviceScene::new(context, &mut staging, &scene, true)?;
    context.submit_and_wait("uploading a room to measure in", None, |rec| staging.record(rec))?;
    let camera = scene.camera.ok_or_else(|| Error::Scene(String::from("the room has no camera")))?;
    let workload = workload(&device_scene.bvh, &camera);
    let settings = Settings { rounds: 64, ..Settings::default() };
    let run = |traversal: Traversal| -> Result<(f64, Vec<u32>)> {
        let kernels = TraversalKernels::visibility(context, traversal, false)?;
        let mut staging = Staging::new();
        let inputs = Inputs { kernels, scene: &device_scene, settings: &settings, workload: &workload };
        let pass = Visibility::new(context, &mut staging, &inputs)?;
        context.submit_and_wait("uploading rays to measure with", None, |rec| staging.record(rec))?;
        let mut best = f64::INFINITY;
        // The first run compiles.
        for repeat in 0..=REPEATS {
            let start = Instant::now();
            context.submit_and_wait("measuring shadow rays", None, |rec| pass.record(rec))?;
            if repeat > 0 {
                best = best.min(start.elapsed().as_secs_f64());
            }
        }
        Ok((best, download(context, &pass.visible)?))
    };
    let (single, seen_singly) = run(Traversal::Single)?;
    let (cluster, seen_together) = run(Traversal::Auto)?;
    let strays = seen_singly.iter().zip(&seen_together).filter(|(a, b)| a != b).count();
    let agree = strays as f64 <= STRAYS * seen_singly.len() as f64;
    if !agree {
        log::warn!("clusters see something else than single rays on this device; shadow rays are traced one by one");
    }
    Ok(Measured { of, single, cluster: agree.then_some(cluster) })
}

/// The visible points of a small image of the room, tile by tile, and lights below its ceiling.
fn workload(bvh: &Bvh, camera: &Camera) -> Workload {
    let forward = (camera.target - camera.eye).normalize_or(Vec3::Z);
    let right = forward.cross(camera.up).normalize_or(Vec3::X);
    let up = right.cross(forward);
    let half = (0.5 * camera.fov_y.to_radians()).tan();
    let mut workload = Workload::default();
    for tile in 0..(SIDE / 8) * (SIDE / 8) {
        for i in 0..64 {
            let x = 8 * (tile % (SIDE / 8)) + i % 8;
            let y = 8 * (tile / (SIDE / 8)) + i / 8;
            let at = |p: u32| (2.0 * (p as f32 + 0.5) / SIDE as f32 - 1.0) * half;
            let direction = (forward + right * at(x) - up * at(y)).normalize_or(forward);
            let Some(hit) = bvh.closest(&Ray::new(camera.eye, direction)) else { continue };
            let n = bvh.normal(hit.triangle);
            let n = if n.dot(direction) > 0.0 { -n } else { n };
            workload.receivers.push(offset_origin(bvh.position(&hit), n, bvh.typical_scale()));
            workload.normals.push(n);
        }
    }
    let size = bvh.max - bvh.min;
    let place = |i: u32| bvh.min + size * Vec3::new((i as f32 + 0.5) / 8.0, 0.9, ((i * 3) % 8) as f32 / 8.0 + 0.06);
    workload.lights = (0..8).map(place).collect();
    workload
}
