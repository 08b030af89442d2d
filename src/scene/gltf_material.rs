//! Materials and textures of glTF models.
//!
//! Metallic-roughness materials with normal maps, KHR_materials_emissive_strength, _ior, _specular, _transmission and _volume (a
//! thickness above 0 makes a body of glass, else it is a pane); KHR_texture_transform; EXT_texture_webp. An emission
//! texture is replaced by its average. Lobes too smooth for point lights become ideal mirrors.

use std::collections::HashMap;
use std::path::Path;

use glam::{Vec2, Vec3};
use gltf::material::AlphaMode;
use gltf::texture::WrappingMode;
use gltf::{buffer, image};
use rayon::prelude::*;

use super::export::MaterialExtras;
use super::gltf::{Reader, ours};
use super::gltf_accessor::{Buffers, reason};
use super::gltf_extensions::WEBP;
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
        let plain = UvMap::plain(info.tex_coord());
        let Some(transform) = info.extension_value("KHR_texture_transform") else { return plain };
        let number = |name: &str, otherwise: f32| {
            transform.pointer(name).and_then(serde_json::Value::as_f64).map_or(otherwise, |x| x as f32)
        };
        let pair = |name: &str, otherwise: f32| {
            Vec2::new(number(&format!("{name}/0"), otherwise), number(&format!("{name}/1"), otherwise))
        };
        UvMap {
            set: transform.get("texCoord").and_then(serde_json::Value::as_u64).map_or(plain.set, |set| set as u32),
            offset: pair("/offset", 0.0),
            rotation: number("/rotation", 0.0),
            scale: pair("/scale", 1.0),
        }
    }

    /// That of the base colour, which the other textures of a material share, or if it has none that of roughness or normals.
    pub(super) fn of_material(material: &gltf::Material) -> UvMap {
        let pbr = material.pbr_metallic_roughness();
        let info = pbr.base_color_texture().or(pbr.metallic_roughness_texture());
        match (info, material.normal_texture()) {
            (Some(info), _) => UvMap::of(&info),
            (None, Some(info)) => UvMap::of_normals(&info),
            (None, None) => UvMap::plain(0),
        }
    }

    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        let (sin, cos) = self.rotation.sin_cos();
        let uv = uv * self.scale;
        self.offset + Vec2::new(cos * uv.x + sin * uv.y, cos * uv.y - sin * uv.x)
    }
}

impl Reader<'_> {
    /// Index of a material in the scene.
    pub(super) fn material(&mut self, material: &gltf::Material) -> Result<u32> {
        if let Some(&index) = self.materials.get(&material.index()) {
            return Ok(index);
        }
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, opacity] = pbr.base_color_factor();
        let base_texture = match pbr.base_color_texture() {
            Some(info) => self.texture(&info.texture(), true)?,
            None => None,
        };
        let metallic_roughness_texture = match pbr.metallic_roughness_texture() {
            Some(info) => {
                if UvMap::of(&info) != UvMap::of_material(material) {
                    self.leave_out("a second set of texture coordinates, or another transform of them");
                }
                self.texture(&info.texture(), false)?
            }
            None => None,
        };
        let mut emission = Vec3::from_array(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0);
        if let Some(info) = material.emissive_texture()
            && emission != Vec3::ZERO
        {
            self.leave_out("the pattern of emission textures (their average is used)");
            if let Some(texture) = self.texture(&info.texture(), true)? {
                emission *= self.scene.textures[texture as usize].average();
            }
        }
        let normal_texture = match material.normal_texture() {
            Some(info) => {
                if UvMap::of_normals(&info) != UvMap::of_material(material) {
                    self.leave_out("a second set of texture coordinates, or another transform of them");
                }
                self.texture(&info.texture(), false)?
            }
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
        let mut base_color = Vec3::new(r, g, b);
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
        let name = match (material.name(), material.index()) {
            (Some(name), _) => name.to_string(),
            (None, Some(index)) => format!("material {index}"),
            (None, None) => String::from("default"),
        };
        let mut converted = Material {
            name,
            surface: if transmission >= 0.5 { Surface::Glass } else { Surface::Opaque },
            base_color,
            base_texture,
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            metallic_roughness_texture,
            normal_texture,
            normal_scale: material.normal_texture().map_or(1.0, |info| info.scale()),
            specular,
            alpha,
            emission,
            two_sided: material.double_sided(),
            ior: if ior == 0.0 { 1.5 } else { ior },
            thin,
            frost: if roughens { pbr.roughness_factor() } else { 0.0 },
            reflector: None,
            lobe: None,
        };
        if converted.surface == Surface::Opaque
            && metallic_roughness_texture.is_none()
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

    /// Index of a texture in the scene; `None` if its image is of a kind that is not read.
    fn texture(&mut self, texture: &gltf::Texture, srgb: bool) -> Result<Option<u32>> {
        let webp = || texture.extension_value(WEBP)?.get("source")?.as_u64();
        let image = match (texture.source(), webp()) {
            (Some(image), _) => image,
            (None, Some(index)) => {
                let image = usize::try_from(index).ok().and_then(|i| self.document.images().nth(i));
                image.ok_or_else(|| self.error(format!("texture {}: there is no image {index}", texture.index())))?
            }
            (None, None) => {
                self.leave_out("textures without a PNG, JPEG or WebP image (such surfaces have their plain colour)");
                return Ok(None);
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
        let mut images: Vec<_> = self.document.textures().filter_map(|texture| texture.source()).collect();
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

/// Decodes an image, as a texture that is linear and repeats.
fn read_image(path: &Path, buffers: &Buffers, image: &gltf::Image) -> Result<Texture> {
    let numbered = || format!("image {}", image.index());
    let failed = |name: &str, why: String| Error::file(path, format!("texture {name}: {why}"));
    let decode = |bytes: &[u8], name: String| {
        Texture::decode(bytes, name.clone(), false, [Wrap::Repeat; 2]).map_err(|why| failed(&name, why))
    };
    match image.source() {
        image::Source::View { view, .. } => {
            decode(buffers.view(&view)?, image.name().map_or_else(numbered, str::to_string))
        }
        image::Source::Uri { uri, .. } => {
            let name = if uri.starts_with("data:") { numbered() } else { uri.to_string() };
            // A buffer source reads files and data URIs alike.
            let bytes = buffer::Data::from_source(buffer::Source::Uri(uri), path.parent())
                .map_err(|e| failed(&name, reason(&e)))?;
            decode(&bytes, name)
        }
    }
}
