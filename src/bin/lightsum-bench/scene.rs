//! Scenes by name, and the shadow-ray workload of an image of a scene.

use crate::args::Common;
use glam::{Vec3, Vec4};
use lightsum::accel::Bvh;
use lightsum::bsdf::basis;
use lightsum::gpu::{Context, ContextOptions, DeviceChoice, download};
use lightsum::pass::ShadingPoints;
use lightsum::pass::layout::PointLight;
use lightsum::pass::sort;
use lightsum::pass::visibility::Workload;
use lightsum::scene::{self, Camera, Scene, builtin};
use lightsum::settings::{Compensation, Settings};
use lightsum::stage::Stage;
use lightsum::{Engine, Error, Result};
use std::path::Path;

/// Checks the names before anything is measured.
pub fn check(names: &[String]) -> Result<()> {
    for name in names {
        if room(name)?.is_none() && !Path::new(name).exists() {
            let message = "there is no such file; --scene takes a scene description (.toml), a model or room:N";
            return Err(Error::file(Path::new(name), message));
        }
    }
    Ok(())
}

/// Loads a file, or generates `room:N`.
pub fn load(name: &str) -> Result<Scene> {
    match room(name)? {
        Some(count) => Ok(Scene { name: name.into(), ..builtin::room(count) }),
        None => scene::load(Path::new(name)),
    }
}

/// N of `room:N`.
fn room(name: &str) -> Result<Option<u32>> {
    let Some(count) = name.strip_prefix("room:") else { return Ok(None) };
    match count.parse() {
        Ok(count @ 300..=8_000_000) => Ok(Some(count)),
        _ => Err(Error::Setting { name: "--scene", message: format!("{name}: a room has 300 to 8000000 triangles") }),
    }
}

/// Opens the device.
pub fn open(common: &Common) -> Result<Context> {
    open_device(&common.device, common.no_texel_buffers)
}

/// Opens a device, by default the fastest kind.
pub fn open_device(device: &Option<DeviceChoice>, no_texel_buffers: bool) -> Result<Context> {
    let device = device.clone().unwrap_or_default();
    Context::headless(&ContextOptions { device, no_texel_buffers, ..ContextOptions::default() })
}

/// The scene's camera at this resolution, or a default one for a bare model.
pub fn camera(scene: &Scene, resolution: [u32; 2]) -> Camera {
    match scene.camera {
        Some(camera) => Camera { resolution, ..camera },
        None => scene.framed(resolution, Some([0.0, 0.0])),
    }
}

/// The shading points of one pass in cluster order, and `lights` of its lights, evenly chosen; with `area`, a square in
/// front of each of these, whose edge is that fraction of the diagonal.
pub fn workload(context: &Context, engine: &mut Engine, lights: u32, area: Option<f64>) -> Result<Workload> {
    context.submit_and_wait("uploading the scene", None, |rec| engine.record_setup(rec))?;
    engine.setup_finished();
    let parameters = engine.plan().parameters(0)?;
    let frame = engine.frame();
    context.submit_and_wait("the workload", None, |rec| {
        frame.record_start(rec, &parameters)?;
        frame.walk.record(rec)?;
        frame.eye.record(rec)
    })?;
    let of = |buffer| {
        Ok::<_, Error>(download::<Vec4>(context, buffer)?.into_iter().map(Vec4::truncate).collect::<Vec<Vec3>>())
    };
    let (positions, normals) = (of(&frame.eye.points.position)?, of(&frame.eye.points.geometric)?);
    let lit: Vec<bool> = (download::<Vec4>(context, &frame.eye.points.wo)?.into_iter())
        .map(|wo| ShadingPoints::flags(wo.w) & ShadingPoints::LIT != 0)
        .collect();
    // Tile by tile, as in the list before sorting.
    let [width, height] = engine.view().size();
    let mut list: Vec<u32> = (0..width * height).filter(|&p| lit[p as usize]).collect();
    list.sort_by_key(|p| {
        let (x, y) = (p % width, p / width);
        (y / 8, x / 8, y % 8, x % 8)
    });
    let mut list = sort::reference(&parameters, &list, &positions);
    // Only whole packets of 16, so that every tracer gets the same rays.
    list.truncate(list.len() / 16 * 16);
    let mut all = download::<PointLight>(context, frame.lights())?;
    all.retain(|l| l.flags() & PointLight::DIRECTIONAL == 0 && l.emit[..3].iter().any(|&e| e > 0.0));
    let wanted = (lights as usize).min(all.len());
    if wanted == 0 || list.is_empty() {
        return Err(Error::Scene(String::from("no lit surface is seen, or no light has a place; choose another view")));
    }
    let mut workload = Workload {
        receivers: list.iter().map(|&p| positions[p as usize]).collect(),
        normals: list.iter().map(|&p| normals[p as usize]).collect(),
        ..Workload::default()
    };
    for light in (0..wanted).map(|i| &all[i * all.len() / wanted]) {
        let [place, normal] = [light.position, light.normal].map(|v| Vec4::from_array(v).truncate());
        match area {
            None => workload.lights.push(place),
            Some(share) => {
                let (corner, edges) = square(engine.bvh(), place, normal, share);
                workload.lights.push(corner);
                workload.edges.push(edges);
            }
        }
    }
    Ok(workload)
}

/// Corner and edges of a square in front of a light, perpendicular to its normal, moved into the scene's bounding box
/// if it sticks out. Its distance from the light is a hundredth of its edge: in the surface's own plane, rounding would
/// decide which points on that surface face it.
fn square(bvh: &Bvh, place: Vec3, normal: Vec3, share: f64) -> (Vec3, [Vec3; 2]) {
    let normal = normal.try_normalize().unwrap_or(Vec3::Z);
    let (tangent, bitangent) = basis(normal);
    let length = share as f32 * bvh.diagonal();
    let edges = [tangent * length, bitangent * length];
    // A scene may be flatter than the square.
    let half = ((edges[0].abs() + edges[1].abs()) * 0.5).min((bvh.max - bvh.min) * 0.5);
    let centre = (place + normal * (0.01 * length)).max(bvh.min + half).min(bvh.max - half);
    (centre - (edges[0] + edges[1]) * 0.5, edges)
}

/// Settings under which a pass has at least `lights` lights, and the pixels belong to the classes of `pattern`.
pub fn settings(lights: u32, pattern: [u32; 2]) -> Settings {
    let all = Some(lights);
    Settings {
        particles: lights,
        light_pool: 0,
        direct_lights: all,
        compensation: Compensation::Off,
        pattern,
        ..Settings::default()
    }
}
