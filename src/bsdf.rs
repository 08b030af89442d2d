//! Reflection at a surface: Lambert plus a lobe, GGX, GGX of two widths ([`anisotropic`]), [`phong`] or a [`table`]; Fresnel's equations; texture lookup.
//!
//! f_r = kd / pi + D G2 F / (4 cos cos'), D and G2 of GGX (G2 height-correlated, Smith), F after Schlick.
//!
//! The diffuse part is scaled by 1 - F_avg, F_avg = f0 + (f90 - f0) / 21 being the cosine mean of F. So the mean of the
//! albedo over the hemisphere never exceeds 1, and the diffuse part stays a constant: a virtual light of it is
//! Lambertian. The albedo of a single grazing direction can exceed 1 for a light and smooth dielectric.
//!
//! For ideal lobes see [`ideal`]: the reflectance here is then that of the diffuse base alone.

pub mod anisotropic;
pub mod ideal;
pub mod phong;
pub mod table;

use crate::scene::mip::level_count;
use crate::scene::{Cone, Material, Scene, Surface, Texture, TextureUse, Triangle, Wrap};
use glam::{Vec2, Vec3, Vec4};
use std::f32::consts::{PI, TAU};

/// Minimum GGX alpha: f32 does not resolve narrower lobes well.
pub const MIN_ALPHA: f32 = 1e-3;

/// Reflectance at a point, textures applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflectance {
    /// Diffuse albedo.
    pub kd: Vec3,
    /// Specular reflectance at normal incidence; 0 in all channels if there is no lobe.
    pub f0: Vec3,
    /// Specular reflectance at grazing incidence.
    pub f90: f32,
    /// GGX roughness, at most 1; negative: minus the exponent of a [`phong`] lobe; 2 or more: the word of an [`anisotropic`] lobe;
    /// between 1 and 2: that of a [`table`] of one of the scene's materials, which functions look up in `materials`.
    pub alpha: f32,
}

impl Reflectance {
    /// From base colour, metallic, perceptual roughness and the dielectric part's reflectance at normal incidence.
    pub fn new(base: Vec3, metallic: f32, roughness: f32, specular: Vec3) -> Reflectance {
        let f0 = specular + (base - specular) * metallic;
        let f90 = (50.0 * f0.max_element()).clamp(0.0, 1.0);
        let mut r = Reflectance { kd: Vec3::ZERO, f0, f90, alpha: (roughness * roughness).max(MIN_ALPHA) };
        r.kd = base * (1.0 - metallic) * (Vec3::ONE - r.average_fresnel());
        r
    }

    /// The same without the specular lobe.
    fn base_alone(self) -> Reflectance {
        Reflectance { kd: self.kd, f0: Vec3::ZERO, f90: 0.0, alpha: 1.0 }
    }

    /// Cosine mean of Schlick's F over the hemisphere: the lobe's albedo without shadowing.
    pub fn average_fresnel(&self) -> Vec3 {
        self.f0 + (Vec3::splat(self.f90) - self.f0) * (1.0 / 21.0)
    }

    /// Probability of the diffuse lobe when one of the two is chosen; 1 if there is no specular lobe.
    pub fn diffuse_probability(&self) -> f32 {
        let diffuse = mean(self.kd);
        let specular = mean(self.average_fresnel());
        if specular <= 0.0 { 1.0 } else { diffuse / (diffuse + specular) }
    }

    /// The diffuse part of f_r.
    pub fn eval_diffuse(&self) -> Vec3 {
        self.kd * (1.0 / PI)
    }

    /// The specular part of f_r for unit directions that leave the surface; 0 if either is not above it.
    pub fn eval_specular(&self, materials: &[Material], n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        let (cos_i, cos_o) = (n.dot(wi), n.dot(wo));
        if cos_i <= 0.0 || cos_o <= 0.0 || self.f90 <= 0.0 {
            return Vec3::ZERO;
        }
        let h = (wi + wo).normalize();
        if let Some(exponent) = phong::exponent_of(self.alpha) {
            let lobe = phong::pdf(n, wi, wo, exponent) * phong::over_pdf(cos_i, cos_o, exponent);
            return schlick(self.f0, self.f90, wo.dot(h)) * lobe;
        }
        if let Some(grain) = anisotropic::unpack(self.alpha, n) {
            return schlick(self.f0, self.f90, wo.dot(h)) * grain.eval(n, wi, wo);
        }
        if let Some(table) = table::find(materials, self.alpha) {
            return schlick(self.f0, self.f90, wo.dot(h)) * table.eval(n, wi, wo);
        }
        let d = ggx(n, h, self.alpha);
        // G2 / (4 cos cos').
        let a2 = self.alpha * self.alpha;
        let masking = cos_o * (a2 + (1.0 - a2) * (cos_i * cos_i)).sqrt();
        let shadowing = cos_i * (a2 + (1.0 - a2) * (cos_o * cos_o)).sqrt();
        let visibility = 0.5 / (masking + shadowing);
        schlick(self.f0, self.f90, wo.dot(h)) * (d * visibility)
    }

    /// f_r for unit directions that leave the surface; 0 if either is not above it.
    pub fn eval(&self, materials: &[Material], n: Vec3, wi: Vec3, wo: Vec3) -> Vec3 {
        if n.dot(wi) <= 0.0 || n.dot(wo) <= 0.0 {
            return Vec3::ZERO;
        }
        self.eval_diffuse() + self.eval_specular(materials, n, wi, wo)
    }

    /// Density over solid angle of [`Reflectance::sample`].
    pub fn pdf(&self, materials: &[Material], n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let cos_i = n.dot(wi);
        if cos_i <= 0.0 || n.dot(wo) <= 0.0 {
            return 0.0;
        }
        let p = self.diffuse_probability();
        let mut pdf = p * (cos_i / PI);
        if p < 1.0 {
            pdf += (1.0 - p) * pdf_specular(materials, n, wi, wo, self.alpha);
        }
        pdf
    }

    /// A direction wi for wo: `choice` selects the lobe, `u` the direction. It may lie below the surface (then f_r is 0).
    pub fn sample(&self, materials: &[Material], n: Vec3, wo: Vec3, choice: f32, u: [f32; 2]) -> Vec3 {
        if choice < self.diffuse_probability() {
            let ((t, b), w) = (basis(n), sample_diffuse(u));
            return t * w.x + b * w.y + n * w.z;
        }
        self.sample_of_lobe(materials, n, wo, u)
    }

    /// A direction from the specular lobe.
    fn sample_of_lobe(&self, materials: &[Material], n: Vec3, wo: Vec3, u: [f32; 2]) -> Vec3 {
        if let Some(exponent) = phong::exponent_of(self.alpha) {
            return phong::sample(n, wo, exponent, u);
        }
        if let Some(table) = table::find(materials, self.alpha) {
            return table.sample(n, wo, u);
        }
        let (t, b, alphas) = match anisotropic::unpack(self.alpha, n) {
            Some(grain) => (grain.along, grain.across, grain.alphas),
            None => {
                let (t, b) = basis(n);
                (t, b, Vec2::splat(self.alpha))
            }
        };
        let w = sample_specular(Vec3::new(wo.dot(t), wo.dot(b), wo.dot(n)), alphas, u);
        t * w.x + b * w.y + n * w.z
    }

    /// A direction from one lobe, by [`sample_diffuse`] or [`sample_specular`], and its weight: reflectance times cosine over
    /// the lobe's own pdf and the probability of the lobe. Zero weight below the surface.
    pub fn sample_lobe(
        &self,
        materials: &[Material],
        diffuse: bool,
        n: Vec3,
        wo: Vec3,
        u: f32,
        v: f32,
    ) -> (Vec3, Vec3) {
        let p = self.diffuse_probability();
        if diffuse {
            let ((t, b), w) = (basis(n), sample_diffuse([u, v]));
            return (t * w.x + b * w.y + n * w.z, self.kd / p);
        }
        let wi = self.sample_of_lobe(materials, n, wo, [u, v]);
        let pdf = pdf_specular(materials, n, wi, wo, self.alpha) * (1.0 - p);
        let weight = if pdf > 0.0 { self.eval_specular(materials, n, wi, wo) * (n.dot(wi) / pdf) } else { Vec3::ZERO };
        (wi, weight)
    }

    /// Light that the lobe reflects of light from `wo`, mean of the channels, by 8 x 4 visible normals, denser where masking
    /// begins.
    pub fn lobe_albedo(&self, materials: &[Material], n: Vec3, wo: Vec3) -> f32 {
        let lobe = Reflectance { kd: Vec3::ZERO, ..*self };
        let sample = |i: u32| {
            let left = 1.0 - ((i / 4) as f32 + 0.5) / 8.0;
            let turn = ((i % 4) as f32 + 0.25 + 0.5 * (i / 4 % 2) as f32) / 4.0;
            left * lobe.sample_lobe(materials, false, n, wo, 1.0 - left * left, turn).1
        };
        (0..32).map(sample).sum::<Vec3>().element_sum() / 48.0
    }

    /// The lobe widened to at least this alpha, grown (by a factor of at most 4) to reflect as much light from `wo` as before.
    pub fn widened(&self, materials: &[Material], n: Vec3, wo: Vec3, alpha: f32) -> Reflectance {
        let alpha = phong::widened_alpha(self.alpha, alpha);
        if self.f90 <= 0.0 || self.alpha == alpha {
            return *self;
        }
        let wide = Reflectance { alpha, ..*self };
        let factor =
            (self.lobe_albedo(materials, n, wo) / wide.lobe_albedo(materials, n, wo).max(1e-6)).clamp(1.0, 4.0);
        Reflectance { f0: factor * wide.f0, f90: factor * wide.f90, ..wide }
    }
}

/// A material at a point, textures applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// The non-ideal reflectance.
    pub reflectance: Reflectance,
    /// Mirrors: reflectance at normal incidence. Glass: tint of the transmitted light.
    pub ideal: Vec3,
    /// Mirrors: reflectance at grazing incidence.
    pub ideal_f90: f32,
}

impl Finish {
    /// Of a material with these texture values: base colour, and (roughness, metallic); but for the lobe of a table, which belongs to a scene.
    pub fn of(material: &Material, base: Vec3, roughness_metallic: [f32; 2]) -> Finish {
        let [roughness, metallic] = roughness_metallic;
        let base = material.base_color * base;
        let metallic = material.metallic * metallic;
        let whole = Reflectance::new(base, metallic, material.roughness * roughness, material.specular);
        let whole = Reflectance { alpha: material.phong_exponent.map_or(whole.alpha, |d| -d), ..whole };
        match material.surface {
            Surface::Opaque => Finish { reflectance: whole, ideal: Vec3::ZERO, ideal_f90: 0.0 },
            Surface::Mirror => Finish { reflectance: whole.base_alone(), ideal: whole.f0, ideal_f90: whole.f90 },
            Surface::Glass => {
                let nothing = Reflectance { kd: Vec3::ZERO, ..whole.base_alone() };
                Finish { reflectance: nothing, ideal: base, ideal_f90: 0.0 }
            }
        }
    }

    /// The same with the lobe of an anisotropic material along the grain of a triangle, about the shading normal of the side that is seen;
    /// `front`: of the front.
    pub fn along_grain(mut self, scene: &Scene, triangle: &Triangle, shading: Vec3, front: bool) -> Finish {
        let m = &scene.materials[triangle.material as usize];
        if m.is_anisotropic() {
            let alpha = self.reflectance.alpha;
            let grain = scene.grain(triangle, if front { shading } else { -shading });
            let alphas = Vec2::new(m.alpha_along(alpha), alpha);
            self.reflectance.alpha = anisotropic::pack(alphas, grain, shading);
        }
        self
    }

    /// Of a triangle's material at a point, by the weights of its corners.
    pub fn at(scene: &Scene, triangle: &Triangle, weights: [f32; 3]) -> Finish {
        Self::over(scene, triangle, weights, Cone::POINT)
    }

    /// [`Finish::at`], with means of textures over what a cone covers.
    pub fn over(scene: &Scene, triangle: &Triangle, weights: [f32; 3], cone: Cone) -> Finish {
        let material = &scene.materials[triangle.material as usize];
        let texel = |index: Option<u32>, of: TextureUse| {
            index.map_or(Vec4::ONE, |i| scene.texel_over(triangle, weights, (i, of), cone))
        };
        let base = texel(material.base_texture, TextureUse::Base).truncate();
        let mr = texel(material.metallic_roughness_texture, TextureUse::MetallicRoughness);
        let mut finish = Finish::of(material, base * scene.color_at(triangle, weights), [mr.y, mr.z]);
        if let (Some(table), Surface::Opaque) = (&material.lobe, material.surface) {
            finish.reflectance.alpha = table::number(triangle.material, table);
        }
        finish
    }
}

/// Unit normal of a normal map about the unit normal `n` of a triangle's front. `texel` in [0, 1] stands for a direction in
/// [-1, 1] whose x runs along growing u, y along falling v, and z along n (glTF 2.0, 3.9.3; the tangents are those of the
/// triangle, made perpendicular to n and then to each other). Where the texture coordinates span no area, it is n.
pub fn mapped_normal(texel: Vec3, scale: f32, edges: [Vec3; 2], uv_edges: [Vec2; 2], n: Vec3) -> Vec3 {
    let [e1, e2] = edges;
    let [d1, d2] = uv_edges;
    let sign = if d1.x * d2.y - d1.y * d2.x < 0.0 { -1.0 } else { 1.0 };
    let along_u = (e1 * d2.y - e2 * d1.y) * sign;
    let against_v = (e1 * d2.x - e2 * d1.x) * sign;
    let flat = along_u - n * n.dot(along_u);
    let t = flat.normalize_or_zero();
    let rest = against_v - n * n.dot(against_v);
    let b = (rest - t * t.dot(rest)).normalize_or_zero();
    let local = texel * 2.0 - 1.0;
    let mapped = t * (local.x * scale) + b * (local.y * scale) + n * local.z;
    if t == Vec3::ZERO || b == Vec3::ZERO { n } else { mapped.normalize_or(n) }
}

/// Mean of the three channels.
pub fn mean(c: Vec3) -> f32 {
    (c.x + c.y + c.z) * (1.0 / 3.0)
}

/// Geometric and shading normal turned to the side from which a surface is seen.
///
/// The shading normal is flipped to the geometric normal's side. Directions below either hemisphere reflect nothing, so
/// no light leaks through a surface whose interpolated normals lean over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normals {
    /// Geometric normal, on the side of wo.
    pub geometric: Vec3,
    /// Shading normal, on the side of the geometric one.
    pub shading: Vec3,
    /// Seen from the front (counter-clockwise) side.
    pub front: bool,
}

impl Normals {
    /// Turns both normals to the side of wo.
    pub fn facing(geometric: Vec3, shading: Vec3, wo: Vec3) -> Normals {
        let front = geometric.dot(wo) >= 0.0;
        let geometric = if front { geometric } else { -geometric };
        let shading = if shading.dot(geometric) >= 0.0 { shading } else { -shading };
        Normals { geometric, shading, front }
    }

    /// Whether a direction is above both hemispheres.
    pub fn above(&self, w: Vec3) -> bool {
        self.geometric.dot(w) > 0.0 && self.shading.dot(w) > 0.0
    }
}

/// Schlick's approximation of Fresnel reflectance.
pub fn schlick(f0: Vec3, f90: f32, cos: f32) -> Vec3 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    f0 + (Vec3::splat(f90) - f0) * (m2 * m2 * m)
}

/// GGX distribution of normals. The denominator sin^2 + alpha^2 cos^2 takes the sine from a cross product: 1 - cos^2
/// would lose the peak of a narrow lobe to rounding.
pub fn ggx(n: Vec3, h: Vec3, alpha: f32) -> f32 {
    let cos = n.dot(h);
    let cross = n.cross(h);
    let a = alpha * cos;
    let k = alpha / (cross.dot(cross) + a * a);
    k * k * (1.0 / PI)
}

/// Smith's masking function of GGX for one direction.
fn masking(cos: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    2.0 * cos / (cos + (a2 + (1.0 - a2) * (cos * cos)).sqrt())
}

/// Cosine-distributed direction around +z (Keller 1997, 3.2): (arcsin sqrt u, 2 pi v). Density cos / pi.
pub fn sample_diffuse(u: [f32; 2]) -> Vec3 {
    let sin = u[0].sqrt();
    let cos = (1.0 - u[0]).sqrt();
    let phi = TAU * u[1];
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

/// Direction reflected at a visible GGX normal (Heitz 2018), around +z, with the alphas along x and y. May lie below the surface.
pub fn sample_specular(wo: Vec3, alphas: Vec2, u: [f32; 2]) -> Vec3 {
    // Stretched view direction and a basis around it.
    let v = Vec3::new(alphas.x * wo.x, alphas.y * wo.y, wo.z).normalize();
    let length2 = v.x * v.x + v.y * v.y;
    let t1 = if length2 > 0.0 { Vec3::new(-v.y, v.x, 0.0) * (1.0 / length2.sqrt()) } else { Vec3::X };
    let t2 = v.cross(t1);
    // A point of the disc, its half towards the horizon squeezed.
    let r = u[0].sqrt();
    let phi = TAU * u[1];
    let x = r * phi.cos();
    let s = 0.5 * (1.0 + v.z);
    let y = (1.0 - s) * (1.0 - x * x).max(0.0).sqrt() + s * (r * phi.sin());
    // Projected onto the hemisphere, and unstretched.
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let m = t1 * x + t2 * y + v * z;
    let h = Vec3::new(alphas.x * m.x, alphas.y * m.y, m.z.max(0.0)).normalize();
    h * (2.0 * wo.dot(h)) - wo
}

/// Density over solid angle of the directions of a lobe; of GGX, by [`sample_specular`]: G1(wo) D(h) / (4 cos_o).
pub fn pdf_specular(materials: &[Material], n: Vec3, wi: Vec3, wo: Vec3, alpha: f32) -> f32 {
    let cos_o = n.dot(wo);
    if n.dot(wi) <= 0.0 || cos_o <= 0.0 {
        return 0.0;
    }
    if let Some(exponent) = phong::exponent_of(alpha) {
        return phong::pdf(n, wi, wo, exponent);
    }
    if let Some(grain) = anisotropic::unpack(alpha, n) {
        return grain.pdf(n, wi, wo);
    }
    if let Some(table) = table::find(materials, alpha) {
        return table.pdf(n, wi, wo);
    }
    let h = (wi + wo).normalize();
    masking(cos_o, alpha) * ggx(n, h, alpha) / (4.0 * cos_o)
}

/// Two unit vectors that complete the unit vector n to an orthonormal basis (Duff et al. 2017).
pub fn basis(n: Vec3) -> (Vec3, Vec3) {
    // Not the sign bit: a kernel cannot tell -0 from 0.
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * (n.x * n.x) * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Reflectance of a smooth dielectric for unpolarised light (Fresnel). `cos` is that of the incident direction, `eta` the
/// index of the far side over that of the near side. Also returns the cosine of the refracted direction; `None` at total
/// reflection.
pub fn fresnel_dielectric(cos: f32, eta: f32) -> (f32, Option<f32>) {
    let cos = cos.clamp(0.0, 1.0);
    let sin2_t = (1.0 - cos * cos) / (eta * eta);
    if sin2_t >= 1.0 {
        return (1.0, None);
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    (0.5 * (parallel * parallel + perpendicular * perpendicular), Some(cos_t))
}

/// Ideal reflection of wo at n.
pub fn reflect(wo: Vec3, n: Vec3) -> Vec3 {
    n * (2.0 * n.dot(wo)) - wo
}

/// Linear value of an sRGB-encoded value.
pub fn srgb_to_linear(c: f32) -> f32 {
    if c <= 0.04045 { c * (1.0 / 12.92) } else { ((c + 0.055) * (1.0 / 1.055)).powf(2.4) }
}

/// Bilinear lookup. Texel (i, j) has its centre at ((i + 0.5) / width, (j + 0.5) / height); colour is decoded before it is
/// filtered; alpha is always linear.
pub fn sample_texture(texture: &Texture, uv: [f32; 2]) -> Vec4 {
    let (x0, x1, fx) = texel_pair(uv[0], texture.width, texture.wrap[0]);
    let (y0, y1, fy) = texel_pair(uv[1], texture.height, texture.wrap[1]);
    let texel = |x: u32, y: u32| {
        let bytes = texture.texels[y as usize * texture.width as usize + x as usize];
        let c = bytes.map(|b| f32::from(b) * (1.0 / 255.0));
        let decode = |c| if texture.srgb { srgb_to_linear(c) } else { c };
        Vec4::new(decode(c[0]), decode(c[1]), decode(c[2]), c[3])
    };
    let mix = |a: Vec4, b: Vec4, f: f32| a * (1.0 - f) + b * f;
    mix(mix(texel(x0, y0), texel(x1, y0), fx), mix(texel(x0, y1), texel(x1, y1), fx), fy)
}

/// The mean of a scene's texture over a footprint of this width in texture coordinates, 0: a point: linear between the two levels whose
/// texels are as wide. The levels are made anew at each call, unless the scene keeps them ([`Scene::keep_levels`]).
pub fn sample_filtered(scene: &Scene, index: u32, uv: [f32; 2], footprint: f32) -> Vec4 {
    let texture = &scene.textures[index as usize];
    let extent = (texture.width as f32 * texture.height as f32).sqrt();
    let last = level_count([texture.width, texture.height]) - 1;
    let level = (footprint * extent).max(1.0).log2().min(last as f32);
    if level <= 0.0 {
        return sample_texture(texture, uv);
    }
    let of_level = |number: u32| match number {
        0 => sample_texture(texture, uv),
        _ => scene.with_level(index, number, |texture| sample_texture(texture, uv)),
    };
    let fine = level as u32;
    of_level(fine).lerp(of_level((fine + 1).min(last)), level.fract())
}

/// The two texels along one axis and the weight of the second.
fn texel_pair(u: f32, size: u32, wrap: Wrap) -> (u32, u32, f32) {
    // Reduced to the first period first, so that the texel's index stays small and exact.
    let u = match wrap {
        Wrap::Repeat => u - u.floor(),
        Wrap::Mirror => u - 2.0 * (u * 0.5).floor(),
        Wrap::Clamp => u.clamp(0.0, 1.0),
    };
    let x = u * size as f32 - 0.5;
    let cell = x.floor();
    let size = size as i32;
    let index = |i: i32| -> u32 {
        let i = match wrap {
            Wrap::Repeat => i.rem_euclid(size),
            Wrap::Mirror => {
                let i = i.rem_euclid(2 * size);
                i.min(2 * size - 1 - i)
            }
            Wrap::Clamp => i.clamp(0, size - 1),
        };
        i as u32
    };
    (index(cell as i32), index(cell as i32 + 1), x - cell)
}

#[cfg(test)]
mod tests;
