//! Reads a scene from a file of any kind.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

#[cfg(feature = "gltf")]
use super::gltf;
#[cfg(feature = "mitsuba")]
use super::mitsuba;
#[cfg(feature = "obj")]
use super::obj;
#[cfg(feature = "ply")]
use super::ply;
use super::{Environment, Scene, description};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// Loads and validates a scene description (`.toml`) or a bare model (`.obj`, `.ply`, `.gltf`, `.glb`, Mitsuba's `.xml`).
///
/// A bare model uses its vertex normals where it has them; a description ignores them unless it has
/// `face_normals = false`.
///
/// A file without any light gets the sky of [`Environment::overcast`], as does one whose only light are surfaces with
/// [`Scene::emission_is_relative`].
///
/// Errors: [`Error::Io`] if a file cannot be read; [`Error::File`], with the line if known, if it is invalid.
pub fn load(path: &Path) -> Result<Scene> {
    load_with(path, &ReadOptions::default())
}

/// How a scene is read.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Units of a glTF file's lights: true for candela and lux, which are divided by 683 lm/W, false for W/sr and W/m^2. Default: as a
    /// description says, or else photometric if Blender wrote the file and the strongest light is at least 100.
    pub photometric: Option<bool>,
    /// The scene's files may name files outside of its folder. Default false: only below the folder of the file that is named here, or
    /// below that of the model that a description names.
    pub allow_outside: bool,
    /// Bytes of memory that the files may take, as they are and decoded. Default: half of the machine's memory.
    pub max_memory: Option<u64>,
}

/// [`load`] with options.
pub fn load_with(path: &Path, options: &ReadOptions) -> Result<Scene> {
    let mut inputs = match options.allow_outside {
        true => Inputs::within(options.max_memory),
        false => Inputs::of(path, options.max_memory),
    };
    let mut scene = match extension(path).as_str() {
        "toml" => description::load(path, options.photometric, &mut inputs)?,
        _ => load_model(path, options.photometric, &inputs)?,
    };
    scene.light_by_default();
    scene.validate(path)?;
    scene.files = inputs.into_files();
    Ok(scene)
}

/// Reads a model without validating it: a description may still add lights and change materials.
pub(super) fn load_model(path: &Path, photometric: Option<bool>, inputs: &Inputs) -> Result<Scene> {
    let mut scene = read_model(path, photometric, inputs)?;
    scene.name = stem(path);
    Ok(scene)
}

/// Kinds of files that this library was built without a reader for, each with the feature that has it.
const UNREAD: &[[&str; 2]] = &[
    #[cfg(not(feature = "obj"))]
    ["obj", "obj"],
    #[cfg(not(feature = "ply"))]
    ["ply", "ply"],
    #[cfg(not(feature = "mitsuba"))]
    ["xml", "mitsuba"],
    #[cfg(not(feature = "gltf"))]
    ["gltf", "gltf"],
    #[cfg(not(feature = "gltf"))]
    ["glb", "gltf"],
];

#[cfg_attr(not(feature = "formats"), allow(unused_variables, reason = "what only some readers need"))]
fn read_model(path: &Path, photometric: Option<bool>, inputs: &Inputs) -> Result<Scene> {
    match extension(path).as_str() {
        #[cfg(feature = "obj")]
        "obj" => {
            let mut scene = obj::load(path, inputs)?;
            scene.find_panes();
            Ok(scene)
        }
        #[cfg(feature = "ply")]
        "ply" => ply::load(path, inputs),
        #[cfg(feature = "mitsuba")]
        "xml" => mitsuba::load(path, inputs),
        #[cfg(feature = "gltf")]
        "gltf" | "glb" => gltf::load(path, photometric, inputs),
        kind => Err(Error::file(
            path,
            match UNREAD.iter().find(|[unread, _]| *unread == kind) {
                Some([_, feature]) => {
                    format!("this program was built without the feature {feature}, which reads such files")
                }
                None => format!("cannot read scenes of the kind {kind:?}; use .toml, .obj, .ply, .gltf, .glb or .xml"),
            },
        )),
    }
}

pub(super) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

pub(super) fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

impl Scene {
    /// Gives a scene without any light, or with surfaces that glow for a screen only, an overcast sky.
    fn light_by_default(&mut self) {
        let glows = !self.emitters().is_empty();
        if self.emitters_are_lights
            && self.lights.is_empty()
            && self.environment.is_none()
            && (self.emission_is_relative || !glows)
        {
            let lit_by = if glows { "only emission of up to the white of a screen" } else { "no light" };
            let up = self.camera.map_or(Vec3::Y, |camera| camera.up);
            let up = if up.z.abs() > up.y.abs().max(up.x.abs()) { Vec3::Z * up.z.signum() } else { Vec3::Y };
            log::warn!(
                "{} has {lit_by}; an overcast sky lights it ([environment] in a scene.toml sets another)",
                self.name
            );
            self.environment = Some(Arc::new(Environment::overcast().turned(up, 0.0)));
        }
    }
}
