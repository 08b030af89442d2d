//! The scene description `scene.toml`.
//!
//! ```toml
//! model = "room.obj"            # OBJ, PLY, glTF, GLB or XML of Mitsuba, relative to this file
//! face_normals = true           # ignore the model's vertex normals (default)
//! two_sided = false             # every emissive face emits from both sides
//! photometric = true            # glTF lights are in candela and lux: divide by 683 lm/W. Default: as the file looks
//!
//! [camera]                      # replaces the model's own
//! eye = [0, 1, 3]
//! target = [0, 1, 0]
//! up = [0, 1, 0]
//! fov_y = 45                    # full vertical angle, degrees
//! resolution = [640, 480]
//! aperture = 0                  # diameter of the lens, scene units; 0 is a pinhole
//! focus = 3                     # focus distance along the view, scene units; default: that of the target
//!
//! [lights.lamp]                 # type: point, spot, directional, sphere or quad
//! type = "spot"
//! position = [0, 2, 0]
//! direction = [0, -1, 0]
//! intensity = [10, 10, 10]      # W/sr
//! inner = 20                    # degrees
//! outer = 30
//!
//! [environment]                 # light from all around
//! image = "sky.exr"             # OpenEXR or Radiance, all directions: azimuth across, height down; default: a constant
//! sun = [30, 45]                # or a clear sky: azimuth of the sun from +z towards +x and its elevation, degrees
//! turbidity = 3                 # haze of that sky, 1 to 10
//! radiance = [1, 1, 1]          # W/(m^2 sr), or of an image or a sky the factor
//! up = [0, 1, 0]                # the zenith
//! rotation = 0                  # degrees about the zenith, counter-clockwise seen from there
//!
//! [materials.floor]             # overrides a material of the model
//! roughness = 0.3
//! lobe = "lobe.toml"            # measured lobe in place of GGX: a table, see docs/lobes.md; `roughness`, `phong_exponent` and `anisotropy` have no effect
//! reflector = true              # whether its flat faces mirror the room, and if true its smooth curved ones; default: see docs/superposition.md
//!
//! [materials.plastic]
//! specular = [0.05, 0.05, 0.05]
//! phong_exponent = 40           # its lobe is cos^40 about the mirror direction in place of GGX, 1 to 10000
//!
//! [materials.steel]             # brushed metal
//! roughness = 0.3
//! anisotropy = 0.8              # 0 to 1: alpha = roughness^2 across the grain, mix(alpha, 1, 0.8^2) along it
//! anisotropy_rotation = 0.5     # radians, -2 pi to 2 pi, from the direction of growing u to that of the grain
//!
//! [materials.spotlight]
//! emission = [90, 80, 70]       # radiance along the normal, W/(m^2 sr)
//! emission_exponent = 20        # intensity by cos^20 of the angle from the normal, 1 to 1000; also of lights of type quad
//!
//! [materials.window]
//! surface = "glass"             # opaque, mirror or glass
//! thin = true                   # a thin sheet without refraction
//! ior = 1.52
//! roughness = 0.3               # of a thin sheet: frosted glass; default: clear, whatever the model specifies
//!
//! [render]                      # settings by the names of their flags, with underscores: see `settings::keys`
//! passes = 64
//! ```

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde::Deserialize;
use toml::Spanned;

use super::tessellate::icosphere;
use super::{Camera, Environment, Light, Material, RenderDefaults, Scene, Surface, load_model};
use crate::error::{Error, Result};
use crate::input::Inputs;
use crate::settings::keys::{Table as Keys, nearest};
use crate::superposition::lobe::Table;

/// Subdivisions of the icosahedron that represents a sphere light: 1280 triangles.
const SPHERE_SUBDIVISIONS: u32 = 3;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    model: Option<Spanned<PathBuf>>,
    camera: Option<Spanned<CameraEntry>>,
    #[serde(default = "yes")]
    face_normals: bool,
    #[serde(default)]
    two_sided: bool,
    photometric: Option<bool>,
    #[serde(default)]
    lights: BTreeMap<Spanned<String>, LightEntry>,
    environment: Option<Spanned<EnvironmentEntry>>,
    #[serde(default)]
    materials: BTreeMap<Spanned<String>, MaterialEntry>,
    #[serde(default)]
    render: Keys,
}

fn yes() -> bool {
    true
}

/// [`Camera`] in world coordinates, which may need double precision.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    eye: DVec3,
    target: DVec3,
    #[serde(default = "Camera::default_up")]
    up: Vec3,
    #[serde(default)]
    projection: Projection,
    fov_y: Option<f32>,
    height: Option<f32>,
    #[serde(default = "Camera::default_resolution")]
    resolution: [u32; 2],
    #[serde(default)]
    aperture: f32,
    #[serde(default)]
    focus: Option<f32>,
    #[serde(default)]
    shutter: f32,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Projection {
    #[default]
    Perspective,
    Orthographic,
}

impl CameraEntry {
    /// The message does not name the file.
    fn of(&self, scene: &Scene) -> std::result::Result<Camera, String> {
        let CameraEntry { eye, target, up, projection, fov_y, height, resolution, aperture, focus, shutter } = *self;
        let [eye, target] = [eye, target].map(|p| scene.from_world(p));
        let fov_y = match (projection, fov_y, height) {
            (Projection::Perspective, Some(fov_y), None) => fov_y,
            (Projection::Perspective, None, None) => {
                return Err(String::from("no `fov_y`, the vertical angle of view in degrees"));
            }
            (Projection::Perspective, _, Some(_)) => {
                return Err(String::from(
                    "`height` is of an orthographic camera; add `projection = \"orthographic\"`, or leave it out",
                ));
            }
            (Projection::Orthographic, None, Some(_)) => Camera::default_fov(),
            (Projection::Orthographic, _, None) => {
                return Err(String::from("no `height`, that of the image of an orthographic camera in scene units"));
            }
            (Projection::Orthographic, Some(_), _) => {
                return Err(String::from("`fov_y` has no meaning for an orthographic camera; leave it out"));
            }
        };
        let camera = Camera { eye, target, up, fov_y, resolution, aperture, focus, shutter, height, frustum: None };
        camera.check().map(|()| camera)
    }
}

/// A light; positions are in world coordinates, which may need double precision.
#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum LightEntry {
    Point {
        position: DVec3,
        intensity: Vec3,
    },
    Spot {
        position: DVec3,
        direction: Vec3,
        intensity: Vec3,
        #[serde(default)]
        inner: f32,
        outer: f32,
    },
    Directional {
        direction: Vec3,
        irradiance: Vec3,
    },
    Sphere {
        center: DVec3,
        radius: f32,
        radiance: Vec3,
        #[serde(default)]
        inward: bool,
    },
    Quad {
        corner: DVec3,
        edge_u: Vec3,
        edge_v: Vec3,
        radiance: Vec3,
        emission_exponent: Option<f32>,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvironmentEntry {
    image: Option<PathBuf>,
    sun: Option<[f32; 2]>,
    turbidity: Option<f32>,
    radiance: Option<Vec3>,
    #[serde(default = "Camera::default_up")]
    up: Vec3,
    #[serde(default)]
    rotation: f32,
}

impl EnvironmentEntry {
    /// Reads the image, relative to `folder`; the error is a message.
    fn load(&self, inputs: &Inputs, folder: &Path) -> Result<std::result::Result<Environment, String>> {
        if self.image.is_none() && self.radiance.is_none() && self.sun.is_none() {
            return Ok(Err(String::from("neither `image` nor `sun` nor `radiance`")));
        }
        if self.image.is_some() && self.sun.is_some() || self.sun.is_none() && self.turbidity.is_some() {
            return Ok(Err(String::from("`sun` excludes `image`, and `turbidity` needs `sun`")));
        }
        let radiance = self.radiance.unwrap_or(Vec3::ONE);
        if !(radiance.is_finite() && radiance.min_element() >= 0.0) {
            return Ok(Err(format!("radiance {radiance} must be finite and not negative")));
        }
        if !(self.up.is_finite() && self.up.length() > 0.0 && self.rotation.is_finite()) {
            return Ok(Err(String::from("`up` must be a direction and `rotation` an angle in degrees")));
        }
        let whole = match (&self.image, self.sun) {
            (Some(image), _) => Environment::load_from(inputs, &folder.join(image))?.scaled(radiance),
            (None, Some([azimuth, elevation])) => {
                match Environment::sun_and_sky(azimuth, elevation, self.turbidity.unwrap_or(3.0)) {
                    Ok(sky) => sky.scaled(radiance),
                    Err(message) => return Ok(Err(message)),
                }
            }
            (None, None) => Environment::constant(radiance),
        };
        Ok(Ok(whole.turned(self.up, self.rotation.to_radians())))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialEntry {
    surface: Option<Surface>,
    base_color: Option<Vec3>,
    metallic: Option<f32>,
    roughness: Option<f32>,
    phong_exponent: Option<f32>,
    anisotropy: Option<f32>,
    anisotropy_rotation: Option<f32>,
    specular: Option<Vec3>,
    opacity: Option<f32>,
    alpha_cutoff: Option<f32>,
    emission: Option<Vec3>,
    emission_exponent: Option<f32>,
    two_sided: Option<bool>,
    ior: Option<f32>,
    thin: Option<bool>,
    reflector: Option<bool>,
    lobe: Option<PathBuf>,
}

/// Reads a description and the model that it names; the result is not validated yet.
pub(super) fn load(path: &Path, photometric: Option<bool>, inputs: &mut Inputs) -> Result<Scene> {
    let text = inputs.read_text(path)?;
    let error = |span: Option<Range<usize>>, message: String| match span {
        Some(span) => Error::at(path, line_of(&text, span.start), message),
        None => Error::file(path, message),
    };
    let description: Description =
        toml::from_str(&text).map_err(|e| error(e.span(), e.message().trim_end().to_string()))?;
    let Some(model) = description.model else {
        return Err(Error::file(path, "no `model`; name an OBJ, PLY, glTF, GLB or XML file, relative to this file"));
    };
    let model_path = path.parent().unwrap_or(Path::new("")).join(model.get_ref());
    if !crate::input::is_file(&model_path) {
        let message = format!("model {} does not exist", model_path.display());
        return Err(error(Some(model.span()), message));
    }
    inputs.allow_beside(&model_path);
    let mut scene = load_model(&model_path, photometric.or(description.photometric), inputs)?;
    scene.name = name_of(path);
    scene.render = RenderDefaults::of_table(&description.render)
        .map_err(|(span, message)| error(Some(span), format!("[render]: {message}")))?;
    if description.face_normals {
        scene.triangles.iter_mut().for_each(|t| t.smooth = false);
    }
    if let Some(camera) = description.camera {
        let entry = camera.get_ref().of(&scene);
        let entry = entry.map_err(|m| error(Some(camera.span()), format!("[camera]: {m}")))?;
        scene.camera = Some(entry);
    }
    for (name, entry) in &description.materials {
        let lobe = match &entry.lobe {
            Some(file) => Some(Arc::new(Table::load_from(inputs, &path.parent().unwrap_or(Path::new("")).join(file))?)),
            None => None,
        };
        change_material(&mut scene, name.get_ref(), entry, lobe)
            .map_err(|m| error(Some(name.span()), format!("[materials.{name}]: {m}")))?;
    }
    if description.two_sided {
        scene.materials.iter_mut().for_each(|m| m.two_sided = true);
    }
    if let Some(entry) = &description.environment {
        let environment = entry.get_ref().load(inputs, path.parent().unwrap_or(Path::new("")))?;
        let environment = environment.map_err(|m| error(Some(entry.span()), format!("[environment]: {m}")))?;
        scene.environment = Some(Arc::new(environment));
    }
    for (name, entry) in &description.lights {
        add_light(&mut scene, name.get_ref(), entry)
            .map_err(|m| error(Some(name.span()), format!("[lights.{name}]: {m}")))?;
    }
    Ok(scene)
}

/// A description called `scene.toml` takes the name of its folder.
fn name_of(path: &Path) -> String {
    let stem = super::stem(path);
    let folder = path.parent().and_then(Path::file_name).map(|f| f.to_string_lossy().into_owned());
    if stem == "scene" { folder.unwrap_or(stem) } else { stem }
}

fn line_of(text: &str, offset: usize) -> usize {
    text.bytes().take(offset).filter(|&b| b == b'\n').count() + 1
}

fn change_material(
    scene: &mut Scene,
    name: &str,
    entry: &MaterialEntry,
    lobe: Option<Arc<Table>>,
) -> Result<(), String> {
    if !scene.materials.iter().any(|m| m.name == name) {
        let known = nearest(name, scene.materials.iter().map(|m| m.name.as_str()));
        return Err(format!("the model has no material of this name; the nearest are {known}"));
    }
    for m in scene.materials.iter_mut().filter(|m| m.name == name) {
        m.surface = entry.surface.unwrap_or(m.surface);
        m.base_color = entry.base_color.unwrap_or(m.base_color);
        m.metallic = entry.metallic.unwrap_or(m.metallic);
        m.roughness = entry.roughness.unwrap_or(m.roughness);
        m.phong_exponent = entry.phong_exponent.or(m.phong_exponent);
        m.anisotropy = entry.anisotropy.unwrap_or(m.anisotropy);
        m.anisotropy_rotation = entry.anisotropy_rotation.unwrap_or(m.anisotropy_rotation);
        m.specular = entry.specular.unwrap_or(m.specular);
        m.alpha = m.alpha.with(entry.opacity, entry.alpha_cutoff);
        m.emission = entry.emission.unwrap_or(m.emission);
        scene.emission_is_relative &= entry.emission.is_none();
        m.emission_exponent = entry.emission_exponent.unwrap_or(m.emission_exponent);
        m.two_sided = entry.two_sided.unwrap_or(m.two_sided);
        m.ior = entry.ior.unwrap_or(m.ior);
        m.thin = entry.thin.unwrap_or(m.thin);
        if m.surface == Surface::Glass && m.thin {
            m.frost = entry.roughness.unwrap_or(m.frost);
        }
        m.reflector = entry.reflector.or(m.reflector);
        m.lobe = lobe.clone().or(m.lobe.take());
        if entry.surface == Some(Surface::Mirror) && m.specular == Vec3::ZERO && entry.metallic.is_none() {
            // No specular reflectance is given: it mirrors its whole base colour.
            m.metallic = 1.0;
        }
        m.check()?;
        m.alpha = m.alpha.unless_opaque(m.base_texture.map(|texture| &scene.textures[texture as usize]));
        if m.surface != Surface::Glass && m.limit_albedo() > 1e-3 {
            log::warn!("material {name:?} reflects more than it receives; lowered its base colour to {}", m.base_color);
        }
    }
    Ok(())
}

fn add_light(scene: &mut Scene, name: &str, entry: &LightEntry) -> Result<(), String> {
    let unit = |direction: Vec3| direction.try_normalize().ok_or(format!("direction {direction} has no length"));
    let emitter = |radiance: Vec3| Material {
        name: format!("light {name}"),
        base_color: Vec3::ZERO,
        emission: radiance,
        ..Material::default()
    };
    let light = match *entry {
        LightEntry::Point { position, intensity } => Light::Point { position: scene.from_world(position), intensity },
        LightEntry::Spot { position, direction, intensity, inner, outer } => Light::Spot {
            position: scene.from_world(position),
            direction: unit(direction)?,
            intensity,
            inner: inner.to_radians(),
            outer: outer.to_radians(),
        },
        LightEntry::Directional { direction, irradiance } => {
            Light::Directional { direction: unit(direction)?, irradiance }
        }
        LightEntry::Sphere { center, radius, radiance, inward } => {
            let center = scene.from_world(center);
            let object = scene.add_object(name);
            let light = Light::Sphere { center, radius, radiance, inward, object };
            light.check()?;
            let (points, mut faces) = icosphere(SPHERE_SUBDIVISIONS);
            let points: Vec<Vec3> = points.iter().map(|p| center + radius * *p).collect();
            if inward {
                faces.iter_mut().for_each(|f| f.swap(1, 2));
            }
            let material = scene.add_material(emitter(radiance));
            scene.add_mesh(&points, &faces, material, object);
            light
        }
        LightEntry::Quad { corner, edge_u, edge_v, radiance, emission_exponent } => {
            let corner = scene.from_world(corner);
            let area = edge_u.cross(edge_v).length();
            if !(corner.is_finite() && area.is_normal()) {
                return Err(String::from("corner and edges must be finite and span an area"));
            }
            let material = Material { emission_exponent: emission_exponent.unwrap_or(1.0), ..emitter(radiance) };
            material.check()?;
            let object = scene.add_object(name);
            let material = scene.add_material(material);
            scene.add_quad(corner, edge_u, edge_v, material, object);
            return Ok(());
        }
    };
    light.check()?;
    scene.lights.push(light);
    Ok(())
}
