//! Decoding of texture files.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, ImageReader};

#[cfg(feature = "gltf")]
use super::ktx2::decode as decode_ktx2;
use super::texture::linear_to_srgb;
use super::{Texture, Wrap, openexr};
use crate::input::Inputs;

/// Reserves bytes of memory, or tells why not.
pub(super) type Reserve<'a> = &'a dyn Fn(u64) -> Result<(), String>;

/// Whether bytes are a KTX 2.0 file.
pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\xabKTX 20\xbb\r\n\x1a\n")
}

/// Stands for the decoder where it is not compiled.
#[cfg(not(feature = "gltf"))]
fn decode_ktx2(_: &[u8], _: Reserve) -> Result<(u32, u32, Vec<[u8; 4]>), String> {
    Err(String::from("this program was built without the feature gltf, which reads KTX 2.0 textures"))
}

/// Counts the memory of decoded texels, before it is taken where the decoder allows that.
fn count(inputs: &Inputs, name: &str, [width, height]: [u32; 2], texel: u64) -> Result<(), String> {
    inputs.take(Path::new(name), u64::from(width) * u64::from(height) * texel).map_err(|e| e.to_string())
}

impl Texture {
    /// Decodes a PNG, JPEG, TGA, BMP, WebP, KTX 2.0, OpenEXR or Radiance file; the error is the decoder's reason. Values of files of
    /// floats (OpenEXR, Radiance) are linear; they are cut to [0, 1], and the log says so where it matters.
    pub(super) fn decode(
        inputs: &Inputs,
        bytes: &[u8],
        name: String,
        srgb: bool,
        wrap: [Wrap; 2],
    ) -> Result<Texture, String> {
        let (texture, peak) = Texture::decode_with(inputs, bytes, name, srgb, wrap, false)?;
        if peak > 1.0 {
            log::warn!("{}: values above 1 are cut off: no surface reflects more than it receives", texture.name);
        }
        Ok(texture)
    }

    /// The same for radiance: values of files of floats are divided by the returned factor, the greatest of them if that is above
    /// 1, so that none is cut off.
    pub(super) fn decode_radiance(
        inputs: &Inputs,
        bytes: &[u8],
        name: String,
        wrap: [Wrap; 2],
    ) -> Result<(Texture, f32), String> {
        Texture::decode_with(inputs, bytes, name, true, wrap, true)
    }

    fn decode_with(
        inputs: &Inputs,
        bytes: &[u8],
        name: String,
        srgb: bool,
        wrap: [Wrap; 2],
        scaled: bool,
    ) -> Result<(Texture, f32), String> {
        let reserve = |bytes| inputs.take(Path::new(&name), bytes).map_err(|e| e.to_string());
        if is_ktx2(bytes) {
            let (width, height, texels) = decode_ktx2(bytes, &reserve)?;
            return Ok((Texture { name, width, height, texels, srgb, wrap }, 1.0));
        }
        let format = image::guess_format(bytes).ok().or_else(|| ImageFormat::from_path(&name).ok());
        let format = match format {
            Some(format) => format,
            None => image::guess_format(bytes).map_err(|e| e.to_string())?,
        };
        let (width, height, values) = if format == ImageFormat::OpenExr {
            let openexr::Pixels { size: [width, height], values } = openexr::decode(bytes, &reserve)?;
            (width, height, values.into_flattened())
        } else {
            let reader = || ImageReader::with_format(Cursor::new(bytes), format);
            let (width, height) = reader().into_dimensions().map_err(|e| e.to_string())?;
            // Of floats while it is converted.
            count(inputs, &name, [width, height], if format == ImageFormat::Hdr { 16 } else { 4 })?;
            let image = reader().decode().map_err(|e| e.to_string())?;
            let (width, height) = (image.width(), image.height());
            if !matches!(image, image::DynamicImage::ImageRgb32F(_) | image::DynamicImage::ImageRgba32F(_)) {
                let texels = image.into_rgba8().into_raw().chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]).collect();
                return Ok((Texture { name, width, height, texels, srgb, wrap }, 1.0));
            }
            (width, height, image.into_rgba32f().into_raw())
        };
        if let Some(at) = values.iter().position(|v| !v.is_finite() || *v < 0.0) {
            let (x, y) = (at / 4 % width as usize, at / 4 / width as usize);
            return Err(format!("the value {} of the texel ({x}, {y}) is negative or not a number", values[at]));
        }
        let peak = values.chunks_exact(4).flat_map(|t| &t[..3]).fold(1.0_f32, |most, &v| most.max(v));
        let divisor = if scaled { peak } else { 1.0 };
        let encoded = |v: f32| {
            let v = (v / divisor).clamp(0.0, 1.0);
            (255.0 * if srgb { linear_to_srgb(v) } else { v }).round() as u8
        };
        let alpha = |v: f32| (255.0 * v.min(1.0)).round() as u8;
        let texel = |t: &[f32]| [encoded(t[0]), encoded(t[1]), encoded(t[2]), alpha(t[3])];
        let texels = values.chunks_exact(4).map(texel).collect();
        Ok((Texture { name, width, height, texels, srgb, wrap }, peak))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn float_file(values: &[f32]) -> Vec<u8> {
        let pixels = image::Rgb32FImage::from_raw(values.len() as u32 / 3, 1, values.to_vec()).unwrap();
        let mut bytes = std::io::Cursor::new(Vec::new());
        pixels.write_to(&mut bytes, image::ImageFormat::OpenExr).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn floats_are_linear() {
        let bytes = float_file(&[0.5, 0.01, 1.0, 4.0, 0.25, 0.0]);
        let decode = |srgb| {
            Texture::decode(&Inputs::anywhere(), &bytes, String::from("t.exr"), srgb, [Wrap::Repeat; 2]).unwrap()
        };
        for (srgb, texture) in [(true, decode(true)), (false, decode(false))] {
            for (x, wanted) in [Vec3::new(0.5, 0.01, 1.0), Vec3::new(1.0, 0.25, 0.0)].into_iter().enumerate() {
                let got = texture.linear_texel(x as u32, 0).truncate();
                assert!((got - wanted).abs().max_element() < 0.5 / 255.0 * 2.3, "sRGB {srgb}: {got} of {wanted}");
            }
        }
        let (texture, factor) =
            Texture::decode_radiance(&Inputs::anywhere(), &bytes, String::from("t.exr"), [Wrap::Repeat; 2]).unwrap();
        assert_eq!(factor, 4.0);
        let got = factor * texture.linear_texel(1, 0).truncate();
        assert!((got - Vec3::new(4.0, 0.25, 0.0)).abs().max_element() < 0.01, "{got}");
        let got = factor * texture.linear_texel(0, 0).truncate();
        assert!((got - Vec3::new(0.5, 0.01, 1.0)).abs().max_element() < 0.01, "{got}");
    }

    #[test]
    fn wrong_floats_are_named() {
        for wrong in [f32::NAN, f32::INFINITY, -1.0] {
            let bytes = float_file(&[0.5, 0.5, 0.5, 0.5, wrong, 0.5]);
            let why = Texture::decode(&Inputs::anywhere(), &bytes, String::from("t.exr"), true, [Wrap::Repeat; 2])
                .unwrap_err();
            assert!(why.contains("texel (1, 0)"), "{why}");
        }
    }
}
