//! The camera: the scene's, or a default one for a bare model, overridden by the flags.

use crate::args;
use lightsum::scene::{Camera, Scene};
use lightsum::{Error, Result};

/// The camera to render with; the flags are in world coordinates.
pub fn choose(scene: &Scene, flags: &args::Camera, resolution: Option<[u32; 2]>) -> Result<Camera> {
    let of_scene = match &flags.camera {
        Some(name) => Some(by_name(scene, name)?),
        None => scene.camera,
    };
    let size = resolution.unwrap_or(of_scene.map_or([640, 480], |camera| camera.resolution));
    let mut camera = match (of_scene, flags.orbit) {
        (_, Some(orbit)) => scene.framed(size, Some(orbit)),
        (Some(camera), None) => camera,
        (None, None) => {
            if flags.eye.is_none() || flags.target.is_none() {
                log::warn!(
                    "{} has no camera: it is framed from the front and above; set --orbit, or --eye, --target and --fov",
                    scene.name
                );
            }
            scene.framed(size, None)
        }
    };
    camera.eye = flags.eye.map_or(camera.eye, |p| scene.from_world(p));
    camera.target = flags.target.map_or(camera.target, |p| scene.from_world(p));
    camera.up = flags.up.unwrap_or(camera.up);
    camera.fov_y = flags.fov.unwrap_or(camera.fov_y);
    camera.height = if flags.fov.is_some() { None } else { flags.ortho.or(camera.height) };
    camera.aperture = flags.aperture.unwrap_or(camera.aperture);
    camera.focus = flags.focus.or(camera.focus);
    camera.shutter = flags.shutter.unwrap_or(camera.shutter);
    camera.resolution = resolution.unwrap_or(camera.resolution);
    args::check_resolution(camera.resolution).map_err(|message| Error::Setting { name: "--resolution", message })?;
    camera.check().map_err(|message| Error::Setting {
        name: "--eye, --target, --up, --fov, --ortho, --aperture, --focus, --shutter",
        message,
    })?;
    Ok(camera)
}

/// The camera `still`, moved to where the file's own camera is now, unless flags hold it.
pub fn follow(own: Option<Camera>, still: Camera, flags: &args::Camera) -> Camera {
    let held = flags.orbit.is_some() || flags.eye.is_some() || flags.target.is_some() || flags.up.is_some();
    match own {
        Some(own) if !held => Camera { eye: own.eye, target: own.target, up: own.up, ..still },
        _ => still,
    }
}

/// The camera of a scene, or that of a name.
pub fn named(scene: &Scene, name: Option<&str>) -> Option<Camera> {
    match name {
        Some(name) => scene.cameras.iter().find(|named| named.name == name).map(|named| named.camera),
        None => scene.camera,
    }
}

/// A camera of the scene's file.
fn by_name(scene: &Scene, name: &str) -> Result<Camera> {
    let found = scene.cameras.iter().find(|named| named.name == name);
    found.map(|named| named.camera).ok_or_else(|| {
        let names: Vec<String> = scene.cameras.iter().map(|named| format!("{:?}", named.name)).collect();
        let there = if names.is_empty() { String::from("none") } else { names.join(", ") };
        Error::Setting { name: "--camera", message: format!("the model has no camera {name:?}; it has {there}") }
    })
}
