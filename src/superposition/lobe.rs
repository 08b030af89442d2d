//! Reflectance distributions of glossy lobes, without their Fresnel factor: the input of [`kernels`](super::kernels).
//!
//! Directions are unit vectors away from the surface, whose normal is +z. All lobes but [`Lobe::Anisotropic`] are isotropic.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;

pub use crate::bsdf::table::Table;
use crate::bsdf::{MIN_ALPHA, Reflectance, anisotropic, phong};

/// Maximum exponent of [`Lobe::Phong`]: the lobe is then as narrow as GGX with the minimum alpha.
pub const MAX_EXPONENT: f32 = 1e6;

/// A glossy lobe.
#[derive(Clone, Debug, PartialEq)]
pub enum Lobe {
    /// The renderer's own lobe ([`Reflectance::eval_specular`]) with F = 1.
    Ggx {
        /// Roughness, [`MIN_ALPHA`] to 1; the square of the perceptual roughness.
        alpha: f32,
    },
    /// The renderer's lobe of two widths ([`anisotropic`]) with F = 1.
    Anisotropic {
        /// The number that stands for it, about +z.
        alpha: f32,
    },
    /// A lobe of constant shape about the mirror direction r (thesis 7.4.2), in the form of Lafortune and Willems 1994, which is
    /// reciprocal and conserves energy: f = (n + 2) / (2 pi) (r.wi)^n.
    ///
    /// `Ns` of an MTL file is the exponent of the cosine at the half vector instead. The renderer reads it as GGX with
    /// alpha^2 = 2 / (Ns + 2); about the mirror direction, which turns twice as fast, its exponent is near Ns / 4.
    Phong {
        /// The exponent n, 1 to [`MAX_EXPONENT`].
        exponent: f32,
    },
    /// The renderer's other lobe ([`phong`]) with F = 1.
    Cosine {
        /// The exponent d, in [`phong::EXPONENTS`].
        exponent: f32,
    },
    /// The renderer's lobe by tabulated values with F = 1.
    Table(Arc<Table>),
}

impl Lobe {
    /// The same mirrored in the xz plane.
    pub(super) fn mirrored(&self) -> Lobe {
        let of = |alpha: f32| anisotropic::unpack(alpha, Vec3::Z).map(|grain| grain.along * Vec3::new(1.0, -1.0, 1.0));
        match *self {
            Lobe::Anisotropic { alpha } => Lobe::Anisotropic {
                alpha: of(alpha).map_or(alpha, |along| anisotropic::with_direction(alpha, along, Vec3::Z)),
            },
            ref other => other.clone(),
        }
    }

    /// Whether it is its own mirror image in the plane of incidence, from wherever it is seen.
    pub(super) fn is_isotropic(&self) -> bool {
        !matches!(self, Lobe::Anisotropic { .. })
    }

    /// f(wi, wo) in 1/sr; 0 if either direction is not above the surface.
    pub fn eval(&self, wi: Vec3, wo: Vec3) -> f32 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return 0.0;
        }
        match self {
            Lobe::Ggx { alpha } | Lobe::Anisotropic { alpha } => {
                let white = Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha: *alpha };
                white.eval_specular(&[], Vec3::Z, wi, wo).x
            }
            Lobe::Cosine { exponent } => {
                phong::pdf(Vec3::Z, wi, wo, *exponent) * phong::over_pdf(wi.z, wo.z, *exponent)
            }
            Lobe::Phong { exponent } => {
                // cos^n from the chord, |wi - r|^2 = 2 (1 - cos): near 1 the cosine itself has lost its digits.
                let mirror = Vec3::new(-wo.x, -wo.y, wo.z);
                let one_minus_cos = 0.5 * wi.distance_squared(mirror);
                if one_minus_cos >= 1.0 {
                    return 0.0;
                }
                (exponent + 2.0) / (2.0 * PI) * (exponent * (-one_minus_cos).ln_1p()).exp()
            }
            Lobe::Table(table) => table.eval(wi, wo),
        }
    }

    /// Checks the parameters; the error describes the problem.
    pub(super) fn check(&self) -> Result<(), String> {
        match self {
            Lobe::Ggx { alpha } if !(MIN_ALPHA..=1.0).contains(alpha) => {
                Err(format!("alpha of GGX is {alpha}; it must lie between {MIN_ALPHA} and 1"))
            }
            Lobe::Anisotropic { alpha } if !(alpha.is_finite() && anisotropic::is_anisotropic(*alpha)) => {
                Err(format!("{alpha} stands for no lobe of two widths"))
            }
            Lobe::Phong { exponent } if !(1.0..=MAX_EXPONENT).contains(exponent) => {
                Err(format!("the exponent of Phong is {exponent}; it must lie between 1 and {MAX_EXPONENT}"))
            }
            Lobe::Cosine { exponent } if !phong::EXPONENTS.contains(exponent) => {
                let (low, high) = phong::EXPONENTS.into_inner();
                Err(format!("the exponent of the cosine is {exponent}; it must lie between {low} and {high}"))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn direction(cos: f32, azimuth: f32) -> Vec3 {
        let sin = (1.0 - cos * cos).sqrt();
        Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
    }

    #[test]
    fn phong_is_reciprocal_and_narrow_where_it_should_be() {
        let lobe = Lobe::Phong { exponent: 40.0 };
        let (a, b) = (direction(0.8, 2.9), direction(0.7, 0.0));
        let expected = 42.0 / (2.0 * PI) * a.dot(Vec3::new(-b.x, -b.y, b.z)).powf(40.0);
        assert!((lobe.eval(a, b) / expected - 1.0).abs() < 1e-4);
        assert!((lobe.eval(b, a) / expected - 1.0).abs() < 1e-4);
        // Half its peak at cos^n = 1/2, even if 1 - cos is below the rounding of f32.
        let narrow = Lobe::Phong { exponent: MAX_EXPONENT };
        let half = (2.0 * std::f32::consts::LN_2 / MAX_EXPONENT).sqrt();
        let ratio = narrow.eval(Vec3::new(half.sin(), 0.0, half.cos()), Vec3::Z) / narrow.eval(Vec3::Z, Vec3::Z);
        assert!((ratio - 0.5).abs() < 1e-3, "{ratio}");
        assert_eq!(Lobe::Phong { exponent: 2.0 }.eval(direction(0.1, 0.0), direction(0.1, 0.0)), 0.0);
    }
}
