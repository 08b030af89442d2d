//! Materials and textures of glTF models.
//!
//! Metallic-roughness materials with normal maps, KHR_materials_emissive_strength, _ior, _specular, _transmission and _volume (a
//! thickness above 0 makes a body of glass, else it is a pane); KHR_texture_transform; EXT_texture_webp; KHR_texture_basisu. Textures of
//! one material may take two sets of coordinates or transforms of them. KHR_materials_anisotropy without its texture. Brought near, and named: KHR_materials_clearcoat and
//! _pbrSpecularGlossiness. Lobes too smooth for point lights become ideal mirrors.

use std::collections::HashMap;
use std::path::Path;

use glam::{Vec2, Vec3};
use gltf::image;
use gltf::material::AlphaMode;
use gltf::texture::WrappingMode;
use rayon::prelude::*;
use serde_json::Value;

use super::export::MaterialExtras;
use super::gltf::{Reader, ours};
use super::gltf_accessor::{Buffers, external};
use super::gltf_extensions::{ANISOTROPY, BASISU, CLEARCOAT, GLOSSINESS, WEBP};
use super::quietly::quietly;
use super::{Alpha, MIN_ROUGHNESS, Material, Surface, Texture, Wrap};
use crate::error::{Error, Result};

/// A texture is read once for each use of an image: index, sRGB, wrap modes.
pub(super) type TextureKey = (usize, bool, [u32; 2]);

/// Which texture coordinates a texture takes, and their transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvMap {
    pub(super) set: u32,
    offset: Vec2,
    /// Radians, counter-clockwise where v points down.
    rotation: f32,
    scale: Vec2,
}

impl UvMap {
    /// The coordinates as they stand.
    fn plain(set: u32) -> UvMap {
        UvMap { set, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }
    }

    fn of(info: &gltf::texture::Info) -> UvMap {
        let plain = UvMap::plain(info.tex_coord());
        info.texture_transform().map_or(plain, |t| UvMap {
            set: t.tex_coord().unwrap_or(plain.set),
            offset: Vec2::from_array(t.offset()),
            rotation: t.rotation(),
            scale: Vec2::from_array(t.scale()),
        })
    }

    /// That of a normal map, whose transform the glTF crate does not read.
    fn of_normals(info: &gltf::material::NormalTexture) -> UvMap {
        UvMap::transformed(UvMap::plain(info.tex_coord()), info.extension_value("KHR_texture_transform"))
    }

    fn transformed(plain: UvMap, transform: Option<&Value>) -> UvMap {
        let Some(transform) = transform else { return plain };
        let number = |name: &str, otherwise: f32| {
            transform.pointer(name).and_then(Value::as_f64).map_or(otherwise, |x| x as f32)
        };
        let pair = |name: &str, otherwise: f32| {
            Vec2::new(number(&format!("{name}/0"), otherwise), number(&format!("{name}/1"), otherwise))
        };
        UvMap {
            set: transform.get("texCoord").and_then(Value::as_u64).map_or(plain.set, |set| set as u32),
            offset: pair("/offset", 0.0),
            rotation: number("/rotation", 0.0),
            scale: pair("/scale", 1.0),
        }
    }

    /// That of a texture in an extension that the glTF crate does not read.
    fn of_value(texture: &Value) -> UvMap {
        let set = texture.get("texCoord").and_then(Value::as_u64).unwrap_or(0);
        UvMap::transformed(UvMap::plain(set as u32), texture.pointer("/extensions/KHR_texture_transform"))
    }

    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        let (sin, cos) = self.rotation.sin_cos();
        let uv = uv * self.scale;
        self.offset + Vec2::new(cos * uv.x + sin * uv.y, cos * uv.y - sin * uv.x)
    }
}

/// Coordinates of the textures of a material.
pub(super) struct UvMaps {
    pub(super) first: UvMap,
    pub(super) second: Option<UvMap>,
    /// For each [`TextureUse`](super::TextureUse) whether it takes the second.
    uses_second: [bool; 4],
    /// Whether there are more than two.
    more: bool,
}

impl UvMaps {
    pub(super) fn of(material: &gltf::Material) -> UvMaps {
        let pbr = material.pbr_metallic_roughness();
        let glossiness = material.extension_value(GLOSSINESS);
        let other = |name: &str| glossiness?.get(name).map(UvMap::of_value);
        let all = [
            other("diffuseTexture").or(pbr.base_color_texture().map(|info| UvMap::of(&info))),
            other("specularGlossinessTexture").or(pbr.metallic_roughness_texture().map(|info| UvMap::of(&info))),
            material.normal_texture().map(|info| UvMap::of_normals(&info)),
            material.emissive_texture().map(|info| UvMap::of(&info)),
        ];
        let mut used = all.into_iter().flatten();
        let first = used.next().unwrap_or(UvMap::plain(0));
        let second = used.find(|map| *map != first);
        let more = all.into_iter().flatten().any(|map| map != first && Some(map) != second);
        UvMaps { first, second, uses_second: all.map(|map| map.is_some() && map == second), more }
    }
}

fn name_of(material: &gltf::Material) -> String {
    match (material.name(), material.index()) {
        (Some(name), _) => name.to_string(),
        (None, Some(index)) => format!("material {index}"),
        (None, None) => String::from("default"),
    }
}

/// Refuses factors that are negative or that single precision does not hold, and shares above 1 but for colour and opacity, which
/// are lowered. [`Material::check`] has the other ranges.
fn check_factors(material: &gltf::Material) -> Result<(), String> {
    const ANY: f32 = f32::MAX;
    let check = |name: &str, values: &[f32], most: f32| match values.iter().find(|v| !(0.0..=most).contains(*v)) {
        Some(v) if most == ANY => Err(format!("{name} {v} must be 0 or more, and finite")),
        Some(v) => Err(format!("{name} {v} is not in [0, {most}]")),
        None => Ok(()),
    };
    check("baseColorFactor", &material.pbr_metallic_roughness().base_color_factor(), ANY)?;
    check("alphaCutoff", &[material.alpha_cutoff().unwrap_or(0.0)], ANY)?;
    check("emissiveStrength", &[material.emissive_strength().unwrap_or(0.0)], ANY)?;
    if let Some(scale) = material.normal_texture().map(|texture| texture.scale()).filter(|scale| !scale.is_finite()) {
        return Err(format!("the scale {scale} of normalTexture is not finite"));
    }
    if let Some(specular) = material.specular() {
        check("specularFactor", &[specular.specular_factor()], 1.0)?;
        check("specularColorFactor", &specular.specular_color_factor(), ANY)?;
    }
    if let Some(transmission) = material.transmission() {
        check("transmissionFactor", &[transmission.transmission_factor()], 1.0)?;
    }
    let Some(volume) = material.volume() else { return Ok(()) };
    check("thicknessFactor", &[volume.thickness_factor()], ANY)?;
    check("attenuationColor", &volume.attenuation_color(), 1.0)?;
    // Infinite, as without it, is a body that absorbs nothing.
    check("attenuationDistance", &[volume.attenuation_distance()], f32::INFINITY)
}

impl Reader<'_> {
    /// Index of a material in the scene.
    pub(super) fn material(&mut self, material: &gltf::Material) -> Result<u32> {
        if let Some(&index) = self.materials.get(&material.index()) {
            return Ok(index);
        }
        let maps = UvMaps::of(material);
        if maps.more {
            self.leave_out("a third set of texture coordinates, or transform of them, of one material");
        }
        check_factors(material).map_err(|m| self.error(format!("material {:?}: {m}", name_of(material))))?;
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, opacity] = pbr.base_color_factor();
        if Vec3::new(r, g, b).max_element() > 1.0 {
            log::warn!(
                "{}: material {:?}: baseColorFactor [{r}, {g}, {b}] reflects more than it receives; lowered to 1",
                self.path.display(),
                name_of(material)
            );
        }
        let base_texture = match pbr.base_color_texture() {
            Some(info) => self.texture(&info.texture(), true)?,
            None => None,
        };
        let metallic_roughness_texture = match pbr.metallic_roughness_texture() {
            Some(info) => self.texture(&info.texture(), false)?,
            None => None,
        };
        let mut emission = Vec3::from_array(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0);
        if emission != Vec3::ZERO {
            self.physical_emission |= material.emissive_strength().is_some();
        }
        let mut emission_texture = None;
        if let Some(info) = material.emissive_texture().filter(|_| emission != Vec3::ZERO) {
            emission_texture = self.texture(&info.texture(), true)?;
            let dark = |t: u32| self.scene.textures[t as usize].average() * emission == Vec3::ZERO;
            if emission_texture.is_none_or(dark) {
                if emission_texture.is_none() {
                    self.leave_out("emission whose texture is not read");
                }
                (emission, emission_texture) = (Vec3::ZERO, None);
            }
        }
        let normal_texture = match material.normal_texture() {
            Some(info) => self.texture(&info.texture(), false)?,
            None => None,
        };
        let cutoff = material.alpha_cutoff().unwrap_or(0.5);
        let alpha = match material.alpha_mode() {
            AlphaMode::Opaque => Alpha::Opaque,
            AlphaMode::Mask => Alpha::Mask { opacity, cutoff },
            AlphaMode::Blend => Alpha::Blend { opacity },
        };
        let alpha = alpha.unless_opaque(base_texture.map(|texture| &self.scene.textures[texture as usize]));
        if alpha != Alpha::Opaque && emission != Vec3::ZERO {
            self.leave_out("alpha of surfaces that emit (they are opaque)");
        }
        if material.unlit() {
            self.leave_out("KHR_materials_unlit (such surfaces are lit)");
        }
        let ior = material.ior().unwrap_or(1.5);
        // KHR_materials_ior: an index of 0 means full reflection, as does the formula.
        let mut specular = Vec3::splat(((ior - 1.0) / (ior + 1.0)).powi(2));
        if let Some(extension) = material.specular() {
            let color = Vec3::from_array(extension.specular_color_factor());
            specular = (specular * color).min(Vec3::ONE) * extension.specular_factor();
            if extension.specular_texture().is_some() || extension.specular_color_texture().is_some() {
                self.leave_out("textures of KHR_materials_specular");
            }
        }
        let transmission = material.transmission().map_or(0.0, |t| t.transmission_factor());
        // KHR_materials_volume: a surface without thickness has no inside.
        let volume = material.volume().filter(|v| v.thickness_factor() > 0.0);
        let thin = volume.is_none();
        let mut base_color = Vec3::new(r, g, b).min(Vec3::ONE);
        if let (Some(volume), true) = (&volume, transmission >= 0.5)
            && volume.attenuation_distance().is_finite()
            && volume.attenuation_distance() > 0.0
        {
            // Light crosses the surface twice on its way through the body.
            let crossings = 0.5 * volume.thickness_factor() / volume.attenuation_distance();
            base_color *= Vec3::from_array(volume.attenuation_color()).max(Vec3::ZERO).powf(crossings);
            self.leave_out(
                "the length of light's way in KHR_materials_volume (its attenuation is that over the thickness)",
            );
        }
        // 1 is the default of a file without roughness.
        let roughens = transmission >= 0.5 && thin && pbr.roughness_factor() < 1.0;
        let mut converted = Material {
            name: name_of(material),
            surface: if transmission >= 0.5 { Surface::Glass } else { Surface::Opaque },
            base_color,
            base_texture,
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            phong_exponent: None,
            anisotropy: 0.0,
            anisotropy_rotation: 0.0,
            metallic_roughness_texture,
            normal_texture,
            normal_scale: material.normal_texture().map_or(1.0, |info| info.scale()),
            specular,
            alpha,
            emission,
            emission_exponent: 1.0,
            emission_texture,
            second_uvs: maps.uses_second,
            two_sided: material.double_sided(),
            ior: if ior == 0.0 { 1.5 } else { ior },
            thin,
            frost: if roughens { pbr.roughness_factor() } else { 0.0 },
            reflector: None,
            lobe: None,
        };
        self.approximate(material, &mut converted)?;
        if converted.surface == Surface::Opaque
            && converted.metallic_roughness_texture.is_none()
            && converted.roughness < MIN_ROUGHNESS
        {
            converted.surface = Surface::Mirror;
        }
        if let Some(exact) = ours::<MaterialExtras>(material.extras()) {
            exact.apply(&mut converted);
        } else if converted.surface != Surface::Glass {
            converted.limit_albedo();
        }
        let index = self.scene.add_material(converted);
        self.materials.insert(material.index(), index);
        Ok(index)
    }

    /// Takes the strength of anisotropy, and brings extensions near that need another lobe, or more than one.
    fn approximate(&mut self, material: &gltf::Material, converted: &mut Material) -> Result<()> {
        let number = |extension: &Value, name: &str, otherwise: f32| {
            extension.get(name).and_then(Value::as_f64).map_or(otherwise, |x| x as f32)
        };
        if let Some(extension) = material.extension_value(GLOSSINESS) {
            self.leave_out("KHR_materials_pbrSpecularGlossiness (brought near by its mean specular colour)");
            let vector = |name: &str, i: usize| {
                extension
                    .pointer(&format!("/{name}/{i}"))
                    .and_then(Value::as_f64)
                    .map_or(1.0, |x| (x as f32).clamp(0.0, 1.0))
            };
            let rgb = |name: &str| Vec3::from_array([0, 1, 2].map(|i| vector(name, i)));
            converted.base_color = rgb("diffuseFactor");
            converted.metallic = 0.0;
            converted.metallic_roughness_texture = None;
            converted.base_texture = self.texture_of(extension.get("diffuseTexture"), true)?;
            converted.specular = rgb("specularFactor");
            let glossiness = number(extension, "glossinessFactor", 1.0).clamp(0.0, 1.0);
            converted.roughness = 1.0 - glossiness;
            if let Some(texture) = self.texture_of(extension.get("specularGlossinessTexture"), true)? {
                let glossy = &self.scene.textures[texture as usize];
                converted.specular *= glossy.average();
                let rough = |t: &[u8; 4]| [0, (255.0 - glossiness * f32::from(t[3])).round() as u8, 0, 255];
                let texels = glossy.texels.iter().map(rough).collect();
                let name = format!("roughness of {}", glossy.name);
                let roughness = Texture { name, texels, srgb: false, ..glossy.clone() };
                self.scene.textures.push(roughness);
                converted.roughness = 1.0;
                converted.metallic_roughness_texture = Some(self.scene.textures.len() as u32 - 1);
            }
            let (alpha, textures) = (vector("diffuseFactor", 3), &self.scene.textures);
            converted.alpha = match converted.alpha {
                Alpha::Opaque => Alpha::Opaque,
                Alpha::Mask { cutoff, .. } => Alpha::Mask { opacity: alpha, cutoff },
                Alpha::Blend { .. } => Alpha::Blend { opacity: alpha },
            }
            .unless_opaque(converted.base_texture.map(|texture| &textures[texture as usize]));
        }
        if let Some(extension) = material.extension_value(ANISOTROPY) {
            let strength = number(extension, "anisotropyStrength", 0.0).clamp(0.0, 1.0);
            if strength > 0.0 {
                converted.anisotropy = strength;
                converted.anisotropy_rotation = number(extension, "anisotropyRotation", 0.0) % std::f32::consts::TAU;
                if extension.get("anisotropyTexture").is_some() {
                    self.leave_out(
                        "the texture of KHR_materials_anisotropy (strength and direction are the same everywhere)",
                    );
                }
            }
        }
        if let Some(extension) = material.extension_value(CLEARCOAT) {
            let coat = number(extension, "clearcoatFactor", 0.0).clamp(0.0, 1.0);
            let roughness = number(extension, "clearcoatRoughnessFactor", 0.0).clamp(0.0, 1.0);
            if coat >= 0.5
                && converted.surface == Surface::Opaque
                && converted.metallic <= 0.5
                && converted.metallic_roughness_texture.is_none()
                && roughness < converted.roughness
            {
                self.leave_out("KHR_materials_clearcoat (one lobe stands for coat and base)");
                // Light that the coat lets through is reflected by the base and crosses the coat again.
                let own = 0.04 * coat;
                converted.specular = Vec3::splat(own) + converted.specular * ((1.0 - own) * (1.0 - own));
                converted.roughness = roughness;
            } else if coat > 0.0 {
                self.leave_out("KHR_materials_clearcoat that is weak, or over metal or patterned roughness");
            }
        }
        Ok(())
    }

    /// Index in the scene of the texture that an extension names.
    fn texture_of(&mut self, info: Option<&Value>, srgb: bool) -> Result<Option<u32>> {
        let Some(index) = info.and_then(|info| info.get("index")) else { return Ok(None) };
        let texture = index.as_u64().and_then(|i| self.document.textures().nth(usize::try_from(i).ok()?));
        match texture {
            Some(texture) => self.texture(&texture, srgb),
            None => Err(self.error(format!("a material names texture {index}, which does not exist"))),
        }
    }

    /// Index of a texture in the scene; `None` if its image is of a kind that is not read.
    fn texture(&mut self, texture: &gltf::Texture, srgb: bool) -> Result<Option<u32>> {
        let image = match image_of(self.document, texture) {
            Ok(Some(image)) => image,
            Ok(None) => {
                self.leave_out(
                    "textures without a PNG, JPEG, WebP or KTX 2.0 image (such surfaces have their plain colour)",
                );
                return Ok(None);
            }
            Err(index) => {
                return Err(self.error(format!("texture {}: there is no image {index}", texture.index())));
            }
        };
        let sampler = texture.sampler();
        let modes = [sampler.wrap_s(), sampler.wrap_t()];
        let key = (image.index(), srgb, modes.map(|m| m.as_gl_enum()));
        if let Some(&index) = self.textures.get(&key) {
            return Ok(Some(index));
        }
        let wrap = modes.map(|mode| match mode {
            WrappingMode::Repeat => Wrap::Repeat,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::ClampToEdge => Wrap::Clamp,
        });
        if self.images.is_empty() {
            self.images = self.read_images();
        }
        let decoded = match self.images.get_mut(&image.index()).and_then(Option::take) {
            Some(decoded) => decoded,
            // It is needed in another way as well, or no texture that the document lists has it.
            None => self.read_image(&image),
        };
        let texture = Texture { srgb, wrap, ..decoded? };
        self.scene.textures.push(texture);
        let index = self.scene.textures.len() as u32 - 1;
        self.textures.insert(key, index);
        Ok(Some(index))
    }
    /// Decodes the images of all textures, on all cores. Errors wait until a material asks for the image.
    fn read_images(&self) -> HashMap<usize, Option<Result<Texture>>> {
        let textures = self.document.textures();
        let mut images: Vec<_> = textures.filter_map(|texture| image_of(self.document, &texture).ok()?).collect();
        images.sort_by_key(gltf::Image::index);
        images.dedup_by_key(|image| image.index());
        let (path, buffers) = (self.path, &self.buffers);
        let read = |image: gltf::Image| (image.index(), Some(read_image(path, buffers, &image)));
        images.into_par_iter().with_max_len(1).map(read).collect()
    }

    fn read_image(&self, image: &gltf::Image) -> Result<Texture> {
        read_image(self.path, &self.buffers, image)
    }
}

/// The image of a texture, which an extension may name; `None`: there is none that is read. Error: there is no image of this index.
fn image_of<'a>(document: &'a gltf::Document, texture: &gltf::Texture<'a>) -> Result<Option<gltf::Image<'a>>, u64> {
    let source = |extension: &str| texture.extension_value(extension)?.get("source")?.as_u64();
    match (texture.source(), source(WEBP).or_else(|| source(BASISU))) {
        (Some(image), _) => Ok(Some(image)),
        (None, Some(index)) => {
            let image = usize::try_from(index).ok().and_then(|i| document.images().nth(i));
            image.map(Some).ok_or(index)
        }
        (None, None) => Ok(None),
    }
}

/// Decodes an image, as a texture that is linear and repeats. A thread of its own keeps panics of the crates quiet.
fn read_image(path: &Path, buffers: &Buffers, image: &gltf::Image) -> Result<Texture> {
    quietly(|| decode_image(path, buffers, image))
        .unwrap_or_else(|message| Err(Error::file(path, format!("malformed glTF: {message}"))))
}

fn decode_image(path: &Path, buffers: &Buffers, image: &gltf::Image) -> Result<Texture> {
    let numbered = || format!("image {}", image.index());
    let failed = |name: &str, why: String| Error::file(path, format!("texture {name}: {why}"));
    let decode = |bytes: &[u8], name: String| {
        Texture::decode(buffers.inputs, bytes, name.clone(), false, [Wrap::Repeat; 2]).map_err(|why| failed(&name, why))
    };
    match image.source() {
        image::Source::View { view, .. } => {
            decode(buffers.view(&view)?, image.name().map_or_else(numbered, str::to_string))
        }
        image::Source::Uri { uri, .. } => {
            let name = if uri.starts_with("data:") { numbered() } else { uri.to_string() };
            let bytes = external(buffers.inputs, path, uri).map_err(|why| failed(&name, why))?;
            decode(&bytes, name)
        }
    }
}
