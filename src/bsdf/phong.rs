//! Scattering by a power of the cosine about the mirror direction (Keller 1997, 4.2; Phong).
//!
//! A particle of flux F that keeps its direction of incidence wi leaves a light of intensity F f(wi, w) cos w, with
//!
//! ```text
//! f(wi, wo) = F(h) (d + 1) / (2 pi) max(0, wo . r)^d / (max(cos_i, cos_o) N)     r: wi mirrored at the normal
//! N = max(g(cos_i), g(cos_o))
//! ```
//!
//! Where the cosines are alike that is F rho (d + 1) / (2 pi) cos^d about r. The greater cosine (Neumann et al. 1999) in place of cos_o makes f
//! symmetric and bounded. N gives back the part of the lobe that the horizon cuts: g(cos) is the share of the lobe about a direction of this
//! cosine that stays above the surface, and is fitted: the albedo is 1 towards the normal, at most 1.015 between, and falls to 0.8 (for d = 1: 0.87)
//! at the horizon.
//!
//! Differs from the paper in that: its lobe is cut and normalised for one of the directions only; then f is not symmetric, and
//! radiance towards the horizon has no bound.
//!
//! A [`Reflectance`](super::Reflectance) has such a lobe if its `alpha` is negative: it is then minus the exponent.

use std::f32::consts::TAU;

use glam::Vec3;

use super::{anisotropic, basis, reflect, table};

/// Least and greatest exponent.
pub const EXPONENTS: std::ops::RangeInclusive<f32> = 1.0..=1e4;

/// The exponent that an alpha stands for.
pub fn exponent_of(alpha: f32) -> Option<f32> {
    (alpha < 0.0).then_some(-alpha)
}

/// Alpha of a GGX lobe about as wide; of one of two widths their geometric mean.
pub fn width_of(alpha: f32) -> f32 {
    match alpha {
        alpha if alpha < 0.0 => (-0.5 / alpha).sqrt(),
        alpha if anisotropic::is_anisotropic(alpha) => anisotropic::width_of(alpha),
        alpha if table::is_table(alpha) => table::width_of(alpha),
        alpha => alpha,
    }
}

/// The lobe widened to at least the width of this alpha.
pub fn widened_alpha(alpha: f32, least: f32) -> f32 {
    match alpha {
        alpha if alpha < 0.0 => alpha.max(-0.5 / (least * least)),
        alpha if anisotropic::is_anisotropic(alpha) => anisotropic::widened(alpha, least),
        alpha if table::is_table(alpha) => table::widened(alpha, least),
        alpha => alpha.max(least),
    }
}

/// Density over solid angle of [`sample`] for unit directions above the surface.
pub fn pdf(n: Vec3, wi: Vec3, wo: Vec3, exponent: f32) -> f32 {
    // cos^d from the chord, |wi - r|^2 = 2 (1 - cos): near 1 the cosine itself has lost its digits.
    let one_minus_cos = 0.5 * wi.distance_squared(reflect(wo, n));
    if one_minus_cos >= 1.0 {
        return 0.0;
    }
    (exponent + 1.0) / TAU * (exponent * (-one_minus_cos).ln_1p()).exp()
}

/// f for F = 1 over the density: 1 / (max(cos_i, cos_o) N).
pub fn over_pdf(cos_i: f32, cos_o: f32, exponent: f32) -> f32 {
    1.0 / (cos_i.max(cos_o) * kept(cos_i, exponent).max(kept(cos_o, exponent)))
}

/// g: the share of the lobe about a direction of this cosine that is above the surface, and below the cosine's weight: 1/2 at the
/// horizon, (d + 1) / (d + 2) at the normal.
fn kept(cos: f32, exponent: f32) -> f32 {
    let sin = (1.0 - cos * cos).max(1e-8).sqrt();
    let x = cos / (sin * sin.sqrt()) * (exponent + 1.9) / exponent.sqrt();
    let h = x / (x + 0.8 + 1.7 * (-0.72 * x).exp());
    0.5 + (0.5 - 1.0 / (exponent + 2.0)) * h
}

/// A direction about the mirror direction of `wo`, which may lie below the surface.
pub fn sample(n: Vec3, wo: Vec3, exponent: f32, u: [f32; 2]) -> Vec3 {
    let r = reflect(wo, n);
    let (t, b) = basis(r);
    let cos = (1.0 - u[0]).powf(1.0 / (exponent + 1.0));
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let phi = TAU * u[1];
    t * (sin * phi.cos()) + b * (sin * phi.sin()) + r * cos
}

#[cfg(test)]
mod tests;
