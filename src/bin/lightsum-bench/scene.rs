//! Scenes by name, and the workload of shadow rays that an image of one asks for.

use crate::args::Common;
use glam::{Vec3, Vec4};
use lightsum::gpu::{Context, ContextOptions, download};
use lightsum::pass::layout::PointLight;
use lightsum::pass::sort;
use lightsum::pass::visibility::Workload;
use lightsum::scene::{self, Camera, Scene, builtin};
use lightsum::settings::Settings;
use lightsum::{Engine, Error, Result};
use std::path::Path;

/// Finds wrong names before anything is measured.
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
    let device = common.device.clone().unwrap_or_default();
    Context::headless(&ContextOptions { device, ..ContextOptions::default() })
}

/// The scene's camera at this resolution, or one made up for a bare model.
pub fn camera(scene: &Scene, resolution: [u32; 2]) -> Camera {
    match scene.camera {
        Some(camera) => Camera { resolution, ..camera },
        None => Camera::in_front_of(scene.bounds(), resolution),
    }
}

/// The receivers of one pass in cluster order, and `lights` of its lights, evenly chosen.
pub fn workload(context: &Context, engine: &mut Engine, lights: u32) -> Result<Workload> {
    context.submit_and_wait("uploading the scene", None, |rec| engine.record_setup(rec))?;
    engine.setup_finished();
    let parameters = engine.parameters().frame(0)?;
    let frame = engine.frame();
    context.submit_and_wait("the workload", None, |rec| {
        frame.record_start(rec, &parameters)?;
        frame.record_walk(rec)?;
        frame.record_eye(rec)
    })?;
    let of = |buffer| {
        Ok::<_, Error>(download::<Vec4>(context, buffer)?.into_iter().map(Vec4::truncate).collect::<Vec<Vec3>>())
    };
    let (positions, normals) = (of(&frame.primary.position)?, of(&frame.primary.geometric)?);
    let lit = download::<Vec4>(context, &frame.primary.wo)?;
    // Tile by tile, as the list is before it is sorted.
    let [width, height] = engine.parameters().camera.resolution;
    let mut list: Vec<u32> = (0..width * height).filter(|&p| lit[p as usize].w > 0.0).collect();
    list.sort_by_key(|p| {
        let (x, y) = (p % width, p / width);
        (y / 8, x / 8, y % 8, x % 8)
    });
    let mut list = sort::reference(&parameters, &list, &positions);
    // Whole packets of 16 only, so that every tracer gets the same rays.
    list.truncate(list.len() / 16 * 16);
    let all: Vec<Vec3> = (download::<PointLight>(context, &frame.lights)?.iter())
        .filter(|l| l.flags() & PointLight::DIRECTIONAL == 0 && l.emit[..3].iter().any(|&e| e > 0.0))
        .map(|l| Vec3::new(l.position[0], l.position[1], l.position[2]))
        .collect();
    let wanted = (lights as usize).min(all.len());
    if wanted == 0 || list.is_empty() {
        return Err(Error::Scene(String::from("no lit surface is seen, or no light has a place; choose another view")));
    }
    Ok(Workload {
        receivers: list.iter().map(|&p| positions[p as usize]).collect(),
        normals: list.iter().map(|&p| normals[p as usize]).collect(),
        lights: (0..wanted).map(|i| all[i * all.len() / wanted]).collect(),
    })
}

/// Settings under which a pass has at least `lights` lights.
pub fn settings(lights: u32) -> Settings {
    Settings { paths: lights, compensation: false, ..Settings::default() }
}
