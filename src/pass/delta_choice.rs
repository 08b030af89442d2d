//! Chooses the lights without area that light a pass, where a scene has more than
//! [`crate::settings::Settings::delta_lights`] of them (Wald et al. 2002, 5.1.4). Point, spot, parallel
//! and imported lights are used directly and not through particles, so without this pass a hall with hundreds of lamps
//! needs hundreds of shadow rays for each shading point.
//!
//! N of n lights are chosen in proportion to weights w: the probabilities by which particles start from them,
//! proportional to power or, after [`super::importance`], to their estimated contribution to the image, mixed with a
//! fraction by power. No light is chosen twice: lights whose probability would exceed 1 are always chosen, and the
//! other lights share the remaining slots,
//!
//! ```text
//! pi(i) = min(1, s w(i)),   sum of pi = N,   I of a chosen light = I(i) / pi(i)
//! ```
//!
//! Sixteen rounds of s = (N - lights at 1) / sum of the other w determine s, reduced by a thousandth for rounding; so
//! the sum is slightly below N (more so if sixteen rounds do not suffice), and the last slot is sometimes empty. The
//! pi form consecutive intervals on a line of length N, and the lights are chosen whose intervals contain one of the
//! points u, u + 1, ... (systematic sampling). u starts at random and advances by the golden ratio from pass to pass
//! and by 1 / K from one of the K classes of pixels to the next, so that a filter over all classes sees the K N
//! points of a finer set.
//!
//! pi and u are multiples of 2^-20, pi at least 2^-20 for every light, and the weight is computed from the rounded pi:
//! the mean over u is exactly the sum over all lights, however pi is rounded.
//!
//! `mirror_lights` chooses by the same scheme (`shaders/include/systematic.wgsl`).
//!
//! Parallel lights come first, so that only as many slots as there are parallel lights can hold one: clusters cannot
//! take those slots.
//!
//! Differs from the paper in that: the paper does not say how it chooses lights.
//! Cost: a workgroup for each class, 18 rounds of some 10 operations a light.

use super::layout::{FrameParameters, PointLight};
use super::{BoundKernel, Kit};
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Resources, Staging, shaders};
use crate::sampling::dimensions::DELTA;
use crate::sampling::random::{hash, key};

/// Maximum number of lights to choose from: the eighteen runs of a lane stay within the loop budget.
pub const MAX_CANDIDATES: usize = 1 << 17;

/// Probability 1.
pub const ONE: u32 = 1 << 20;

/// The lights to choose from, parallel ones first.
pub struct Candidates {
    /// The lights.
    pub lights: Vec<PointLight>,
    /// The emitter of each.
    pub emitters: Vec<u32>,
}

impl Candidates {
    /// Orders the lights and their emitters, parallel lights first.
    pub fn new(lights: &[PointLight], emitters: &[u32]) -> Candidates {
        let mut both: Vec<_> = lights.iter().copied().zip(emitters.iter().copied()).collect();
        both.sort_by_key(|(light, _)| light.flags() & PointLight::DIRECTIONAL == 0);
        let (lights, emitters) = both.into_iter().unzip();
        Candidates { lights, emitters }
    }
}

/// The pass.
pub struct DeltaChoice {
    kernel: BoundKernel,
    lights: Buffer,
    emitters: Buffer,
    classes: u32,
}

impl DeltaChoice {
    /// Chooses among the candidates by the probabilities of their `emitters`. Writes the first slots of each class of
    /// `lights`.
    pub fn new(kit: &Kit, candidates: &Candidates, emitters: &Buffer, lights: &Buffer, classes: u32) -> Result<Self> {
        let all = kit.stage("lights to choose from", &candidates.lights)?;
        let of_candidates = kit.stage("emitters to choose from", &candidates.emitters)?;
        let own = Resources::of([
            ("emitters", emitters),
            ("candidates", &all),
            ("candidate_emitters", &of_candidates),
            ("lights", lights),
        ]);
        let kernel = kit.bind(&shaders::DELTA_CHOICE, &[&own])?;
        Ok(DeltaChoice { kernel, lights: all, emitters: of_candidates, classes })
    }

    /// Stages changed lights; their number must not change.
    pub fn stage(&self, context: &Context, staging: &mut Staging, candidates: &Candidates) -> Result<()> {
        staging.stage_into(context, &self.lights, 0, &candidates.lights)?;
        staging.stage_into(context, &self.emitters, 0, &candidates.emitters)
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], u64::from(self.classes))
    }
}

/// Oracle: the probability pi of each light, from the weights.
pub fn reference(weights: &[f64], slots: u32) -> Vec<f64> {
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
    let mut pi = vec![0.0; weights.len()];
    let (mut room, mut rest) = (f64::from(slots), weights.iter().sum::<f64>());
    // In descending order: a light whose probability would exceed 1 gets 1, and the remaining slots go to the others.
    for i in order {
        pi[i] = (room * weights[i] / rest.max(1e-300)).min(1.0);
        if pi[i] < 1.0 {
            // The remaining lights share this room and rest.
            continue;
        }
        room -= 1.0;
        rest -= weights[i];
    }
    pi
}

/// Oracle: the first point of a pass and class, in units of 1 / [`ONE`].
pub fn offset(frame: &FrameParameters, class: u32) -> u32 {
    let start = hash(key(frame.keys[1], DELTA, 0, 0));
    let of_pass = start.wrapping_add(frame.size[3].wrapping_mul(0x9e37_79b9));
    of_pass.wrapping_add(class.wrapping_mul(u32::MAX / frame.pattern[2])) >> 12
}

/// Oracle: the light in each slot, from the intervals of all lights in units of 1 / [`ONE`].
pub fn chosen(shares: &[u32], slots: u32, offset: u32) -> Vec<Option<usize>> {
    let mut ends = Vec::with_capacity(shares.len());
    let mut sum = 0u64;
    for &share in shares {
        sum += u64::from(share);
        ends.push(sum);
    }
    (0..u64::from(slots))
        .map(|slot| {
            let point = slot * u64::from(ONE) + u64::from(offset);
            (point < sum).then(|| ends.partition_point(|&end| end <= point))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_by_hand() {
        assert_eq!(reference(&[1.0, 1.0, 1.0, 1.0], 2), [0.5; 4]);
        // One of them is certain; the others share the second slot.
        assert_eq!(reference(&[1.0, 6.0, 1.0], 2), [0.5, 1.0, 0.5]);
        // Without the brightest light the second one is certain as well.
        assert_eq!(reference(&[100.0, 10.0, 1.0, 1.0, 2.0], 3), [1.0, 1.0, 0.25, 0.25, 0.5]);
        assert_eq!(reference(&[0.0, 0.0], 1), [0.0, 0.0]);
    }

    #[test]
    fn points_choose_the_lights_that_hold_them() {
        let half = ONE / 2;
        let shares = [half, half, ONE, half, half];
        assert_eq!(chosen(&shares, 3, 0), [Some(0), Some(2), Some(3)]);
        assert_eq!(chosen(&shares, 3, half - 1), [Some(0), Some(2), Some(3)]);
        assert_eq!(chosen(&shares, 3, half), [Some(1), Some(2), Some(4)]);
        assert_eq!(chosen(&[0, 1], 1, 0), [Some(1)]);
        assert_eq!(chosen(&[0, 1], 1, 1), [None]);
    }

    #[test]
    fn every_light_is_chosen_as_often_as_its_share_says() {
        let shares = [3, 0, ONE, ONE / 3, 2 * ONE / 3 + 7, 12_345];
        let slots = shares.iter().sum::<u32>().div_ceil(ONE);
        let mut times = [0; 6];
        for offset in 0..ONE {
            for light in chosen(&shares, slots, offset).into_iter().flatten() {
                times[light] += 1;
            }
        }
        assert_eq!(times, shares);
    }
}
