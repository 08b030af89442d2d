//! PNG for display: exposure, a tone curve, 8 bits for each channel.

#[cfg(feature = "images")]
use super::Layers;
#[cfg(feature = "images")]
use crate::error::{Error, Result};
use crate::scene::linear_to_srgb;
#[cfg(feature = "images")]
use crate::settings::Exposure;
use glam::{Mat3, Vec3};
#[cfg(feature = "images")]
use image::codecs::png::PngEncoder;
#[cfg(feature = "images")]
use image::{ExtendedColorType, ImageEncoder};
#[cfg(feature = "images")]
use rayon::prelude::*;
#[cfg(feature = "images")]
use std::path::Path;

/// Tone curve from radiance to displayed colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tonemap {
    /// Clipped at 1 and encoded by the sRGB curve: exact below 1, burnt out above.
    #[default]
    Srgb,
    /// Stephen Hill's fit of the ACES reference and output transforms, then the sRGB curve: film-like contrast.
    Aces,
    /// AgX by Troy Sobotka, in the polynomial approximation of Benjamin Wrensch: soft, highlights fade to white.
    Agx,
}

impl Tonemap {
    /// Display-encoded colour, each channel in [0, 1].
    pub fn apply(self, color: Vec3) -> Vec3 {
        // NaN becomes black; infinity becomes the maximum number, so that no curve computes inf / inf.
        let color = color.map(|c| if c > 0.0 { c.min(1e18) } else { 0.0 });
        match self {
            Tonemap::Srgb => color.map(srgb),
            Tonemap::Aces => aces(color).map(srgb),
            Tonemap::Agx => agx(color),
        }
    }
}

/// Encodes the colour layer as a file's bytes; `path` is for messages.
#[cfg(feature = "images")]
pub fn encode(path: &Path, layers: &Layers, exposure: Exposure, tonemap: Tonemap) -> Result<Vec<u8>> {
    let scale = exposure.stops(&layers.color).exp2();
    let pixel = |&radiance: &Vec3| (tonemap.apply(radiance * scale) * 255.0).round().to_array().map(|c| c as u8);
    let pixels: Vec<[u8; 3]> = layers.color.par_iter().map(pixel).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(pixels.as_flattened(), layers.width, layers.height, ExtendedColorType::Rgb8)
        .map_err(|e| Error::file(path, format!("encoding failed: {e}")))?;
    Ok(bytes)
}

/// The transfer function of IEC 61966-2-1 after clipping to [0, 1].
fn srgb(linear: f32) -> f32 {
    linear_to_srgb(linear.clamp(0.0, 1.0))
}

/// Stephen Hill's fit of RRT and ODT (2015): Rec. 709 to the saturated working space, a rational curve, and back.
fn aces(color: Vec3) -> Vec3 {
    // Rows of each published matrix are the columns here, and multiply from the right.
    let into = Mat3::from_cols(
        Vec3::new(0.59719, 0.35458, 0.04823),
        Vec3::new(0.07600, 0.90834, 0.01566),
        Vec3::new(0.02840, 0.13383, 0.83777),
    );
    let out = Mat3::from_cols(
        Vec3::new(1.60475, -0.53108, -0.07367),
        Vec3::new(-0.10208, 1.10813, -0.00605),
        Vec3::new(-0.00327, -0.07276, 1.07602),
    );
    let fit = |x: f32| (x * (x + 0.024_578_6) - 0.000_090_537) / (x * (0.983_729 * x + 0.432_951) + 0.238_081);
    out.transpose() * (into.transpose() * color).map(fit)
}

/// Wrensch, "Minimal AgX Implementation" (2023): inset, log2 of 16.5 stops, a polynomial of degree 6 instead of the
/// contrast table, outset. The result is display-encoded already.
fn agx(color: Vec3) -> Vec3 {
    let inset = Mat3::from_cols(
        Vec3::new(0.842_479_05, 0.042_328_242, 0.042_375_655),
        Vec3::new(0.078_433_6, 0.878_468_6, 0.078_433_6),
        Vec3::new(0.079_223_745, 0.079_166_13, 0.879_143),
    );
    let outset = Mat3::from_cols(
        Vec3::new(1.196_879, -0.052_896_85, -0.052_971_635),
        Vec3::new(-0.098_020_88, 1.151_903_1, -0.098_043_45),
        Vec3::new(-0.099_029_74, -0.098_961_18, 1.151_073_7),
    );
    const LOWEST: f32 = -12.473_93;
    const HIGHEST: f32 = 4.026_069;
    /// Coefficients from the constant term up.
    const CONTRAST: [f32; 7] = [-0.002_32, 0.119_1, 0.429_8, -6.868, 31.96, -40.14, 15.5];
    let curve = |c: f32| {
        // log2(0) is -inf, which the clamp takes to the lowest stop.
        let x = (c.log2().clamp(LOWEST, HIGHEST) - LOWEST) / (HIGHEST - LOWEST);
        CONTRAST.iter().rev().fold(0.0, |sum, a| sum * x + a)
    };
    (outset * (inset * color).map(curve)).clamp(Vec3::ZERO, Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::{Encoding, Metadata, write};

    fn close(a: Vec3, b: f32, tolerance: f32) -> bool {
        (a - Vec3::splat(b)).abs().max_element() <= tolerance
    }

    #[test]
    fn curves_take_known_values() {
        let grey = |tonemap: Tonemap, value: f32| tonemap.apply(Vec3::splat(value));
        assert!(close(grey(Tonemap::Srgb, 0.0), 0.0, 0.0));
        assert!(close(grey(Tonemap::Srgb, 0.18), 0.461_356, 1e-5));
        assert!(close(grey(Tonemap::Srgb, 0.002), 0.025_84, 1e-6));
        assert!(close(grey(Tonemap::Srgb, 7.0), 1.0, 1e-6));
        // 0.18 (0.18 + 0.0245786) - 0.000090537 over 0.18 (0.983729 * 0.18 + 0.432951) + 0.238081 is 0.105591; encoded.
        assert!(close(grey(Tonemap::Aces, 0.18), srgb(0.105_591), 1e-4));
        // Middle grey is 10 of 16.5 stops up; the polynomial gives 0.4967 there, where the exact curve gives 0.5.
        assert!(close(grey(Tonemap::Agx, 0.18), 0.4967, 2e-3));
    }

    #[test]
    fn curves_rise_and_stay_in_range_for_any_input() {
        for tonemap in [Tonemap::Srgb, Tonemap::Aces, Tonemap::Agx] {
            let mut last = -1.0;
            for step in 0..400 {
                let out = tonemap.apply(Vec3::splat((step as f32 * 0.1 - 20.0).exp2()));
                assert!(out.min_element() >= 0.0 && out.max_element() <= 1.0, "{tonemap:?}");
                assert!(out.x >= last - 2e-3, "{tonemap:?} falls at step {step}");
                last = out.x;
            }
            assert!(last > 0.98, "{tonemap:?}");
            for odd in [f32::NAN, f32::NEG_INFINITY, -1.0] {
                assert!(close(tonemap.apply(Vec3::splat(odd)), 0.0, 1e-3), "{tonemap:?} {odd}");
            }
            assert!(close(tonemap.apply(Vec3::splat(f32::INFINITY)), 1.0, 0.02), "{tonemap:?}");
        }
    }

    #[test]
    fn exposure_is_in_stops_and_pixels_come_back() {
        let layers = Layers {
            width: 2,
            height: 1,
            color: vec![Vec3::new(0.25, 0.5, 0.0), Vec3::splat(0.09)],
            ..Layers::default()
        };
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        write(
            &path,
            &layers,
            &Metadata::default(),
            &Encoding { exposure: Exposure::Stops(1.0), ..Encoding::default() },
        )
        .unwrap();
        let read = image::open(&path).unwrap().to_rgb8();
        assert_eq!(read.dimensions(), (2, 1));
        // sRGB of 0.5 is 0.7354, of 1 is 1, of 0.18 is 0.4614.
        assert_eq!(read.into_raw(), [188, 255, 0, 118, 118, 118]);
    }
}
