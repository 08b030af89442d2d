//! GGX lobes of two widths: along the grain of a surface, as of brushed metal, and across it.
//!
//! With the half vector's components h_t along the grain, h_b across it and h_n along the normal (Burley 2012, appendix B; Heitz 2014, 5.3)
//!
//! ```text
//! D(h) = 1 / (pi alpha_t alpha_b (h_t^2 / alpha_t^2 + h_b^2 / alpha_b^2 + h_n^2)^2)
//! s(w) = sqrt(alpha_t^2 w_t^2 + alpha_b^2 w_b^2 + w_n^2)
//! f    = F(h) D(h) / (2 (cos_o s(wi) + cos_i s(wo)))     G1(w) = 2 w_n / (w_n + s(w))
//! ```
//!
//! With alpha_t = alpha_b that is the lobe of [`Reflectance`](super::Reflectance). As in glTF's `KHR_materials_anisotropy`
//! alpha_t = mix(alpha, 1, strength^2) and alpha_b = alpha.
//!
//! # The grain
//!
//! [`grain`]: the direction of growing u on the triangle, made perpendicular to the normal, or where texture coordinates span no area a
//! fixed direction of the normal: the level one, or on floors and ceilings +x. It is turned by the material's rotation, counter-clockwise seen
//! from the front where v falls upwards, as in an upright image. Fixed directions do not jump within a plane.
//!
//! # In one number
//!
//! A lobe is one number wherever it is stored, [`Reflectance::alpha`](super::Reflectance::alpha). An alpha of 2 or more is a word that holds
//! this: above the bits of 2.0, which keeps it a number, 9 bits of each alpha, in steps of a 50th of an octave, and 12 of the direction of the
//! grain, d for ((1 - d^2) / (1 + d^2), 2 d / (1 + d^2)) in [`basis`] of the normal about which the lobe stands. So an alpha is off by up to 0.7 %,
//! the direction by 0.03 degrees, in every place alike.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::basis;

/// Bits of 2.0.
const BASE: u32 = 0x4000_0000;
const STEPS_OF_OCTAVE: f32 = 50.0;
/// Alphas of 2^(-507 / 50) or less than a thousandth: what keeps the word below infinity.
const LEAST: u32 = 507;
const ALONG_SHIFT: u32 = 21;
const ACROSS_SHIFT: u32 = 12;
const DIRECTIONS: f32 = 2048.0;
/// Cosine of the slope from which on a surface counts as level.
const LEVEL: f32 = 0.999;

/// A lobe of two widths about a normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grain {
    /// Unit direction along the grain.
    pub along: Vec3,
    /// Unit direction across it; with `along` and the normal right-handed.
    pub across: Vec3,
    /// GGX alpha along and across.
    pub alphas: Vec2,
}

/// Whether an alpha stands for a lobe of two widths.
pub fn is_anisotropic(alpha: f32) -> bool {
    alpha >= 2.0
}

/// An alpha in steps of a 50th of an octave.
pub(super) fn step_of(alpha: f32) -> u32 {
    (-STEPS_OF_OCTAVE * alpha.log2() + 0.5).clamp(0.0, LEAST as f32) as u32
}

/// The alpha of such a number of steps.
pub(super) fn alpha_of(step: u32) -> f32 {
    (step as f32 * (-1.0 / STEPS_OF_OCTAVE)).exp2()
}

fn steps(word: u32) -> [u32; 2] {
    [(word - BASE) >> ALONG_SHIFT, word >> ACROSS_SHIFT & 0x1ff]
}

/// The number for a lobe of these widths along a direction and across it, about the unit normal `n`.
pub fn pack(alphas: Vec2, along: Vec3, n: Vec3) -> f32 {
    let (t, b) = basis(n);
    let flat = Vec2::new(along.dot(t), along.dot(b)).normalize_or(Vec2::X);
    let half = if flat.x < 0.0 { -flat } else { flat };
    let direction = (half.y / (1.0 + half.x) * DIRECTIONS + (DIRECTIONS + 0.5)) as u32 & 0xfff;
    let [along, across] = [step_of(alphas.x), step_of(alphas.y)];
    f32::from_bits(BASE + (along << ALONG_SHIFT | across << ACROSS_SHIFT | direction))
}

/// The lobe about the unit normal `n` that an alpha encodes; `None`: the alpha is that of a lobe of one width.
pub fn unpack(alpha: f32, n: Vec3) -> Option<Grain> {
    if !is_anisotropic(alpha) {
        return None;
    }
    let word = alpha.to_bits();
    let alphas = Vec2::from_array(steps(word).map(alpha_of));
    let d = (word & 0xfff) as f32 * (1.0 / DIRECTIONS) - 1.0;
    let scale = 1.0 / (1.0 + d * d);
    let (x, y) = ((1.0 - d * d) * scale, 2.0 * d * scale);
    let (t, b) = basis(n);
    Some(Grain { along: t * x + b * y, across: b * x - t * y, alphas })
}

/// Any alpha, of a lobe about one normal, for the same lobe about another normal.
pub fn turned(alpha: f32, from: Vec3, to: Vec3) -> f32 {
    unpack(alpha, from).map_or(alpha, |grain| with_direction(alpha, grain.along, to))
}

/// The alpha of a lobe of two widths, along another direction about the unit normal `n`.
pub fn with_direction(alpha: f32, along: Vec3, n: Vec3) -> f32 {
    let direction = pack(Vec2::ONE, along, n).to_bits() & 0xfff;
    f32::from_bits(alpha.to_bits() & !0xfff | direction)
}

/// Geometric mean of both alphas of a lobe of two widths.
pub(super) fn width_of(alpha: f32) -> f32 {
    let [along, across] = steps(alpha.to_bits());
    ((along + across) as f32 * (-0.5 / STEPS_OF_OCTAVE)).exp2()
}

/// A lobe of two widths, each at least this alpha.
pub(super) fn widened(alpha: f32, least: f32) -> f32 {
    let [along, across] = steps(alpha.to_bits()).map(|step| step.min(step_of(least)));
    f32::from_bits(BASE + (along << ALONG_SHIFT | across << ACROSS_SHIFT | alpha.to_bits() & 0xfff))
}

impl Grain {
    /// s(w).
    fn stretch(&self, w: Vec3, cos: f32) -> f32 {
        let (x, y) = (self.alphas.x * self.along.dot(w), self.alphas.y * self.across.dot(w));
        (x * x + y * y + cos * cos).sqrt()
    }

    fn distribution(&self, n: Vec3, h: Vec3) -> f32 {
        let (x, y, z) = (self.along.dot(h) / self.alphas.x, self.across.dot(h) / self.alphas.y, n.dot(h));
        let k = x * x + y * y + z * z;
        1.0 / (PI * self.alphas.x * self.alphas.y * k * k)
    }

    /// The lobe without its Fresnel term, for unit directions above the surface.
    pub(super) fn eval(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let (cos_i, cos_o) = (n.dot(wi), n.dot(wo));
        let visibility = 0.5 / (cos_o * self.stretch(wi, cos_i) + cos_i * self.stretch(wo, cos_o));
        self.distribution(n, (wi + wo).normalize()) * visibility
    }

    /// Density over solid angle of directions reflected at visible normals: G1(wo) D(h) / (4 cos_o).
    pub(super) fn pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let cos_o = n.dot(wo);
        self.distribution(n, (wi + wo).normalize()) / (2.0 * (cos_o + self.stretch(wo, cos_o)))
    }
}

/// Direction along the grain of a triangle about the unit normal `n` of its front: by its edges and those in texture coordinates, turned by
/// `rotation` in radians.
pub fn grain(edges: [Vec3; 2], uv_edges: [Vec2; 2], rotation: f32, n: Vec3) -> Vec3 {
    let [e1, e2] = edges;
    let [d1, d2] = uv_edges;
    let area = d1.x * d2.y - d1.y * d2.x;
    let along_u = if area < 0.0 { e2 * d1.y - e1 * d2.y } else { e1 * d2.y - e2 * d1.y };
    let flat = along_u - n * n.dot(along_u);
    let fixed = if n.y.abs() < LEVEL { Vec3::new(n.z, 0.0, -n.x) } else { Vec3::X - n * n.x };
    let t = if area == 0.0 { None } else { flat.try_normalize() }.unwrap_or_else(|| fixed.normalize());
    // v grows downwards in an upright image; in a mirrored one the other way round.
    let b = if area > 0.0 { t.cross(n) } else { n.cross(t) };
    t * rotation.cos() + b * rotation.sin()
}

#[cfg(test)]
mod tests;
