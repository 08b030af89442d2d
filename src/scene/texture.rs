//! Textures: decoding and averages; where they lie on surfaces.

use std::io::Cursor;
use std::path::Path;

use glam::{Vec2, Vec3, Vec4};
use image::{ImageFormat, ImageReader};

#[cfg(feature = "gltf")]
use super::ktx2::decode as decode_ktx2;
use super::{Scene, Texture, Triangle, Wrap, openexr};
use crate::bsdf::anisotropic::grain;
use crate::bsdf::{mapped_normal, sample_filtered};
use crate::input::Inputs;

/// A use of a texture by a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureUse {
    /// [`super::Material::base_texture`], which keeps the first set of coordinates.
    Base = 0,
    /// [`super::Material::metallic_roughness_texture`].
    MetallicRoughness = 1,
    /// [`super::Material::normal_texture`].
    Normal = 2,
    /// [`super::Material::emission_texture`].
    Emission = 3,
}

/// Reserves bytes of memory, or tells why not.
pub(super) type Reserve<'a> = &'a dyn Fn(u64) -> Result<(), String>;

/// Whether bytes are a KTX 2.0 file.
pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\xabKTX 20\xbb\r\n\x1a\n")
}

/// Stands for the decoder where it is not compiled.
#[cfg(not(feature = "gltf"))]
fn decode_ktx2(_: &[u8], _: Reserve) -> Result<(u32, u32, Vec<[u8; 4]>), String> {
    Err(String::from("this program was built without the feature gltf, which reads KTX 2.0 textures"))
}

/// Counts the memory of decoded texels, before it is taken where the decoder allows that.
fn count(inputs: &Inputs, name: &str, [width, height]: [u32; 2], texel: u64) -> Result<(), String> {
    inputs.take(Path::new(name), u64::from(width) * u64::from(height) * texel).map_err(|e| e.to_string())
}

impl Texture {
    /// Decodes a PNG, JPEG, TGA, BMP, WebP, KTX 2.0, OpenEXR or Radiance file; the error is the decoder's reason. Values of files of
    /// floats (OpenEXR, Radiance) are linear; they are cut to [0, 1], and the log says so where it matters.
    pub(super) fn decode(
        inputs: &Inputs,
        bytes: &[u8],
        name: String,
        srgb: bool,
        wrap: [Wrap; 2],
    ) -> Result<Texture, String> {
        let (texture, peak) = Texture::decode_with(inputs, bytes, name, srgb, wrap, false)?;
        if peak > 1.0 {
            log::warn!("{}: values above 1 are cut off: no surface reflects more than it receives", texture.name);
        }
        Ok(texture)
    }

    /// The same for radiance: values of files of floats are divided by the returned factor, the greatest of them if that is above
    /// 1, so that none is cut off.
    pub(super) fn decode_radiance(
        inputs: &Inputs,
        bytes: &[u8],
        name: String,
        wrap: [Wrap; 2],
    ) -> Result<(Texture, f32), String> {
        Texture::decode_with(inputs, bytes, name, true, wrap, true)
    }

    fn decode_with(
        inputs: &Inputs,
        bytes: &[u8],
        name: String,
        srgb: bool,
        wrap: [Wrap; 2],
        scaled: bool,
    ) -> Result<(Texture, f32), String> {
        let reserve = |bytes| inputs.take(Path::new(&name), bytes).map_err(|e| e.to_string());
        if is_ktx2(bytes) {
            let (width, height, texels) = decode_ktx2(bytes, &reserve)?;
            return Ok((Texture { name, width, height, texels, srgb, wrap }, 1.0));
        }
        let format = image::guess_format(bytes).ok().or_else(|| ImageFormat::from_path(&name).ok());
        let format = match format {
            Some(format) => format,
            None => image::guess_format(bytes).map_err(|e| e.to_string())?,
        };
        let (width, height, values) = if format == ImageFormat::OpenExr {
            let openexr::Pixels { size: [width, height], values } = openexr::decode(bytes, &reserve)?;
            (width, height, values.into_flattened())
        } else {
            let reader = || ImageReader::with_format(Cursor::new(bytes), format);
            let (width, height) = reader().into_dimensions().map_err(|e| e.to_string())?;
            // Of floats while it is converted.
            count(inputs, &name, [width, height], if format == ImageFormat::Hdr { 16 } else { 4 })?;
            let image = reader().decode().map_err(|e| e.to_string())?;
            let (width, height) = (image.width(), image.height());
            if !matches!(image, image::DynamicImage::ImageRgb32F(_) | image::DynamicImage::ImageRgba32F(_)) {
                let texels = image.into_rgba8().into_raw().chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]).collect();
                return Ok((Texture { name, width, height, texels, srgb, wrap }, 1.0));
            }
            (width, height, image.into_rgba32f().into_raw())
        };
        if let Some(at) = values.iter().position(|v| !v.is_finite() || *v < 0.0) {
            let (x, y) = (at / 4 % width as usize, at / 4 / width as usize);
            return Err(format!("the value {} of the texel ({x}, {y}) is negative or not a number", values[at]));
        }
        let peak = values.chunks_exact(4).flat_map(|t| &t[..3]).fold(1.0_f32, |most, &v| most.max(v));
        let divisor = if scaled { peak } else { 1.0 };
        let encoded = |v: f32| {
            let v = (v / divisor).clamp(0.0, 1.0);
            (255.0 * if srgb { linear_to_srgb(v) } else { v }).round() as u8
        };
        let alpha = |v: f32| (255.0 * v.min(1.0)).round() as u8;
        let texel = |t: &[f32]| [encoded(t[0]), encoded(t[1]), encoded(t[2]), alpha(t[3])];
        let texels = values.chunks_exact(4).map(texel).collect();
        Ok((Texture { name, width, height, texels, srgb, wrap }, peak))
    }

    /// Mean of the linear colour over all texels.
    pub fn average(&self) -> Vec3 {
        // Integer histograms keep the sum exact and free of order.
        let mut counts = [[0u64; 256]; 3];
        for texel in &self.texels {
            for (channel, &value) in counts.iter_mut().zip(texel) {
                channel[usize::from(value)] += 1;
            }
        }
        let total = self.texels.len().max(1) as f64;
        let mean = |counts: &[u64; 256]| -> f32 {
            let sum: f64 = (0u8..=255).zip(counts).map(|(v, &n)| n as f64 * f64::from(self.decode_channel(v))).sum();
            (sum / total) as f32
        };
        Vec3::new(mean(&counts[0]), mean(&counts[1]), mean(&counts[2]))
    }

    /// Linear value of a texel at integer coordinates inside the texture (alpha is stored linearly).
    pub fn linear_texel(&self, x: u32, y: u32) -> Vec4 {
        let [r, g, b, a] = self.texels[y as usize * self.width as usize + x as usize];
        Vec4::new(self.decode_channel(r), self.decode_channel(g), self.decode_channel(b), f32::from(a) / 255.0)
    }

    fn decode_channel(&self, value: u8) -> f32 {
        let x = f32::from(value) / 255.0;
        if self.srgb { srgb_to_linear(x) } else { x }
    }
}

/// A cone of directions around a ray, where it meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Its width there; 0: a point.
    pub width: f32,
    /// Cosine between the ray and the surface's normal.
    pub cosine: f32,
}

impl Cone {
    /// The ray itself.
    pub const POINT: Cone = Cone { width: 0.0, cosine: 1.0 };
}

impl Scene {
    /// Texture coordinates of a triangle's corners for one use of a texture.
    pub fn corner_uvs(&self, triangle: &Triangle, of: TextureUse) -> [Vec2; 3] {
        let second = self.materials[triangle.material as usize].second_uvs[of as usize];
        let set = if second { &self.second_uvs } else { &self.uvs };
        triangle.vertices.map(|v| set.get(v as usize).copied().unwrap_or(Vec2::ZERO))
    }

    /// Texture coordinates at a point of a triangle for one use of a texture, by the weights of its corners.
    pub fn uv_at(&self, triangle: &Triangle, weights: [f32; 3], of: TextureUse) -> Vec2 {
        let [a, b, c] = self.corner_uvs(triangle, of);
        a * weights[0] + b * weights[1] + c * weights[2]
    }

    /// Width in texture coordinates of what a cone covers on a triangle: the root of the area, that is between the widths along and
    /// across the cone. At cosines below 0.01 it stops growing.
    pub fn footprint(&self, triangle: &Triangle, of: TextureUse, cone: Cone) -> f32 {
        let [p, q, r] = triangle.vertices.map(|v| self.positions[v as usize]);
        let [s, t, u] = self.corner_uvs(triangle, of);
        let area = (q - p).cross(r - p).length();
        let of_area = if area > 0.0 { (t - s).perp_dot(u - s).abs() / area } else { 0.0 };
        cone.width * (of_area / cone.cosine.max(0.01)).sqrt()
    }

    /// A texture's mean over what a cone covers around a point of a triangle (see [`crate::bsdf::sample_filtered`]).
    pub fn texel_over(
        &self,
        triangle: &Triangle,
        weights: [f32; 3],
        (texture, of): (u32, TextureUse),
        cone: Cone,
    ) -> Vec4 {
        let uv = self.uv_at(triangle, weights, of).to_array();
        sample_filtered(self, texture, uv, self.footprint(triangle, of, cone))
    }

    /// Normal of a surface with a normal map ([`crate::bsdf::mapped_normal`]) at a point of a triangle, by the weights of its corners;
    /// `normal` is the unit normal without it, on the triangle's front.
    pub fn mapped_normal(&self, triangle: &Triangle, weights: [f32; 3], normal: Vec3) -> Vec3 {
        self.mapped_normal_over(triangle, weights, normal, Cone::POINT)
    }

    /// [`Scene::mapped_normal`], from the mean vector over what a cone covers.
    pub fn mapped_normal_over(&self, triangle: &Triangle, weights: [f32; 3], normal: Vec3, cone: Cone) -> Vec3 {
        let material = &self.materials[triangle.material as usize];
        let Some(texture) = material.normal_texture else { return normal };
        let [a, b, c] = triangle.vertices.map(|v| self.positions[v as usize]);
        let uvs = self.corner_uvs(triangle, TextureUse::Normal);
        let texel = self.texel_over(triangle, weights, (texture, TextureUse::Normal), cone).truncate();
        mapped_normal(texel, material.normal_scale, [b - a, c - a], [uvs[1] - uvs[0], uvs[2] - uvs[0]], normal)
    }

    /// Direction along the grain ([`crate::bsdf::anisotropic`]) of a triangle about the unit normal of its front.
    pub fn grain(&self, triangle: &Triangle, normal: Vec3) -> Vec3 {
        let [a, b, c] = triangle.vertices.map(|v| self.positions[v as usize]);
        let uvs = self.corner_uvs(triangle, TextureUse::Base);
        let rotation = self.materials[triangle.material as usize].anisotropy_rotation;
        grain([b - a, c - a], [uvs[1] - uvs[0], uvs[2] - uvs[0]], rotation, normal)
    }

    /// Radiance that a triangle emits at a point, by the weights of its corners.
    pub fn emission_at(&self, triangle: &Triangle, weights: [f32; 3]) -> Vec3 {
        self.emission_over(triangle, weights, Cone::POINT)
    }

    /// [`Scene::emission_at`], the mean over what a cone covers.
    pub fn emission_over(&self, triangle: &Triangle, weights: [f32; 3], cone: Cone) -> Vec3 {
        let material = &self.materials[triangle.material as usize];
        let Some(texture) = material.emission_texture else { return material.emission };
        material.emission * self.texel_over(triangle, weights, (texture, TextureUse::Emission), cone).truncate()
    }
}

/// Linear value of an sRGB-encoded value (IEC 61966-2-1).
pub fn srgb_to_linear(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB encoding of a linear value in [0, 1].
pub(crate) fn linear_to_srgb(x: f32) -> f32 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn average_is_linear() {
        let mut texture = Texture {
            name: String::from("t"),
            width: 2,
            height: 1,
            texels: vec![[0, 255, 188, 255], [255, 255, 188, 255]],
            srgb: true,
            wrap: [Wrap::Repeat; 2],
        };
        let average = texture.average();
        assert!((average - Vec3::new(0.5, 1.0, 0.5029)).abs().max_element() < 1e-4, "{average}");
        texture.srgb = false;
        assert!((texture.average().z - 188.0 / 255.0).abs() < 1e-6);
        assert_eq!(texture.linear_texel(1, 0).x, 1.0);
    }

    fn float_file(values: &[f32]) -> Vec<u8> {
        let pixels = image::Rgb32FImage::from_raw(values.len() as u32 / 3, 1, values.to_vec()).unwrap();
        let mut bytes = std::io::Cursor::new(Vec::new());
        pixels.write_to(&mut bytes, image::ImageFormat::OpenExr).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn floats_are_linear() {
        let bytes = float_file(&[0.5, 0.01, 1.0, 4.0, 0.25, 0.0]);
        let decode = |srgb| {
            Texture::decode(&Inputs::anywhere(), &bytes, String::from("t.exr"), srgb, [Wrap::Repeat; 2]).unwrap()
        };
        for (srgb, texture) in [(true, decode(true)), (false, decode(false))] {
            for (x, wanted) in [Vec3::new(0.5, 0.01, 1.0), Vec3::new(1.0, 0.25, 0.0)].into_iter().enumerate() {
                let got = texture.linear_texel(x as u32, 0).truncate();
                assert!((got - wanted).abs().max_element() < 0.5 / 255.0 * 2.3, "sRGB {srgb}: {got} of {wanted}");
            }
        }
        let (texture, factor) =
            Texture::decode_radiance(&Inputs::anywhere(), &bytes, String::from("t.exr"), [Wrap::Repeat; 2]).unwrap();
        assert_eq!(factor, 4.0);
        let got = factor * texture.linear_texel(1, 0).truncate();
        assert!((got - Vec3::new(4.0, 0.25, 0.0)).abs().max_element() < 0.01, "{got}");
        let got = factor * texture.linear_texel(0, 0).truncate();
        assert!((got - Vec3::new(0.5, 0.01, 1.0)).abs().max_element() < 0.01, "{got}");
    }

    #[test]
    fn wrong_floats_are_named() {
        for wrong in [f32::NAN, f32::INFINITY, -1.0] {
            let bytes = float_file(&[0.5, 0.5, 0.5, 0.5, wrong, 0.5]);
            let why = Texture::decode(&Inputs::anywhere(), &bytes, String::from("t.exr"), true, [Wrap::Repeat; 2])
                .unwrap_err();
            assert!(why.contains("texel (1, 0)"), "{why}");
        }
    }
}
