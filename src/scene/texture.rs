//! Textures: averages, and where they lie on surfaces.

use glam::{Vec2, Vec3, Vec4};

use super::{Scene, Texture, Triangle};
use crate::bsdf::anisotropic::grain;
use crate::bsdf::{mapped_normal, sample_filtered};

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

impl Texture {
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
    use crate::scene::Wrap;

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
}
