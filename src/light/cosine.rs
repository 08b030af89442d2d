//! Emission with a power of the cosine (Keller 1997, 4.2).
//!
//! A light of flux F and exponent d has the intensity
//!
//! ```text
//! I(t) = F (d + 1) / (2 pi) cos^d t      t: angle from the normal
//! ```
//!
//! so a surface of radiance L along its normal has radiance L cos^(d-1) t, exitance 2 pi L / (d + 1), and half of its greatest intensity
//! at arccos 2^(-1/d). d = 1 is Lambert. Directions: cos t = u^(1/(d+1)), phi = 2 pi v.
//!
//! Greater exponents are narrower: from [`MAX_EXPONENT`] on, where the half angle is 2.1 degrees, few lights would shine on few points
//! each, and an image would need thousands of passes.

use std::f32::consts::TAU;

use glam::Vec3;

use crate::bsdf::sample_diffuse;

/// Greatest exponent of a light.
pub const MAX_EXPONENT: f32 = 1000.0;

/// Power of a cosine that is not negative; exact for an exponent of 1.
pub fn power(cos: f32, exponent: f32) -> f32 {
    if exponent == 1.0 { cos } else { cos.max(1e-20).powf(exponent) }
}

/// Radiance at an angle over that along the normal, cos^(d-1).
pub fn falloff(cos: f32, exponent: f32) -> f32 {
    if exponent == 1.0 { 1.0 } else { power(cos, exponent - 1.0) }
}

/// Exitance over the radiance along the normal, 2 pi / (d + 1).
pub fn exitance(exponent: f32) -> f32 {
    TAU / (exponent + 1.0)
}

/// Exitance over that of Lambert's law, 2 / (d + 1).
pub fn flatness(exponent: f32) -> f32 {
    2.0 / (exponent + 1.0)
}

/// Intensity along the normal over that of Lambert's law for the same flux, (d + 1) / 2.
pub fn sharpness(exponent: f32) -> f32 {
    0.5 * exponent + 0.5
}

/// Direction about +z, distributed as the intensity.
pub fn sample(u: [f32; 2], exponent: f32) -> Vec3 {
    if exponent == 1.0 {
        return sample_diffuse(u);
    }
    let cos = (1.0 - u[0]).powf(1.0 / (exponent + 1.0));
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let phi = TAU * u[1];
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn the_flux_is_that_of_the_light_for_every_exponent() {
        for d in [1.0f32, 5.0, 50.0, MAX_EXPONENT] {
            // F = 2 pi int I sin t dt, I of flux 1.
            let n = 200_000;
            let step = PI / 2.0 / f64::from(n);
            let intensity = |t: f64| f64::from(sharpness(d)) / PI * f64::from(power(t.cos() as f32, d));
            let flux: f64 = (0..n).map(|i| (f64::from(i) + 0.5) * step).map(|t| intensity(t) * t.sin()).sum();
            assert!((TAU * flux * step - 1.0).abs() < 2e-4, "exponent {d}: {}", TAU * flux * step);
            assert!((exitance(d) - std::f32::consts::PI * flatness(d)).abs() < 1e-6);
            assert!((flatness(d) * sharpness(d) - 1.0).abs() < 1e-6);
            // Half the intensity at arccos 2^(-1/d).
            let half = 2f32.powf(-1.0 / d);
            assert!((power(half, d) - 0.5).abs() < 1e-3, "{}", power(half, d));
        }
        assert_eq!((power(0.3, 1.0), falloff(0.3, 1.0)), (0.3, 1.0));
        assert_eq!((exitance(1.0), flatness(1.0), sharpness(1.0)), (std::f32::consts::PI, 1.0, 1.0));
        assert_eq!(sample([0.3, 0.7], 1.0), sample_diffuse([0.3, 0.7]));
    }

    #[test]
    fn directions_are_distributed_as_the_intensity() {
        for d in [1.0f32, 5.0, 50.0] {
            // The share within an angle is 1 - cos^(d+1); half of it lies within arccos 2^(-1/(d+1)).
            let median = 0.5f32.powf(1.0 / (d + 1.0));
            let n = 64;
            let inside = (0..n * n)
                .map(|i| sample([i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32), d))
                .inspect(|w| assert!((w.length() - 1.0).abs() < 1e-5 && w.z >= 0.0))
                .filter(|w| w.z > median)
                .count();
            assert_eq!(inside, (n * n / 2) as usize, "exponent {d}");
        }
    }
}
