//! BSDFs of Mitsuba's scenes as materials.

use std::f32::consts::FRAC_PI_2;

use glam::{Affine2, Vec3};

use super::mitsuba::Reader;
use super::mitsuba_indices::{dielectric, metal};
use super::mitsuba_texture::{Image, Value, encode};
use super::mitsuba_xml::{Element, MAX_NESTING};
use super::texture::srgb_to_linear;
use super::{Alpha, MIN_ROUGHNESS, Material, Surface, Texture};
use crate::bsdf::Reflectance;
use crate::error::Result;
use crate::input::Inputs;

/// A material of the scene, and what its textures want of the vertices.
#[derive(Clone)]
pub(super) struct Look {
    pub(super) material: u32,
    /// From the texture coordinates of the shape to those of the textures.
    pub(super) map: Affine2,
    /// Vertex colours count.
    pub(super) vertex_colors: bool,
}

/// A material in the making.
struct Draft {
    material: Material,
    base: Option<Image>,
    /// Of a diffuse base below a dielectric that reflects this share of light from inside, which multiplies light between the two.
    inner: Option<f32>,
    normals: Option<Image>,
    opacity: Option<Image>,
    vertex_colors: bool,
    invisible: bool,
}

impl<'a> Reader<'a> {
    /// The material of a shape; `None` if the shape is invisible. `upright`: u, v and the normal are a right-handed system.
    pub(super) fn look(
        &mut self,
        shape: &'a Element,
        bsdf: Option<&'a Element>,
        emission: Vec3,
        upright: bool,
    ) -> Result<Option<Look>> {
        let identity = bsdf.map_or(0, |e| std::ptr::from_ref(e) as usize);
        let key = (identity, emission.to_array().map(f32::to_bits), upright);
        if let Some(look) = self.looks.get(&key) {
            return Ok(look.clone());
        }
        let named = if emission == Vec3::ZERO { bsdf.unwrap_or(shape) } else { shape };
        let mut draft = Draft {
            material: Material { name: named.label(), base_color: Vec3::splat(0.5), emission, ..Material::default() },
            base: None,
            inner: None,
            normals: None,
            opacity: None,
            vertex_colors: false,
            invisible: false,
        };
        if let Some(bsdf) = bsdf {
            self.bsdf(bsdf, &mut draft, 0)?;
        }
        let turns = draft.normals.is_some();
        let look = if draft.invisible { None } else { Some(self.made(bsdf.unwrap_or(shape), draft, upright)?) };
        self.looks.insert(key, look.clone());
        if !turns {
            self.looks.insert((key.0, key.1, !upright), look.clone());
        }
        Ok(look)
    }

    fn bsdf(&mut self, e: &'a Element, draft: &mut Draft, depth: usize) -> Result<()> {
        if depth > MAX_NESTING {
            return Err(e.error(format!("BSDFs within BSDFs, deeper than {MAX_NESTING}")));
        }
        let kind = e.kind();
        match kind {
            "diffuse" | "roughdiffuse" | "difftrans" => {
                if kind != "diffuse" {
                    self.leave_out(format!("bsdf {kind:?} (diffuse)"));
                }
                let name = if kind == "difftrans" { "transmittance" } else { "reflectance" };
                self.base(e, name, 0.5, draft)?;
            }
            "conductor" | "roughconductor" => self.conductor(e, draft)?,
            "dielectric" | "thindielectric" | "roughdielectric" => self.dielectric(e, draft)?,
            "plastic" | "roughplastic" | "pplastic" => self.plastic(e, draft)?,
            "principled" | "principledthin" => self.principled(e, draft)?,
            "phong" => {
                self.leave_out("bsdf \"phong\" (a GGX lobe)");
                self.base(e, "diffuse_reflectance", 0.5, draft)?;
                let exponent = e.number("exponent")?.unwrap_or(30.0).max(0.0);
                draft.material.specular = self.plain(e, "specular_reflectance", 0.2)?.clamp(Vec3::ZERO, Vec3::ONE);
                draft.material.roughness = (2.0 / (exponent + 2.0)).powf(0.25).max(MIN_ROUGHNESS);
            }
            "twosided" | "bumpmap" | "normalmap" | "coating" | "roughcoating" | "blendbsdf" | "mixturebsdf" => {
                if kind != "twosided" && kind != "normalmap" {
                    self.leave_out(format!("bsdf {kind:?} (the first inside it)"));
                }
                let inner = self.child(e, "bsdf")?.ok_or_else(|| e.error("no bsdf inside"))?;
                if kind == "twosided" && e.children_of("bsdf").count() > 1 {
                    self.leave_out("the second bsdf of \"twosided\"");
                }
                if kind == "normalmap" {
                    let texture = self.child(e, "texture")?.ok_or_else(|| e.error("no texture"))?;
                    match self.texture_of(texture)? {
                        Value::Image(image) => draft.normals = Some(image),
                        _ => self.leave_out("normal maps without an image"),
                    }
                }
                self.bsdf(inner, draft, depth + 1)?;
            }
            "mask" => {
                let inner = self.child(e, "bsdf")?.ok_or_else(|| e.error("no bsdf inside"))?;
                match self.color(e, "opacity", Vec3::splat(0.5))? {
                    Value::Color(color) => {
                        let opacity = (color.element_sum() / 3.0).clamp(0.0, 1.0);
                        draft.material.alpha = Alpha::Blend { opacity };
                    }
                    Value::Image(image) => draft.opacity = Some(image),
                    Value::Vertices => self.leave_out("opacity by vertex colours"),
                }
                self.bsdf(inner, draft, depth + 1)?;
            }
            "null" => draft.invisible = true,
            other => self.leave_out(format!("bsdf {other:?} (grey)")),
        }
        Ok(())
    }

    /// Sets the base colour from the colour or texture of this name.
    fn base(&mut self, e: &'a Element, name: &str, otherwise: f32, draft: &mut Draft) -> Result<()> {
        let clamped = |c: Vec3| c.clamp(Vec3::ZERO, Vec3::ONE);
        match self.color(e, name, Vec3::splat(otherwise))? {
            Value::Color(color) => draft.material.base_color = clamped(color),
            Value::Vertices => {
                draft.material.base_color = Vec3::ONE;
                draft.vertex_colors = true;
            }
            Value::Image(image) => {
                draft.material.base_color = clamped(image.factor);
                draft.base = Some(image);
            }
        }
        Ok(())
    }

    /// A metal, or a mirror if it is smooth.
    fn conductor(&mut self, e: &'a Element, draft: &mut Draft) -> Result<()> {
        self.base(e, "specular_reflectance", 1.0, draft)?;
        let name = e.string("material").unwrap_or("none");
        let [eta, k] = if e.property("eta").is_some() || e.property("k").is_some() {
            [self.plain(e, "eta", 0.0)?, self.plain(e, "k", 1.0)?]
        } else {
            metal(name).ok_or_else(|| e.error(format!("conductor {name:?} is not known; give eta and k")))?
        };
        let outside = self.index(e, "ext_eta", "vacuum")?;
        let (n, k) = (eta / outside, k / outside);
        let squares = k * k;
        let f0 = ((n - 1.0) * (n - 1.0) + squares) / ((n + 1.0) * (n + 1.0) + squares).max(Vec3::splat(1e-12));
        let m = &mut draft.material;
        m.base_color *= f0.clamp(Vec3::ZERO, Vec3::ONE);
        m.metallic = 1.0;
        self.roughen(e, draft)
    }

    /// Sets the roughness of a rough BSDF; a smooth one is a mirror.
    fn roughen(&mut self, e: &'a Element, draft: &mut Draft) -> Result<()> {
        let [u, v] = if e.kind().starts_with("rough") { self.alphas(e)? } else { [0.0; 2] };
        let m = &mut draft.material;
        m.roughness = u.min(v).sqrt();
        if u.max(v).sqrt() < MIN_ROUGHNESS {
            m.surface = Surface::Mirror;
        } else if u != v {
            m.roughness = m.roughness.max(MIN_ROUGHNESS);
            let across = m.roughness * m.roughness;
            m.anisotropy = ((u.max(v) - across) / (1.0 - across)).clamp(0.0, 1.0).sqrt();
            m.anisotropy_rotation = if u > v { 0.0 } else { FRAC_PI_2 };
        }
        Ok(())
    }

    /// Alpha along u and v.
    fn alphas(&mut self, e: &'a Element) -> Result<[f32; 2]> {
        if e.string("distribution").unwrap_or("beckmann") != "ggx" {
            self.leave_out("the micro-facet distribution of Beckmann (GGX of the same alpha)");
        }
        let two = e.property("alpha_u").is_some() || e.property("alpha_v").is_some();
        let names = if two { ["alpha_u", "alpha_v"] } else { ["alpha"; 2] };
        let [u, v] = names.map(|name| self.plain(e, name, 0.1));
        Ok([u?, v?].map(|alpha| (alpha.element_sum() / 3.0).clamp(0.0, 1.0)))
    }

    /// The index of refraction of this name: a number or a material.
    fn index(&mut self, e: &'a Element, name: &str, otherwise: &str) -> Result<f32> {
        let material = match (e.number(name)?, e.string(name)) {
            (Some(index), _) if index > 0.0 => return Ok(index),
            (Some(index), _) => return Err(e.error(format!("{name} {index} must be above 0"))),
            (None, known) => known.unwrap_or(otherwise),
        };
        dielectric(material).ok_or_else(|| e.error(format!("{name}: {material:?} is not known; give a number")))
    }

    /// The index inside over that outside.
    fn relative_index(&mut self, e: &'a Element, inside: &str) -> Result<f32> {
        let outside = self.index(e, "ext_ior", "air")?;
        if outside > 1.01 {
            self.leave_out("bodies of glass in contact with something else than air (a relative index in air)");
        }
        Ok((self.index(e, "int_ior", inside)? / outside).clamp(0.001, 10.0))
    }

    fn dielectric(&mut self, e: &'a Element, draft: &mut Draft) -> Result<()> {
        let ior = self.relative_index(e, "bk7")?;
        let tint = self.plain(e, "specular_transmittance", 1.0)?.clamp(Vec3::ZERO, Vec3::ONE);
        let reflected = self.plain(e, "specular_reflectance", 1.0)?.clamp(Vec3::ZERO, Vec3::ONE);
        let m = &mut draft.material;
        if tint == Vec3::ZERO {
            // It only reflects, as a black body below a coat does.
            m.base_color = Vec3::ZERO;
            m.specular = reflected * ((ior - 1.0) / (ior + 1.0)).powi(2);
            return self.roughen(e, draft);
        }
        m.surface = Surface::Glass;
        m.base_color = tint;
        m.ior = ior;
        m.thin = e.kind() == "thindielectric";
        if reflected != Vec3::ONE {
            self.leave_out("specular_reflectance of glass");
        }
        if e.kind() == "roughdielectric" {
            self.leave_out("bsdf \"roughdielectric\" (smooth glass)");
        }
        Ok(())
    }

    /// A diffuse base under a coat.
    fn plastic(&mut self, e: &'a Element, draft: &mut Draft) -> Result<()> {
        let ior = self.relative_index(e, "polypropylene")?;
        self.base(e, "diffuse_reflectance", 0.5, draft)?;
        let reflected = self.plain(e, "specular_reflectance", 1.0)?.clamp(Vec3::ZERO, Vec3::ONE);
        draft.material.specular = reflected * ((ior - 1.0) / (ior + 1.0)).powi(2);
        if e.boolean("nonlinear")? {
            let inner = inner_reflectance(ior);
            draft.inner = Some(inner);
        }
        self.roughen(e, draft)
    }

    fn principled(&mut self, e: &'a Element, draft: &mut Draft) -> Result<()> {
        self.base(e, "base_color", 0.5, draft)?;
        let number = |reader: &mut Self, name: &str, otherwise: f32| -> Result<f32> {
            Ok((reader.plain(e, name, otherwise)?.element_sum() / 3.0).clamp(0.0, 1.0))
        };
        let roughness = number(self, "roughness", 0.5)?;
        let metallic = number(self, "metallic", 0.0)?;
        let specular = match e.property("eta") {
            Some(_) => {
                let eta = self.index(e, "eta", "bk7")?;
                ((eta - 1.0) / (eta + 1.0)).powi(2)
            }
            None => 0.08 * number(self, "specular", 0.5)?,
        };
        for name in ["anisotropic", "clearcoat", "sheen", "spec_tint", "flatness", "diff_trans"] {
            if number(self, name, 0.0)? > 0.0 {
                self.leave_out(format!("{name} of bsdf \"principled\""));
            }
        }
        let m = &mut draft.material;
        m.metallic = metallic;
        m.roughness = roughness.max(MIN_ROUGHNESS);
        m.specular = Vec3::splat(specular);
        if number(self, "spec_trans", 0.0)? > 0.0 {
            self.leave_out("spec_trans of bsdf \"principled\" (smooth glass from 0.5 on, else opaque)");
            if number(self, "spec_trans", 0.0)? >= 0.5 {
                let root = specular.sqrt();
                let m = &mut draft.material;
                m.surface = Surface::Glass;
                m.ior = ((1.0 + root) / (1.0 - root).max(0.1)).clamp(1.0, 10.0);
                m.thin = e.kind() == "principledthin";
                return Ok(());
            }
        }
        // Burley's diffuse lobe has this albedo on average over the hemisphere, and no coat above takes light from it.
        let m = &mut draft.material;
        let coat = Reflectance::new(Vec3::ZERO, 0.0, 1.0, m.specular).average_fresnel();
        let factor = (0.953 + 0.112 * roughness) / (Vec3::ONE - coat) * (1.0 - metallic) + metallic;
        m.base_color = (m.base_color * factor).min(Vec3::ONE);
        Ok(())
    }

    /// The finished material with its textures.
    fn made(&mut self, e: &'a Element, draft: Draft, upright: bool) -> Result<Look> {
        let Draft { mut material, base, inner, normals, opacity, vertex_colors, .. } = draft;
        let images = [&base, &opacity, &normals].map(|image| image.as_ref().map(|image| image.map));
        let map = images.iter().flatten().next().copied().unwrap_or(Affine2::IDENTITY);
        if images.iter().flatten().any(|other| !other.abs_diff_eq(map, 1e-6)) {
            self.leave_out("a second transform of texture coordinates in one material");
        }
        if let (Some(inner), None) = (inner, &base) {
            material.base_color = material.base_color.map(|rho| below_coat(rho, inner));
        }
        if let Some(first) = base.as_ref().or(opacity.as_ref()) {
            // Light between base and coat is no multiple of the texture's colour.
            let inner = inner.filter(|_| base.is_some()).map(|inner| (inner, material.base_color));
            let key = format!("{:?} {:?} {inner:?}", base.as_ref().map(Image::key), opacity.as_ref().map(Image::key));
            let index = match self.textures.get(&key) {
                Some(&index) => index,
                None => {
                    let mut texture = first.load(self.inputs)?;
                    match inner {
                        Some((inner, factor)) => put_below_coat(&mut texture, inner, factor),
                        None if base.is_none() => texture.texels.fill([255; 4]),
                        None => {}
                    }
                    if let Some(image) = &opacity {
                        texture = with_opacity(self.inputs, texture, image)?;
                    }
                    self.add_texture(key, texture)
                }
            };
            material.base_texture = Some(index);
            if inner.is_some() {
                material.base_color = Vec3::ONE;
            }
        }
        if opacity.is_some() {
            material.alpha = Alpha::Blend { opacity: 1.0 };
        }
        let texture = material.base_texture.map(|i| &self.scene.textures[i as usize]);
        material.alpha = material.alpha.unless_opaque(texture);
        if material.alpha != Alpha::Opaque && material.emission != Vec3::ZERO {
            self.leave_out("opacity of surfaces that emit (they are opaque)");
        }
        if let Some(image) = normals {
            // Our y runs along falling v, theirs is perpendicular to normal and growing u.
            let flip = upright == (map.matrix2.determinant() >= 0.0);
            let key = format!("normals {} {flip}", image.key());
            let index = match self.textures.get(&key) {
                Some(&index) => index,
                None => {
                    let mut texture = image.load(self.inputs)?;
                    if flip {
                        texture.texels.iter_mut().for_each(|texel| texel[1] = 255 - texel[1]);
                    }
                    self.add_texture(key, texture)
                }
            };
            if self.scene.textures[index as usize].srgb {
                self.leave_out("sRGB-encoded normal maps (taken as linear)");
                self.scene.textures[index as usize].srgb = false;
            }
            material.normal_texture = Some(index);
        }
        let material = self.add_material(e, material)?;
        Ok(Look { material, map, vertex_colors })
    }

    fn add_texture(&mut self, key: String, texture: Texture) -> u32 {
        self.scene.textures.push(texture);
        let index = self.scene.textures.len() as u32 - 1;
        self.textures.insert(key, index);
        index
    }
}

/// Changes the albedos of a texture, times a factor, to those below a coat.
fn put_below_coat(texture: &mut Texture, inner: f32, factor: Vec3) {
    let decoded = |value: f32| if texture.srgb { srgb_to_linear(value) } else { value };
    let table = |factor: f32| -> [u8; 256] {
        std::array::from_fn(|value| encode(below_coat(factor * decoded(value as f32 / 255.0), inner)))
    };
    let tables = factor.to_array().map(table);
    for texel in &mut texture.texels {
        for (channel, table) in texel.iter_mut().zip(&tables) {
            *channel = table[usize::from(*channel)];
        }
    }
    texture.srgb = true;
}

/// The texture with the luminance of an image as its alpha, on the finer grid of the two.
fn with_opacity(inputs: &Inputs, mut texture: Texture, image: &Image) -> Result<Texture> {
    let mask = image.load(inputs)?;
    let scaled = |i: u32, to: u32, from: u32| (u64::from(i) * u64::from(to) / u64::from(from)) as u32;
    let (width, height) = (mask.width.max(texture.width), mask.height.max(texture.height));
    let mut texels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            let [from_x, from_y] = [scaled(x, texture.width, width), scaled(y, texture.height, height)];
            let [r, g, b, _] = texture.texels[from_y as usize * texture.width as usize + from_x as usize];
            let share = mask.linear_texel(scaled(x, mask.width, width), scaled(y, mask.height, height));
            let share = (share.truncate() * image.factor).dot(Vec3::new(0.2126, 0.7152, 0.0722));
            texels.push([r, g, b, (255.0 * share.clamp(0.0, 1.0)).round() as u8]);
        }
    }
    texture.texels = texels;
    Ok(Texture { width, height, ..texture })
}

/// Albedo that a diffuse base of albedo `rho` has for light that is reflected between it and the coat above again and again,
/// over that of one reflection.
fn below_coat(rho: f32, inner: f32) -> f32 {
    rho * (1.0 - inner) / (1.0 - rho * inner)
}

/// Share of diffuse light that a dielectric reflects back inside: Fresnel's reflectance, its cosine mean.
fn inner_reflectance(ior: f32) -> f32 {
    const STEPS: u32 = 256;
    let reflected = |i: u32| {
        let cosine = ((i as f32 + 0.5) / STEPS as f32).sqrt();
        f64::from(crate::bsdf::fresnel_dielectric(cosine, 1.0 / ior).0)
    };
    ((0..STEPS).map(reflected).sum::<f64>() / f64::from(STEPS)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inner_reflectance_is_that_of_the_literature() {
        // Egan and Hilgeman 1979: 0.5963 for an index of 1.5.
        assert!((inner_reflectance(1.5) - 0.5963).abs() < 2e-3, "{}", inner_reflectance(1.5));
        assert_eq!(below_coat(1.0, 0.6), 1.0);
        assert!((below_coat(0.5, 0.6) - 0.5 * 0.4 / 0.7).abs() < 1e-6);
    }
}
