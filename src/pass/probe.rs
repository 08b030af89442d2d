//! Copies an instance's sums of radiance at a few pixels to a small buffer, which the host reads back after each pass to
//! estimate the error (see [`crate::estimate`]): (sum, rest + tail), which add up to the sum within the precision of a
//! double; and of what the filter added in passes of all instances the sum, w: the part of it that is bias (see [`gain`](super::gain)).
//!
//! The pixels are at random places of equal stretches of the image, so that they follow neither the pattern of
//! interleaved sampling nor the tiles. Cost: 57 vec4 and 350 operations for each of at most [`MAX_PIXELS`] pixels.

use glam::Vec4;

use super::{BoundKernel, Kit, groups};
use crate::error::Result;
use crate::film::Film;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::plan::INSTANCES;
use crate::sampling::random::hash;

/// Maximum number of pixels. Images of at most this many are copied whole.
pub const MAX_PIXELS: u32 = 4096;

/// The pass, one kernel for each instance.
pub struct Probe {
    /// Three vec4 for each pixel.
    pub out: Buffer,
    instances: Vec<BoundKernel>,
    count: u32,
}

impl Probe {
    /// Copies from `film`.
    pub fn new(kit: &Kit, film: &Film) -> Result<Self> {
        let pixels = pixels(film.pixels());
        let count = pixels.len() as u32;
        let out = kit.vec4s("probe", 3 * count)?;
        let own = Resources::of([("probed", &kit.stage("probed pixels", &pixels)?), ("probe", &out)]);
        let of_instance = |i| kit.bind(&shaders::PROBE, &[&own, &film.as_sums(i)]);
        Ok(Probe { instances: (0..INSTANCES).map(of_instance).collect::<Result<_>>()?, out, count })
    }

    /// Records the pass for an instance.
    pub fn record(&self, rec: &mut Recorder, instance: u32) -> Result<()> {
        self.instances[instance as usize].run(rec, &[], groups(self.count))
    }
}

/// The pixels that are copied from a film of `count` pixels, in ascending order.
pub fn pixels(count: u32) -> Vec<u32> {
    let probes = count.min(MAX_PIXELS);
    let start = |i: u32| (u64::from(count) * u64::from(i) / u64::from(probes)) as u32;
    (0..probes).map(|i| start(i) + hash(i) % (start(i + 1) - start(i))).collect()
}

/// Oracle: what is copied of a sum, of the two upper levels of the filter's gain, and of the part of that which is bias.
pub fn reference([sum, rest, tail]: [Vec4; 3], gain: [Vec4; 2], share: f32) -> [Vec4; 3] {
    [sum, rest + tail, (gain[0] + gain[1]).truncate().extend(share)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_images_are_copied_whole() {
        assert!(pixels(0).is_empty());
        assert_eq!(pixels(5), [0, 1, 2, 3, 4]);
        assert_eq!(pixels(MAX_PIXELS), (0..MAX_PIXELS).collect::<Vec<_>>());
    }

    #[test]
    fn pixels_are_spread_over_the_image_and_over_the_classes() {
        for [width, height] in [[640, 480], [4096, 4096], [97, 61]] {
            let found = pixels(width * height);
            assert_eq!(found.len(), MAX_PIXELS as usize);
            assert!(found.is_sorted_by(|a, b| a < b) && found.iter().all(|&i| i < width * height));
            // Columns and rows modulo the sizes of patterns and tiles: within five standard deviations.
            for modulus in [2, 3, 8] {
                let mut counts = vec![0; (modulus * modulus) as usize];
                found.iter().for_each(|&i| counts[(i % width % modulus + i / width % modulus * modulus) as usize] += 1);
                let mean = f64::from(MAX_PIXELS) / f64::from(modulus * modulus);
                let far = |&count: &i32| (f64::from(count) - mean).abs() > 5.0 * mean.sqrt();
                assert!(!counts.iter().any(far), "{width}x{height} modulo {modulus}: {counts:?}");
            }
        }
    }
}
