//! The difference of two images.

use std::io::Cursor;
use std::path::Path;

use glam::Vec3;
use image::{ImageFormat, ImageReader};
use serde::Serialize;

use super::flip::flip;
use crate::error::{Error, Result};
use crate::input::Inputs;
use crate::scene::{openexr, srgb_to_linear};

/// Colours of an image file, linear Rec. 709, row by row from the top.
pub struct Picture {
    /// Width and height.
    pub size: [u32; 2],
    /// The pixels.
    pub color: Vec<Vec3>,
    /// Whether it is of radiance (EXR), and not for display.
    pub is_linear: bool,
}

impl Picture {
    /// Reads an EXR or a PNG file. Errors: [`Error::Io`], [`Error::File`].
    pub fn read(path: &Path) -> Result<Picture> {
        let inputs = Inputs::anywhere();
        let bytes = inputs.read(path)?;
        if openexr::is_one(&bytes) {
            let reserve = |bytes| inputs.take(path, bytes).map_err(|error| error.to_string());
            let pixels = openexr::decode(&bytes, &reserve).map_err(|message| Error::file(path, message))?;
            let color = pixels.values.iter().map(|[r, g, b, _]| Vec3::new(*r, *g, *b)).collect();
            return Ok(Picture { size: pixels.size, color, is_linear: true });
        }
        let wrong = |e: image::ImageError| {
            Error::file(path, format!("is neither an OpenEXR nor a PNG file that can be read: {e}"))
        };
        let reader = || ImageReader::with_format(Cursor::new(&bytes), ImageFormat::Png);
        let (width, height) = reader().into_dimensions().map_err(wrong)?;
        // Decoded, and as numbers.
        inputs.take(path, (u64::from(width) * u64::from(height)).saturating_mul(32))?;
        let image = reader().decode().map_err(wrong)?;
        let size = [image.width(), image.height()];
        let linear = |pixel: &image::Rgb<f32>| Vec3::from_array(pixel.0).map(srgb_to_linear);
        Ok(Picture { size, color: image.to_rgb32f().pixels().map(linear).collect(), is_linear: false })
    }
}

/// Measures of the difference of an image from a reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Width and height.
    pub resolution: [u32; 2],
    /// Root of the mean of (A - B)^2 / (B^2 + 0.01 m^2) over pixels and channels, in linear radiance; m is the mean of B.
    pub relative_rmse: f64,
    /// Sum of A over that of B; null if B is black.
    pub energy: Option<f64>,
    /// Mean of LDR-FLIP, of both images clipped at 0 and 1 after the exposure.
    pub flip: f64,
    /// Pixels of either image that are no numbers, which are left out.
    pub no_numbers: usize,
}

/// Compares A with the reference B after an exposure in stops, which concerns FLIP alone; returns FLIP of each pixel too. Errors: a message.
pub fn compare(a: &Picture, b: &Picture, stops: f32) -> Result<(Comparison, Vec<f32>), String> {
    if a.size != b.size {
        let [[w, h], [x, y]] = [a.size, b.size];
        return Err(format!("one image has {w}x{h} pixels and the other {x}x{y}; they must be of one size"));
    }
    let sound = |(a, b): &(&Vec3, &Vec3)| a.is_finite() && b.is_finite();
    let pairs = || a.color.iter().zip(&b.color).filter(sound);
    let count = pairs().count();
    let sum = |color: &Vec3| color.as_dvec3().element_sum();
    let [of_a, of_b] = pairs().fold([0.0; 2], |[x, y], (a, b)| [x + sum(a), y + sum(b)]);
    let values = 3.0 * count.max(1) as f64;
    let floor = 0.01 * (of_b / values).powi(2);
    let square = |a: f32, b: f32| {
        let (a, b) = (f64::from(a), f64::from(b));
        let weight = b * b + floor;
        if weight > 0.0 { (a - b).powi(2) / weight } else { f64::from(u8::from(a != b)) }
    };
    let squares: f64 = pairs().flat_map(|(a, b)| (0..3).map(move |c| square(a[c], b[c]))).sum();
    let scale = stops.exp2();
    let shown = |image: &Picture| -> Vec<Vec3> {
        image.color.iter().map(|color| if color.is_finite() { scale * *color } else { Vec3::ZERO }).collect()
    };
    let map = flip(&shown(b), &shown(a), a.size.map(|n| n as usize));
    let comparison = Comparison {
        resolution: a.size,
        relative_rmse: (squares / values).sqrt(),
        energy: (of_b != 0.0).then(|| of_a / of_b),
        flip: map.iter().map(|v| f64::from(*v)).sum::<f64>() / map.len().max(1) as f64,
        no_numbers: a.color.len() - count,
    };
    Ok((comparison, map))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(color: Vec<Vec3>) -> Picture {
        Picture { size: [color.len() as u32, 1], color, is_linear: true }
    }

    #[test]
    fn a_brighter_image_differs_by_its_factor() {
        let b = picture(vec![Vec3::splat(2.0); 6]);
        let a = picture(vec![Vec3::splat(3.0); 6]);
        let (found, map) = compare(&a, &b, -2.0).unwrap();
        // (1 / 2)^2 / (1 + 0.01).
        assert!((found.relative_rmse - (0.25_f64 / 1.01).sqrt()).abs() < 1e-9, "{found:?}");
        assert!((found.energy.unwrap() - 1.5).abs() < 1e-9 && found.flip > 0.05 && map.len() == 6, "{found:?}");
        // Both are white at that exposure.
        assert_eq!(compare(&a, &b, 0.0).unwrap().0.flip, 0.0);
        assert_eq!(compare(&b, &b, 0.0).unwrap().0.relative_rmse, 0.0);
    }

    #[test]
    fn pixels_that_are_no_numbers_are_counted_and_left_out() {
        let b = picture(vec![Vec3::ONE, Vec3::ONE]);
        let a = picture(vec![Vec3::splat(f32::NAN), Vec3::ONE]);
        let (found, _) = compare(&a, &b, 0.0).unwrap();
        assert_eq!((found.no_numbers, found.relative_rmse, found.energy), (1, 0.0, Some(1.0)));
        let black = picture(vec![Vec3::ZERO; 2]);
        assert_eq!(compare(&b, &black, 0.0).unwrap().0.energy, None);
        assert!(compare(&b, &picture(vec![Vec3::ONE]), 0.0).unwrap_err().contains("2x1"));
    }
}
