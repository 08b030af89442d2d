//! Validation of scenes.

use std::f32::consts::{FRAC_PI_2, TAU};
use std::path::Path;

use glam::Vec3;

use super::{Camera, Light, Material, NamedCamera, Scene, Texture, TextureUse};
use crate::bsdf::phong::EXPONENTS;
use crate::bsdf::table::MAX_MATERIALS;
use crate::error::{Error, Result};
use crate::light::cosine::MAX_EXPONENT;

/// A triangle is degenerate if its height is below this fraction of its longest edge: its normal is then noise.
const THINNEST: f64 = 1e-9;

/// Greatest coordinate of vertices, lights and cameras, and greatest length, in scene units from [`Scene::origin`]: areas squared, and products
/// of three lengths, are numbers of single precision then.
pub const FARTHEST: f32 = 1e9;

/// Least height of the image of an orthographic camera: squares of lengths in it are numbers.
const LOWEST_IMAGE: f32 = 1e-15;

/// Least length of an edge of a triangle that is sure to be kept: the square of its area is a number of single precision still.
pub const SHORTEST: f32 = 1e-9;

impl Scene {
    /// Checks all invariants of a scene: parallel arrays, indices in range, finite numbers, materials,
    /// lights and camera in range, at least one triangle and at least one light. Messages name `path`.
    ///
    /// Triangles without area are dropped with a warning. Errors: [`Error::File`] if an invariant is broken, or if a
    /// triangle without area should emit light of one radiance.
    pub fn validate(&mut self, path: &Path) -> Result<()> {
        self.check_arrays(path)?;
        for material in &self.materials {
            material.check().map_err(|m| Error::file(path, format!("material {:?}: {m}", material.name)))?;
        }
        self.check_tables().map_err(|m| Error::file(path, m))?;
        for texture in &self.textures {
            texture.check().map_err(|m| Error::file(path, m))?;
        }
        self.drop_degenerate(path)?;
        if let Some(kept) = &self.kept_light {
            kept.check(self).map_err(|m| Error::file(path, format!("kept light: {m}")))?;
        }
        for (i, light) in self.lights.iter().enumerate() {
            light.check().map_err(|m| Error::file(path, format!("light {i}: {m}")))?;
        }
        if let Some(camera) = &self.camera {
            camera.check().map_err(|m| Error::file(path, format!("camera: {m}")))?;
        }
        for NamedCamera { name, camera } in &self.cameras {
            camera.check().map_err(|m| Error::file(path, format!("camera {name:?}: {m}")))?;
        }
        if let Some(radiance) = self.environment.as_ref().and_then(|e| e.texels.iter().find(|t| !is_power(**t))) {
            let message = format!("environment: its radiance {radiance} must be finite and not negative");
            return Err(Error::file(path, message));
        }
        let sky = self.environment.as_ref().is_some_and(|e| e.is_bright());
        if self.lights.is_empty() && self.emitters().is_empty() && !sky {
            let message = "nothing emits light; give a material an emission (MTL `Ke`, glTF `emissiveFactor`, or \
                           `[materials.NAME] emission = [1, 1, 1]` in a scene.toml) or add a light (`[lights.NAME]`)";
            return Err(Error::file(path, message));
        }
        Ok(())
    }

    /// The message names the material whose lobe has a table that no number stands for.
    pub(crate) fn check_tables(&self) -> std::result::Result<(), String> {
        match self.materials.iter().skip(MAX_MATERIALS).find(|m| m.lobe.is_some()) {
            Some(m) => Err(format!(
                "material {:?}: only the first {MAX_MATERIALS} materials may have a lobe from a file; put it before others",
                m.name
            )),
            None => Ok(()),
        }
    }

    fn check_arrays(&self, path: &Path) -> Result<()> {
        let count = self.positions.len();
        if self.normals.len() != count || self.uvs.len() != count {
            let message = format!(
                "{count} positions, {} normals and {} texture coordinates should be of one number",
                self.normals.len(),
                self.uvs.len()
            );
            return Err(Error::file(path, message));
        }
        if !self.lightmap_uvs.is_empty() && self.lightmap_uvs.len() != count {
            let given = self.lightmap_uvs.len();
            return Err(Error::file(path, format!("{given} places on light maps for {count} vertices")));
        }
        if !self.second_uvs.is_empty() && self.second_uvs.len() != count {
            let given = self.second_uvs.len();
            let message = format!("{count} positions and {given} second texture coordinates should be of one number");
            return Err(Error::file(path, message));
        }
        if let Some(v) = self.second_uvs.iter().position(|uv| !uv.is_finite()) {
            let message = format!("second texture coordinate {} of vertex {v} is not finite", self.second_uvs[v]);
            return Err(Error::file(path, message));
        }
        if !self.colors.is_empty() && self.colors.len() != count {
            let message = format!("{count} positions and {} vertex colours should be of one number", self.colors.len());
            return Err(Error::file(path, message));
        }
        if let Some(v) = self.colors.iter().position(|c| !(c.min_element() >= 0.0 && c.max_element() <= 1.0)) {
            let message = format!("the colour of vertex {v}, {}, must be in [0, 1]", self.colors[v]);
            return Err(Error::file(path, message));
        }
        if u32::try_from(count).is_err() || u32::try_from(self.triangles.len()).is_err() {
            return Err(Error::file(path, "more than 2^32 vertices or triangles; split the scene"));
        }
        if self.triangles.is_empty() {
            return Err(Error::file(path, "no triangles; the model has no faces"));
        }
        for (i, t) in self.triangles.iter().enumerate() {
            let Some(object) = self.objects.get(t.object as usize) else {
                return Err(Error::file(path, format!("triangle {i}: object {} does not exist", t.object)));
            };
            let error = |what: String| Error::file(path, format!("object {object:?}, triangle {i}: {what}"));
            if t.material as usize >= self.materials.len() {
                return Err(error(format!("material {} does not exist", t.material)));
            }
            for v in t.vertices.map(|v| v as usize) {
                if v >= count {
                    return Err(error(format!("vertex {v} does not exist, there are {count}")));
                }
                place(&format!("vertex {v} at"), self.positions[v]).map_err(error)?;
                if !self.uvs[v].is_finite() {
                    return Err(error(format!("texture coordinate {} of vertex {v} is not finite", self.uvs[v])));
                }
                if t.smooth && !self.normals[v].is_normalized() {
                    return Err(error(format!("normal {} of vertex {v} is not of unit length", self.normals[v])));
                }
            }
        }
        for m in &self.materials {
            self.check_textures(m).map_err(|message| Error::file(path, format!("material {:?}: {message}", m.name)))?;
        }
        for light in &self.lights {
            if let Light::Sphere { object, .. } = light
                && *object as usize >= self.objects.len()
            {
                return Err(Error::file(path, format!("sphere light: object {object} does not exist")));
            }
            if let Light::Sphere { object, .. } = light {
                let mut triangles = self.triangles.iter().filter(|t| t.object == *object);
                let wrong = triangles.find_map(|t| {
                    let m = &self.materials[t.material as usize];
                    let wrong = if m.emission_texture.is_some() {
                        Some("emission texture")
                    } else {
                        (m.emission_exponent != 1.0).then_some("emission_exponent")
                    };
                    wrong.map(|what| (what, &m.name))
                });
                if let Some((what, name)) = wrong {
                    let object = &self.objects[*object as usize];
                    let message = format!(
                        "object {object:?}: material {name:?} of a sphere light has an {what}; remove that, or the light"
                    );
                    return Err(Error::file(path, message));
                }
            }
        }
        Ok(())
    }

    /// Checks the textures of a material.
    pub(crate) fn check_textures(&self, material: &Material) -> std::result::Result<(), String> {
        if let Some(texture) = material.textures().find(|&t| t as usize >= self.textures.len()) {
            return Err(format!("texture {texture} does not exist"));
        }
        if material.second_uvs[TextureUse::Base as usize] {
            return Err(String::from("its base texture must take the first texture coordinates"));
        }
        if material.second_uvs.contains(&true) && self.second_uvs.is_empty() {
            return Err(String::from("the scene has no second texture coordinates"));
        }
        Ok(())
    }

    fn drop_degenerate(&mut self, path: &Path) -> Result<()> {
        let keep: Vec<bool> = (0..self.triangles.len()).map(|i| !is_degenerate(self.triangle_positions(i))).collect();
        let Some(first) = keep.iter().position(|k| !k) else { return Ok(()) };
        let object = |i: usize| &self.objects[self.triangles[i].object as usize];
        let dropped = keep.iter().filter(|k| !**k).count();
        if dropped == keep.len() {
            let message = format!(
                "object {:?}: no triangle of the scene has an area that single precision holds; give edges of {SHORTEST:e} or more, \
                 in another unit of length",
                object(first)
            );
            return Err(Error::file(path, message));
        }
        for (i, t) in self.triangles.iter().enumerate() {
            let material = &self.materials[t.material as usize];
            if !keep[i] && material.emission.max_element() > 0.0 && material.emission_texture.is_none() {
                let message = format!(
                    "object {:?}, triangle {i}: a light of zero area cannot emit; remove it, or the emission of \
                     material {:?}",
                    object(i),
                    material.name
                );
                return Err(Error::file(path, message));
            }
        }
        log::warn!(
            "{}: dropped {dropped} triangles of zero area, the first in object {:?}",
            path.display(),
            object(first)
        );
        let mut kept = keep.iter();
        self.triangles.retain(|_| kept.next().copied().unwrap_or(true));
        Ok(())
    }
}

/// Whether a triangle has no area, no normal that single precision can hold, or overflows it.
pub(crate) fn is_degenerate([a, b, c]: [Vec3; 3]) -> bool {
    let twice_area = (b - a).cross(c - a).length();
    let (da, db, dc) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    let longest = (db - da).length_squared().max((dc - db).length_squared()).max((da - dc).length_squared());
    let exact = (db - da).cross(dc - da).length();
    !(twice_area.is_normal() && exact > THINNEST * longest)
}

/// `Ok` if the number lies in [low, high]; NaN does not.
fn range(name: &str, value: f32, low: f32, high: f32) -> Result<(), String> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(format!("{name} {value} is not in [{low}, {high}]")) }
}

fn color(name: &str, value: Vec3) -> Result<(), String> {
    value.to_array().iter().try_for_each(|&channel| range(name, channel, 0.0, 1.0))
}

/// Finite and not negative.
fn is_power(value: Vec3) -> bool {
    value.is_finite() && value.min_element() >= 0.0
}

/// A radiometric quantity: finite, not negative, and for lights not zero.
fn power(name: &str, value: Vec3, zero_allowed: bool) -> Result<(), String> {
    if !is_power(value) {
        return Err(format!("{name} {value} must be finite and not negative"));
    }
    if !zero_allowed && value.max_element() == 0.0 {
        return Err(format!("{name} is zero; remove the light or raise it"));
    }
    Ok(())
}

/// A point, near enough to the scene's origin for single precision.
pub(crate) fn place(name: &str, value: Vec3) -> Result<(), String> {
    if !value.is_finite() {
        return Err(format!("{name} {value} is not finite"));
    }
    if value.abs().max_element() <= FARTHEST {
        return Ok(());
    }
    Err(format!("{name} {value} is farther than {FARTHEST:e} from the scene's origin; take a larger unit of length"))
}

/// A length; `zero_allowed`: 0 is one.
fn length(name: &str, value: f32, zero_allowed: bool) -> Result<(), String> {
    if (value > 0.0 || zero_allowed && value == 0.0) && value <= FARTHEST {
        return Ok(());
    }
    let least = if zero_allowed { "0 or more" } else { "above 0" };
    Err(format!("{name} {value} must be {least}, and at most {FARTHEST:e}"))
}

fn unit(name: &str, value: Vec3) -> Result<(), String> {
    if value.is_normalized() { Ok(()) } else { Err(format!("{name} {value} is not of unit length")) }
}

impl Texture {
    /// Checks its size; the message names it.
    pub(super) fn check(&self) -> Result<(), String> {
        if self.width == 0 || self.texels.len() as u64 != u64::from(self.width) * u64::from(self.height) {
            return Err(format!("texture {:?}: its size does not match its texels", self.name));
        }
        Ok(())
    }
}

impl Material {
    /// Checks every range; the message does not name file and object.
    pub(crate) fn check(&self) -> Result<(), String> {
        color("base_color", self.base_color)?;
        color("specular", self.specular)?;
        range("metallic", self.metallic, 0.0, 1.0)?;
        range("roughness", self.roughness, 0.0, 1.0)?;
        if let Some(exponent) = self.phong_exponent {
            range("phong_exponent", exponent, *EXPONENTS.start(), *EXPONENTS.end())?;
        }
        range("anisotropy", self.anisotropy, 0.0, 1.0)?;
        range("anisotropy_rotation", self.anisotropy_rotation, -TAU, TAU)?;
        range("frost", self.frost, 0.0, 1.0)?;
        power("emission", self.emission, true)?;
        range("emission_exponent", self.emission_exponent, 1.0, MAX_EXPONENT)?;
        self.alpha.check()?;
        // The range of Ni in MTL.
        range("ior", self.ior, 0.001, 10.0)
    }
}

impl Light {
    /// Checks every range; the message does not name file and object.
    pub(crate) fn check(&self) -> Result<(), String> {
        match *self {
            Light::Point { position, intensity } => {
                place("position", position)?;
                power("intensity", intensity, false)
            }
            Light::Spot { position, direction, intensity, inner, outer } => {
                place("position", position)?;
                unit("direction", direction)?;
                power("intensity", intensity, false)?;
                if inner >= 0.0 && inner < outer && outer <= FRAC_PI_2 {
                    return Ok(());
                }
                let (inner, outer) = (inner.to_degrees(), outer.to_degrees());
                Err(format!("cone angles need 0 <= inner ({inner}) < outer ({outer}) <= 90 degrees"))
            }
            Light::Directional { direction, irradiance } => {
                unit("direction", direction)?;
                power("irradiance", irradiance, false)
            }
            Light::Sphere { center, radius, radiance, .. } => {
                place("center", center)?;
                power("radiance", radiance, false)?;
                length("radius", radius, false)
            }
            Light::Imported { position, normal, power: flux, exponent } => {
                place("position", position)?;
                unit("normal", normal)?;
                range("exponent", exponent, 1.0, MAX_EXPONENT)?;
                power("power", flux, true)
            }
        }
    }
}

impl Camera {
    /// Checks that the camera has a view; the message does not name the file.
    pub fn check(&self) -> Result<(), String> {
        place("eye", self.eye)?;
        place("target", self.target)?;
        // A direction, of any length.
        if !self.up.is_finite() {
            return Err(format!("up {} is not finite", self.up));
        }
        let view = (self.target - self.eye).normalize_or_zero();
        if view == Vec3::ZERO {
            return Err(format!("eye and target coincide at {}", self.eye));
        }
        if view.cross(self.up.normalize_or_zero()).length() < 1e-4 {
            return Err(format!("up {} is zero or parallel to the direction of view {view}", self.up));
        }
        match self.height {
            Some(height) => range("height", height, LOWEST_IMAGE, FARTHEST)?,
            None if self.fov_y > 0.0 && self.fov_y < 180.0 => {}
            None => return Err(format!("fov_y {} must lie between 0 and 180 degrees", self.fov_y)),
        }
        if let Some(frustum) = &self.frustum {
            frustum.check()?;
        }
        length("aperture", self.aperture, true)?;
        if self.is_orthographic() && self.has_lens() {
            return Err(format!(
                "aperture {}: an orthographic camera has no lens; set it to 0, or give an angle of view",
                self.aperture
            ));
        }
        if let Some(focus) = self.focus {
            length("focus", focus, false)?;
        }
        if !(self.shutter.is_finite() && self.shutter >= 0.0) {
            return Err(format!("shutter {} is not a time of 0 or more", self.shutter));
        }
        if self.resolution.contains(&0) || self.resolution.iter().any(|&r| r > 65_536) {
            let [w, h] = self.resolution;
            return Err(format!("resolution {w}x{h} must lie between 1x1 and 65536x65536"));
        }
        Ok(())
    }
}
