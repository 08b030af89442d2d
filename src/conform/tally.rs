//! Comparisons of what a kernel wrote with what its oracle says.

use glam::Vec3;

use super::findings;
use super::rig::{Rig, same_hit};
use crate::accel::{Hit, Ray};
use crate::pass::trace;

/// Whether two vectors agree within `relative` of the larger one, or within `absolute`. NaN agrees with nothing.
pub fn close(a: Vec3, b: Vec3, relative: f32, absolute: f32) -> bool {
    let size = a.abs().max_element().max(b.abs().max_element());
    let (error, bound) = ((a - b).abs(), absolute + relative * size);
    let holds = error.cmple(Vec3::splat(bound)).all();
    if holds {
        findings::error(error.max_element(), bound);
    }
    holds
}

/// Whether the magnitude of an error is within its bound.
pub fn within(error: impl Into<f64>, bound: impl Into<f64>) -> bool {
    let (error, bound) = (error.into().abs(), bound.into());
    let holds = error <= bound;
    if holds {
        findings::error(error as f32, bound as f32);
    }
    holds
}

/// Maximum fraction of comparisons that rounding may decide otherwise: at an edge, a horizon, or the threshold of a
/// random choice. On lavapipe none is, on SwiftShader one of 2046 at most.
pub const STRAYS: f64 = 0.001;

/// How much larger than the largest expected value of its kind a found value may be where a comparison fails.
const OUTLIER: f32 = 2.0;

/// Most comparisons that may fail, however many there are.
const MOST: usize = 6;

/// Counts comparisons. One in a thousand may fail where rounding decides (a ray through an edge, a random number at a
/// threshold), of small numbers none. Even there, what was found must be plausible: no NaN, no infinity, no value much
/// larger than all expected ones, no hit off its ray.
pub struct Tally {
    what: String,
    compared: usize,
    failures: Vec<String>,
    /// The largest component of each kind of values that was expected, and that was found where a comparison failed.
    sizes: Vec<[f32; 2]>,
}

impl Tally {
    pub fn new(what: impl Into<String>) -> Tally {
        Tally { what: what.into(), compared: 0, failures: Vec::new(), sizes: Vec::new() }
    }

    pub fn check(&mut self, holds: bool, say: impl FnOnce() -> String) {
        self.compared += 1;
        if !holds {
            self.failures.push(say());
        }
    }

    /// Like [`Tally::check`], for pairs of a found and an expected value, whose place tells their kind: found values
    /// stay plausible whether or not the comparison holds.
    pub fn check_values(&mut self, holds: bool, values: &[(Vec3, Vec3)], say: impl FnOnce() -> String) {
        let kinds = self.sizes.len().max(values.len());
        self.sizes.resize(kinds, [0.0; 2]);
        for ([largest, outlier], (found, expected)) in self.sizes.iter_mut().zip(values) {
            *largest = largest.max(expected.abs().max_element());
            if !holds {
                assert!(found.is_finite(), "{}: {}", self.what, say());
                *outlier = outlier.max(found.abs().max_element());
            }
        }
        self.check(holds, say);
    }

    /// Compares the hit of a ray with the closest one. A hit that differs lies on the ray and in its triangle.
    pub fn check_hit(&mut self, rig: &Rig, ray: &Ray, hit: Option<Hit>, say: impl FnOnce() -> String) {
        let bvh = rig.bvh();
        let holds = same_hit(hit, trace::reference(rig.scene, bvh, ray, rig.parameters.keys[0]));
        if !holds && let Some(hit) = hit {
            let off = (bvh.position(&hit) - ray.origin - ray.direction * hit.t).length();
            let inside = hit.u >= -1e-3 && hit.v >= -1e-3 && hit.u + hit.v <= 1.0 + 2e-3;
            let reached = hit.t >= 0.0 && hit.t <= ray.t_max && off <= 1e-3 * bvh.diagonal();
            assert!(inside && reached, "{}: {hit:?} is off its ray by {off}: {}", self.what, say());
        }
        self.check(holds, say);
    }

    /// Fails if more than the fraction `share` of the comparisons failed, or one of them by too much.
    pub fn finish(self, share: f64) {
        let (failed, allowed) = (self.failures.len(), ((self.compared as f64 * share) as usize).min(MOST));
        findings::compared(self.compared, failed);
        if failed > 0 {
            log::info!("{}: {failed} of {} differ", self.what, self.compared);
        }
        let is_wild =
            |words: &&String| words.split(|c: char| !c.is_alphanumeric()).any(|word| matches!(word, "NaN" | "inf"));
        if let Some(failure) = self.failures.iter().find(is_wild) {
            panic!("{}: {failure}", self.what);
        }
        let shown = self.failures[..failed.min(5)].join("\n");
        assert!(failed <= allowed, "{}: {failed} of {} differ, {allowed} may:\n{shown}", self.what, self.compared);
        for (kind, [largest, outlier]) in self.sizes.iter().enumerate() {
            assert!(
                *outlier <= OUTLIER * largest,
                "{}: value {kind} reaches {outlier}, {largest} at most is expected:\n{shown}",
                self.what
            );
        }
    }
}
