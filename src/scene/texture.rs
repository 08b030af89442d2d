//! Textures: decoding and averages.

use glam::{Vec3, Vec4};

use super::{Texture, Wrap, ktx2};

impl Texture {
    /// Decodes a PNG, JPEG, TGA, BMP, WebP or KTX 2.0 file; the error is the decoder's reason.
    pub(super) fn decode(bytes: &[u8], name: String, srgb: bool, wrap: [Wrap; 2]) -> Result<Texture, String> {
        if ktx2::is_ktx2(bytes) {
            let (width, height, texels) = ktx2::decode(bytes)?;
            return Ok(Texture { name, width, height, texels, srgb, wrap });
        }
        let format = image::guess_format(bytes).ok().or_else(|| image::ImageFormat::from_path(&name).ok());
        let decoded = match format {
            Some(format) => image::load_from_memory_with_format(bytes, format),
            None => image::load_from_memory(bytes),
        };
        let image = decoded.map_err(|e| e.to_string())?.into_rgba8();
        let (width, height) = image.dimensions();
        let texels = image.into_raw().chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]).collect();
        Ok(Texture { name, width, height, texels, srgb, wrap })
    }

    /// Mean of the linear colour over all texels.
    pub fn average(&self) -> Vec3 {
        // Integer histograms keep the sum exact and free of order.
        let mut counts = [[0u64; 256]; 3];
        for texel in &self.texels {
            for (channel, &value) in counts.iter_mut().zip(texel) {
                channel[usize::from(value)] += 1;
            }
        }
        let total = self.texels.len().max(1) as f64;
        let mean = |counts: &[u64; 256]| -> f32 {
            let sum: f64 = (0u8..=255).zip(counts).map(|(v, &n)| n as f64 * f64::from(self.decode_channel(v))).sum();
            (sum / total) as f32
        };
        Vec3::new(mean(&counts[0]), mean(&counts[1]), mean(&counts[2]))
    }

    /// Linear value of a texel at integer coordinates inside the texture (alpha is stored linearly).
    pub fn linear_texel(&self, x: u32, y: u32) -> Vec4 {
        let [r, g, b, a] = self.texels[y as usize * self.width as usize + x as usize];
        Vec4::new(self.decode_channel(r), self.decode_channel(g), self.decode_channel(b), f32::from(a) / 255.0)
    }

    fn decode_channel(&self, value: u8) -> f32 {
        let x = f32::from(value) / 255.0;
        if self.srgb { srgb_to_linear(x) } else { x }
    }
}

/// Linear value of an sRGB-encoded value (IEC 61966-2-1).
pub fn srgb_to_linear(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn average_is_linear() {
        let mut texture = Texture {
            name: String::from("t"),
            width: 2,
            height: 1,
            texels: vec![[0, 255, 188, 255], [255, 255, 188, 255]],
            srgb: true,
            wrap: [Wrap::Repeat; 2],
        };
        let average = texture.average();
        assert!((average - Vec3::new(0.5, 1.0, 0.5029)).abs().max_element() < 1e-4, "{average}");
        texture.srgb = false;
        assert!((texture.average().z - 188.0 / 255.0).abs() < 1e-6);
        assert_eq!(texture.linear_texel(1, 0).x, 1.0);
    }
}
