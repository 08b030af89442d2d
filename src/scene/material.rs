//! How a surface scatters, lets pass and emits light.

use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::Texture;
use crate::bsdf::phong;
use crate::superposition::lobe::Table;

/// Kind of light scattering at a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Surface {
    /// Lambert plus a GGX lobe.
    #[default]
    Opaque,
    /// Lambert plus an ideal mirror instead of the lobe (MTL illum 3, 5). Eye paths, particles and photons
    /// follow it; gather rays see only its diffuse base.
    Mirror,
    /// Smooth dielectric of index `ior`, tinted by `base_color` (MTL illum 4, 6, 7, 9). Eye paths, particles and
    /// photons follow it. It is black for gather rays and blocks virtual lights.
    Glass,
}

/// How much of a surface is there: rays pass the rest as if there were nothing, without a change of direction. The alpha of the base
/// texture, where there is one, multiplies the opacity.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub enum Alpha {
    /// All of it, whatever the texture's alpha.
    #[default]
    Opaque,
    /// All where alpha is at least the cutoff, elsewhere nothing.
    Mask {
        /// Factor of alpha in [0, 1].
        opacity: f32,
        /// Least alpha that is there, not negative.
        cutoff: f32,
    },
    /// The share alpha of it.
    Blend {
        /// Factor of alpha in [0, 1].
        opacity: f32,
    },
}

impl Alpha {
    /// The same, or [`Alpha::Opaque`] if all of the surface is there, with this base texture.
    pub(crate) fn unless_opaque(self, texture: Option<&Texture>) -> Alpha {
        let least =
            || texture.map_or(1.0, |t| f32::from(t.texels.iter().map(|texel| texel[3]).min().unwrap_or(255)) / 255.0);
        let whole = match self {
            Alpha::Opaque => true,
            Alpha::Mask { opacity, cutoff } => opacity * least() >= cutoff,
            Alpha::Blend { opacity } => opacity * least() >= 1.0,
        };
        if whole { Alpha::Opaque } else { self }
    }

    /// With another opacity or cutoff. A cutoff makes a mask of it.
    pub(super) fn with(self, opacity: Option<f32>, cutoff: Option<f32>) -> Alpha {
        let (own_opacity, own_cutoff) = match self {
            Alpha::Opaque => (1.0, None),
            Alpha::Mask { opacity, cutoff } => (opacity, Some(cutoff)),
            Alpha::Blend { opacity } => (opacity, None),
        };
        let changed = opacity.or(cutoff).is_some();
        let opacity = opacity.unwrap_or(own_opacity);
        match cutoff.or(own_cutoff) {
            _ if !changed => self,
            Some(cutoff) => Alpha::Mask { opacity, cutoff },
            None => Alpha::Blend { opacity },
        }
    }

    pub(super) fn check(self) -> std::result::Result<(), String> {
        let (opacity, cutoff) = match self {
            Alpha::Opaque => (1.0, 0.0),
            Alpha::Mask { opacity, cutoff } => (opacity, cutoff),
            Alpha::Blend { opacity } => (opacity, 0.0),
        };
        if !(0.0..=1.0).contains(&opacity) {
            return Err(format!("opacity {opacity} must be in [0, 1]"));
        }
        if !(cutoff >= 0.0 && cutoff.is_finite()) {
            return Err(format!("the cutoff of alpha, {cutoff}, must be 0 or more"));
        }
        Ok(())
    }
}

/// A material: reflectance f_r = kd/pi + ks D G F / (4 cos cos').
///
/// kd = base_color (1 - metallic) (1 - mean F), F0 = mix(specular, base_color, metallic), GGX alpha = roughness^2.
/// There is no specular lobe where F0 is 0. With a `phong_exponent` the lobe is that of [`crate::bsdf::phong`], with `anisotropy` that of
/// [`crate::bsdf::anisotropic`], with a `lobe` that of [`crate::bsdf::table`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Kind of surface.
    pub surface: Surface,
    /// Base colour, each channel in [0, 1]; multiplied by `base_texture` if there is one.
    pub base_color: Vec3,
    /// Index into `textures` (sRGB).
    pub base_texture: Option<u32>,
    /// 0 dielectric .. 1 metal.
    pub metallic: f32,
    /// Perceptual roughness in [0, 1].
    pub roughness: f32,
    /// Exponent of a lobe by a power of the cosine in place of GGX, in [`phong::EXPONENTS`](crate::bsdf::phong::EXPONENTS); `roughness` has no effect then.
    pub phong_exponent: Option<f32>,
    /// Strength in [0, 1] of the anisotropy of a GGX lobe, as in glTF: along the grain ([`crate::bsdf::anisotropic`]) alpha is
    /// mix(alpha, 1, strength^2). 0: the same in all directions.
    pub anisotropy: f32,
    /// Angle in radians, in \[-2 pi, 2 pi\], of the grain from the direction of growing u.
    pub anisotropy_rotation: f32,
    /// Index into `textures` (linear; green: roughness, blue: metallic, as in glTF).
    pub metallic_roughness_texture: Option<u32>,
    /// Index into `textures` (linear): tangent-space normals of the front, as in glTF.
    pub normal_texture: Option<u32>,
    /// Factor of the x and y of those normals.
    pub normal_scale: f32,
    /// Reflectance at normal incidence of the dielectric part, in [0, 1]; 0 for a purely Lambertian material.
    pub specular: Vec3,
    /// How much of the surface is there, unless it emits: emitters are opaque.
    pub alpha: Alpha,
    /// Emitted radiance along the normal; multiplied by `emission_texture` if there is one.
    pub emission: Vec3,
    /// Exponent d of the emitted intensity, which goes by cos^d of the angle from the normal, in [1, [`MAX_EXPONENT`](crate::light::cosine::MAX_EXPONENT)].
    /// 1: the same radiance in every direction. `emission` is the radiance along the normal.
    pub emission_exponent: f32,
    /// Index into `textures` (sRGB).
    pub emission_texture: Option<u32>,
    /// For each [`TextureUse`](super::TextureUse) whether the texture lies by [`second_uvs`](super::Scene::second_uvs) instead of
    /// [`uvs`](super::Scene::uvs); never for the base.
    pub second_uvs: [bool; 4],
    /// Emits from both sides.
    pub two_sided: bool,
    /// Index of refraction (glass).
    pub ior: f32,
    /// Thin glass, such as a window pane: no refraction. Else every front face leads into a body of
    /// glass, and every back face out of one. OBJ files have no such property: there glass is thin if its surfaces are not closed.
    pub thin: bool,
    /// Perceptual roughness in [0, 1] of thin glass, which blurs the image behind it (see [`crate::bsdf::ideal::frost`]). 0: clear.
    pub frost: f32,
    /// Whether flat faces of this material are planar reflectors, and if `true` smooth curved ones curved reflectors; `None`: see [`Material::may_reflect`].
    pub reflector: Option<bool>,
    /// Measured lobe, without the Fresnel factor, in place of GGX ([`crate::bsdf::table`]); `roughness`, `phong_exponent` and `anisotropy` have no
    /// effect then. Of thin glass it is the lobe that blurs the image behind it. Not serialised.
    #[serde(skip)]
    pub lobe: Option<Arc<Table>>,
}

impl Default for Material {
    fn default() -> Self {
        Material {
            name: String::from("default"),
            surface: Surface::Opaque,
            base_color: Vec3::splat(0.8),
            base_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            phong_exponent: None,
            anisotropy: 0.0,
            anisotropy_rotation: 0.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            specular: Vec3::ZERO,
            alpha: Alpha::Opaque,
            emission: Vec3::ZERO,
            emission_exponent: 1.0,
            emission_texture: None,
            second_uvs: [false; 4],
            two_sided: false,
            ior: 1.5,
            thin: false,
            frost: 0.0,
            reflector: None,
            lobe: None,
        }
    }
}

impl Material {
    /// Whether rays may pass.
    pub fn has_alpha(&self) -> bool {
        self.alpha != Alpha::Opaque && self.emission == Vec3::ZERO
    }

    /// Alpha of its lobe without textures, or for another lobe that of a GGX lobe about as wide.
    pub(crate) fn lobe_width(&self) -> f32 {
        let alpha = self.roughness * self.roughness;
        if let Some(table) = &self.lobe {
            return table.alpha();
        }
        match self.phong_exponent {
            Some(d) => phong::width_of(-d),
            None if self.is_anisotropic() => (alpha * self.alpha_along(alpha)).sqrt(),
            None => alpha,
        }
    }

    /// Whether its lobe has two widths.
    pub(crate) fn is_anisotropic(&self) -> bool {
        self.anisotropy > 0.0 && self.phong_exponent.is_none() && self.lobe.is_none() && self.surface == Surface::Opaque
    }

    /// Alpha along the grain, for the alpha across it.
    pub(crate) fn alpha_along(&self, across: f32) -> f32 {
        across + (1.0 - across) * self.anisotropy * self.anisotropy
    }

    /// Its textures.
    pub fn textures(&self) -> impl Iterator<Item = u32> {
        let all = [self.base_texture, self.metallic_roughness_texture, self.normal_texture, self.emission_texture];
        all.into_iter().flatten()
    }

    /// Mean over RGB of the reflectance kd + F0 seen by particles, at most 1; `averages` are those of the scene's textures.
    pub(crate) fn mean_albedo(&self, averages: &[Vec3]) -> f32 {
        let average = |texture: Option<u32>| texture.map_or(Vec3::ONE, |t| averages[t as usize]);
        let base = self.base_color * average(self.base_texture);
        let metallic = self.metallic * average(self.metallic_roughness_texture).z;
        let albedo = match self.surface {
            Surface::Opaque => base * (1.0 - metallic) + self.specular.lerp(base, metallic),
            Surface::Mirror => base * (1.0 - metallic),
            Surface::Glass => Vec3::ZERO,
        };
        (albedo.element_sum() / 3.0).min(1.0)
    }

    /// Mean over RGB of the reflectance of an ideal mirror, or 1 for glass; `averages` are those of the scene's textures.
    pub(crate) fn mean_ideal(&self, averages: &[Vec3]) -> f32 {
        match self.surface {
            Surface::Opaque => 0.0,
            Surface::Glass => 1.0,
            Surface::Mirror => {
                let average = |texture: Option<u32>| texture.map_or(Vec3::ONE, |t| averages[t as usize]);
                let metallic = self.metallic * average(self.metallic_roughness_texture).z;
                let base = self.base_color * average(self.base_texture);
                (self.specular.lerp(base, metallic).element_sum() / 3.0).min(1.0)
            }
        }
    }

    /// Lowers the base colour so that diffuse plus specular reflectance is at most 1 in every channel; returns the largest
    /// excess.
    pub(crate) fn limit_albedo(&mut self) -> f32 {
        let room = Vec3::ONE - self.specular * (1.0 - self.metallic);
        let excess = (self.base_color - room).max_element();
        if excess > 0.0 {
            self.base_color = self.base_color.min(room.max(Vec3::ZERO));
        }
        excess.max(0.0)
    }
}
