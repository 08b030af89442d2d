//! Counts the pixels whose values are no numbers: NaN, infinite, or so large that sums of passes would become infinite.
//!
//! It looks at the light that [`accumulate`](super::accumulate) and [`summands`](super::summands) are about to add, and adds to
//! `status[1]` the number of pixels where any of it is not below [`LIMIT`] in magnitude; `status[2]` becomes 1 + the last of them. The
//! passes that add to the film then leave the whole pass out, as one that lost rays: an image never has such a value, nor a pass of which
//! only a part is a number.
//!
//! The light of second components, which [`summands`](super::summands) adds itself, is looked at apart. What [`lens`](super::lens) adds
//! later is a mean of checked values. Albedos and normals that are no numbers count as zero in their sums. Cost: 7 vec4 and 60
//! operations a pixel, 1 vec4 more with summands.

use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Values from here on are no numbers of an image: sums over 2^27 passes of lower ones are finite.
pub const LIMIT: f32 = 1.267_650_6e30;

/// The pass.
pub struct Finite {
    kernel: BoundKernel,
    pixels: u32,
}

impl Finite {
    /// `summands`: light of second components that is not in the points' emission yet.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        paths: &EyePathState,
        lighting: &Lighting,
        summands: Option<&Buffer>,
        pixels: u32,
    ) -> Result<Self> {
        let (points, paths, lighting) = (points.resources(), paths.resources(), lighting.resources());
        let kernel = match summands {
            None => kit.bind(&shaders::FINITE, &[&points, &paths, &lighting])?,
            Some(shown) => {
                let own = Resources::of([("shown", shown)]);
                kit.bind(&shaders::FINITE_SUMMANDS, &[&points, &paths, &lighting, &own])?
            }
        };
        Ok(Finite { kernel, pixels })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}

/// Oracle: whether all values that a pass adds to a pixel are numbers.
pub fn reference(values: &[f32]) -> bool {
    // NaN is not below anything.
    values.iter().all(|value| value.abs() < LIMIT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_values_that_sums_hold_are_numbers() {
        assert_eq!((LIMIT, LIMIT.to_bits()), (2f32.powi(100), 0x7180_0000));
        assert!((LIMIT * 2f32.powi(27)).is_finite() && !(LIMIT * 2f32.powi(28)).is_finite());
        assert!(reference(&[0.0, -0.0, 1e-45, -1e30, f32::MAX * 1e-9]));
        for value in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, LIMIT, -LIMIT, f32::MAX] {
            assert!(!reference(&[0.0, value, 0.0]), "{value}");
        }
    }
}
