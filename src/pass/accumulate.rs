//! Adds the image of a pass to the running sums:
//! L = L_e + throughput (kd / pi * (E_direct + E_indirect) + L_specular). The throughput is that of the mirrors and
//! glass before the shading point (see `eye_paths`); L_e includes the light that `merge` added.
//!
//! The layers describe the shading point: its irradiance; its albedo times throughput (so that irradiance and albedo
//! multiply to the diffuse radiance); its normal; and its depth along the unfolded path through mirrors and glass,
//! which in a plane mirror is the depth of the mirror image. Coverage counts hits of the eye ray itself, so a mirror
//! that shows the background covers its pixel.
//!
//! Sums are exact ([`crate::film`]), so thousands of passes lose nothing to f32 and their order does not matter. Colour
//! has a sum for each of the two independent instances, from which [`crate::estimate`] tells the error. A pass that lost rays, or with a
//! value that is no number, is left out (see `schedule`, `finite`). Cost: 25 vec4 and 220 operations a pixel; where the third float of a sum changes 2 vec4 more.

use glam::{Vec3, Vec4};

use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints, groups};
use crate::error::Result;
use crate::film::{Film, GUIDE_UNIT};
use crate::gpu::{Recorder, shaders};
use crate::plan::INSTANCES;

/// The pass, one kernel for each instance.
pub struct Accumulate {
    instances: Vec<BoundKernel>,
    pixels: u32,
}

impl Accumulate {
    /// Adds to `film` unless the frame's status reports lost rays.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        paths: &EyePathState,
        lighting: &Lighting,
        film: &Film,
    ) -> Result<Self> {
        let (points, paths, lighting) = (points.resources(), paths.resources(), lighting.resources());
        let of_instance = |i| kit.bind(&shaders::ACCUMULATE, &[&points, &paths, &lighting, &film.as_sums(i)]);
        Ok(Accumulate { instances: (0..INSTANCES).map(of_instance).collect::<Result<_>>()?, pixels: film.pixels() })
    }

    /// Records the pass for an instance.
    pub fn record(&self, rec: &mut Recorder, instance: u32) -> Result<()> {
        self.instances[instance as usize].run(rec, &[], groups(self.pixels))
    }
}

/// Oracle: a sum of radiance plus one more addend.
pub fn sum_with([high, middle, low]: [Vec4; 3], x: Vec4) -> [Vec4; 3] {
    let (high, error) = two_sum(high, x);
    let (middle, error) = two_sum(middle, error);
    [high, middle, low + error]
}

/// Oracle: a sum of guides plus one more addend, rounded to [`GUIDE_UNIT`]; zero if it is no number.
pub fn sum_of_guides([sum, rest]: [Vec4; 2], x: Vec3) -> [Vec4; 2] {
    let x = if super::finite::reference(&x.to_array()) { x } else { Vec3::ZERO };
    // Shaders round halves to even.
    let rounded = Vec3::from_array((x / GUIDE_UNIT).to_array().map(f32::round_ties_even)) * GUIDE_UNIT;
    let (sum, error) = two_sum(sum, rounded.extend(0.0));
    if error == Vec4::ZERO {
        return [sum, rest];
    }
    let (sum, rest) = two_sum(sum, rest + error);
    [sum, rest]
}

fn two_sum(a: Vec4, b: Vec4) -> (Vec4, Vec4) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

/// Oracle: the radiance of a pixel.
pub fn reference(emitted: Vec3, throughput: Vec3, kd: Vec3, sums: [Vec3; 3]) -> Vec3 {
    emitted + throughput * (kd * std::f32::consts::FRAC_1_PI * (sums[0] + sums[1]) + sums[2])
}
