//! Puts the image of a step into a ring of images, in place of the oldest (Keller 1997, 4.3), and keeps the sum of the ring:
//!
//! ```text
//! S += new - old
//! ```
//!
//! S is the colour of the film's first instance, and the number of images in the ring its count, so the mean of the film is that of the
//! ring. Its other layers are those of the latest step.
//!
//! A pixel of an image has 64 bits, as many as four half floats: mantissas of 16 bits for three channels, their common exponent, and
//! coverage in 128ths. It has the range of a float, and its error is at most 2^-16 of its brightest channel; half floats overflow beside
//! bright lamps. S is a sum in three floats ([`crate::film`]) and what is added is what will be taken away, so S is exact as long as the
//! pixels of a ring span at most 2^72: after any number of steps it equals a fresh sum, and what is gone leaves nothing.
//!
//! Differs from the paper in that: images are summed as they come and go, not all N anew in each step.
//!
//! A step that lost rays, or with a value that is no number, is left out, and the oldest image stays. Cost: 21 vec4 and 220 operations a
//! pixel, whatever the length of the ring.

use glam::{Vec3, Vec4};

use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints, groups, push};
use crate::error::Result;
use crate::film::{Film, RingImages};
use crate::gpu::{Recorder, Resources, shaders};

/// The pass: one pair of kernels for each buffer of images.
pub struct Ring {
    buffers: Vec<[BoundKernel; 2]>,
    each: u32,
    length: u32,
    pixels: u32,
}

impl Ring {
    /// Keeps images in the ring of `film` unless the frame's status reports lost rays.
    pub fn new(
        kit: &Kit,
        (points, paths, lighting): (&ShadingPoints, &EyePathState, &Lighting),
        film: &Film,
        ring: &RingImages,
    ) -> Result<Ring> {
        let sets = [points.resources(), paths.resources(), lighting.resources(), film.as_sums(0)];
        let of_buffer = |buffer| {
            let own = Resources::of([("ring", buffer)]);
            let all = [&sets[0], &sets[1], &sets[2], &sets[3], &own];
            Ok([kit.bind(&shaders::RING_COUNT, &all)?, kit.bind(&shaders::RING, &all)?])
        };
        let buffers = ring.buffers.iter().map(of_buffer).collect::<Result<_>>()?;
        Ok(Ring { buffers, each: ring.each, length: ring.length, pixels: film.pixels() })
    }

    /// Records the pass for a step, by its number.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        let image = step % self.length;
        let [count, add] = &self.buffers[(image / self.each) as usize];
        count.run(rec, &push(image % self.each), 1)?;
        add.run(rec, &push(image % self.each), groups(self.pixels))
    }
}

/// Oracle: a pixel of an image, radiance and coverage, in 64 bits.
pub fn encoded(v: Vec4) -> [u32; 2] {
    let c = v.truncate().max(Vec3::ZERO);
    let exponent = (c.max_element().to_bits() >> 23).max(16) - 15;
    let per_unit = f32::from_bits((254 - exponent) << 23);
    let [x, y, z] = (c * per_unit).to_array().map(|m| (m.round_ties_even() as u32).min(65535));
    let covered = (v.w.clamp(0.0, 1.0) * 128.0).round_ties_even() as u32;
    [x | y << 16, z | covered << 16 | exponent << 24]
}

/// Oracle: the pixel that these bits stand for; zero: none yet.
pub fn decoded([low, high]: [u32; 2]) -> Vec4 {
    let unit = f32::from_bits((high >> 24) << 23);
    let m = [low & 0xffff, low >> 16, high & 0xffff].map(|m| m as f32 * unit);
    Vec3::from_array(m).extend((high >> 16 & 0xff) as f32 / 128.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_keep_their_value_within_the_stated_error() {
        for scale in [1e-30f32, 1e-6, 0.3, 1.0, 17.0, 65_504.0, 1e9, 1e29] {
            for c in [Vec3::new(1.0, 0.5, 0.25), Vec3::new(0.9999, 1e-4, 0.0), Vec3::new(0.0, 0.7, 0.99999)] {
                let v = (scale * c).extend(0.75);
                let kept = decoded(encoded(v));
                let error = (kept - v).truncate().abs().max_element();
                assert!(error <= scale * c.max_element() / 65536.0, "{v}: {kept}");
                assert_eq!(kept.w, 0.75);
                assert_eq!(encoded(kept), encoded(v), "what is kept stays as it is");
            }
        }
        assert_eq!(decoded([0, 0]), Vec4::ZERO);
        assert_eq!(decoded(encoded(Vec4::ZERO)), Vec4::ZERO);
        assert_ne!(encoded(Vec4::ZERO)[1] >> 24, 0, "a black image is an image");
        assert_eq!(decoded(encoded(Vec4::new(-1.0, 2.0, 0.0, 1.5))), Vec4::new(0.0, 2.0, 0.0, 1.0));
    }
}
