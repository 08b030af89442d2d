//! Materials and images of a model with kept light ([`super::files`]).

use std::collections::HashMap;
use std::path::Path;

use glam::Vec3;
use serde_json::{Value, json};

use super::files::{Form, Kind};
use super::{Lightmap, Page};
use crate::error::{Error, Result};
use crate::output::{self, Layers, Tonemap};
use crate::scene::{Material, Scene, Surface, export};
use crate::settings::Exposure;

/// An image of the document: name, PNG, sampler.
type Image = (String, Vec<u8>, Value);

/// Materials of the document.
pub(super) struct Materials<'a> {
    path: &'a Path,
    scene: &'a Scene,
    form: Form,
    /// Exposure of the unlit form in stops.
    stops: f32,
    made: HashMap<(u32, Option<u32>, bool, bool), usize>,
    /// The materials.
    pub list: Vec<Value>,
    /// The images, each a texture of the same index.
    pub images: Vec<Image>,
}

/// Whether a material shows a pattern where it is without kept light.
pub(super) fn is_pattern(m: &Material) -> bool {
    m.emission_texture.is_some() && m.emission.max_element() > 0.0
}

impl<'a> Materials<'a> {
    /// Begins with the scene's textures, or for [`Form::Unlit`] with the radiance of the pages.
    pub fn new(path: &'a Path, scene: &'a Scene, light: &Lightmap, form: Form) -> Result<Materials<'a>> {
        let mut images = Vec::new();
        let mut stops = 0.0;
        match form {
            Form::Lit => {
                for texture in &scene.textures {
                    let bytes = export::png(texture).map_err(|why| Error::file(path, why))?;
                    images.push((texture.name.clone(), bytes, export::sampler(texture)));
                }
            }
            Form::Unlit { exposure, tonemap } => {
                let radiance = |page: &Page| (0..page.direct.len()).map(|i| page.radiance(i)).collect();
                let shown: Vec<Vec<Vec3>> = light.pages.iter().map(radiance).collect();
                let lit: Vec<Vec3> = shown.iter().flatten().copied().filter(|l| *l != Vec3::ZERO).collect();
                stops = exposure.stops(&lit);
                for (i, (page, color)) in light.pages.iter().zip(shown).enumerate() {
                    let bytes = png(path, page.size, color, stops, tonemap)?;
                    images.push((format!("radiance {i}"), bytes, json!({ "wrapS": 33071, "wrapT": 33071 })));
                }
            }
        }
        Ok(Materials { path, scene, form, stops, made: HashMap::new(), list: Vec::new(), images })
    }

    /// Index of the material of a primitive.
    pub fn index(&mut self, kind: Kind) -> Result<usize> {
        let Kind { material, page, both_sides, emits, .. } = kind;
        let key = match (self.form, page) {
            // Primitives of all pages have one form.
            (Form::Lit, _) => (material, None, both_sides, emits),
            (Form::Unlit { .. }, Some(_)) => (0, page, both_sides, true),
            (Form::Unlit { .. }, None) => (material, None, both_sides, true),
        };
        if let Some(&index) = self.made.get(&key) {
            return Ok(index);
        }
        let m = &self.scene.materials[material as usize];
        let mut value = match (self.form, page) {
            (Form::Lit, _) if emits => export::material(m),
            (Form::Lit, _) => export::material(&Material { emission: Vec3::ZERO, emission_texture: None, ..m.clone() }),
            (Form::Unlit { .. }, Some(page)) => textured(format!("radiance {page}"), page as usize),
            (Form::Unlit { tonemap, .. }, None) if is_pattern(m) => self.pattern(m, tonemap)?,
            (Form::Unlit { .. }, None) => self.plain(m),
        };
        value["doubleSided"] = json!(both_sides);
        self.list.push(value);
        self.made.insert(key, self.list.len() - 1);
        Ok(self.list.len() - 1)
    }

    /// An emitter with a texture, in the unlit form.
    fn pattern(&mut self, m: &Material, tonemap: Tonemap) -> Result<Value> {
        let texture = m.emission_texture.and_then(|t| self.scene.textures.get(t as usize));
        let Some(texture) = texture else { return Ok(self.plain(m)) };
        let (width, height) = (texture.width, texture.height);
        let texel = |i: u32| m.emission * texture.linear_texel(i % width, i / width).truncate();
        let color = (0..width * height).map(texel).collect();
        let bytes = png(self.path, [width, height], color, self.stops, tonemap)?;
        self.images.push((texture.name.clone(), bytes, export::sampler(texture)));
        Ok(textured(m.name.clone(), self.images.len() - 1))
    }

    /// One colour: emitters glow; mirrors show a part of their tint, and glass is nearly clear.
    fn plain(&self, m: &Material) -> Value {
        let tint = match m.surface {
            Surface::Glass => Vec3::ONE,
            _ => 0.5 * m.specular.lerp(m.base_color, m.metallic),
        };
        let glows = m.emission.max_element() > 0.0;
        let color = if glows { (m.emission * self.stops.exp2()).min(Vec3::ONE) } else { tint };
        let clear = m.surface == Surface::Glass;
        let factor = color.extend(if clear { 0.1 } else { 1.0 }).to_array();
        json!({
            "name": m.name,
            "pbrMetallicRoughness": { "baseColorFactor": export::vector(factor), "metallicFactor": 0.0 },
            "alphaMode": if clear { "BLEND" } else { "OPAQUE" },
            "extensions": { "KHR_materials_unlit": {} },
        })
    }
}

/// An unlit material that shows a texture.
fn textured(name: String, texture: usize) -> Value {
    json!({
        "name": name,
        "pbrMetallicRoughness": { "baseColorTexture": { "index": texture }, "metallicFactor": 0.0 },
        "extensions": { "KHR_materials_unlit": {} },
    })
}

/// Radiance for display.
fn png(path: &Path, [width, height]: [u32; 2], color: Vec<Vec3>, stops: f32, tonemap: Tonemap) -> Result<Vec<u8>> {
    let layers = Layers { width, height, color, ..Layers::default() };
    output::encode_png(path, &layers, Exposure::Stops(stops), tonemap)
}
