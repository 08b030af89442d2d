//! Weights by which photons start from virtual lights: about the flux that a light sends to all targets,
//!
//! ```text
//! w_l = (I_l + gloss) sum_t w_t       I_l: its mean intensity along its normal; gloss: mean flux times f0 / pi of a lobe
//! ```
//!
//! with the weights w_t of [`crate::light::targets`] seen from the light. A photon of a class starts from light l of the class with the
//! probability w_l / sum w, so that all photons carry about the same flux; with equal probabilities those from lights beside a mirror
//! carried hundreds of times more than the others, and showed as spots.
//!
//! Cost: for each light a visit of every target (at most 64), some 40 operations each; then two sums over the lights of a class.

use super::layout::{FrameParameters, PointLight};
use super::{BoundKernel, Kit, groups};
use crate::bsdf::mean;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::light::targets::Targets;
use glam::Vec3;

/// The pass.
pub struct PhotonLights {
    weigh: BoundKernel,
    sum: BoundKernel,
    lights: u32,
    classes: u32,
    /// For each light after reflections the sum of the weights of its class up to it, at its place among all lights.
    pub sums: Buffer,
}

impl PhotonLights {
    /// For `lights` of so many classes.
    pub fn new(kit: &Kit, lights: &Buffer, classes: u32) -> Result<Self> {
        let count = (lights.bytes() / size_of::<PointLight>() as u64) as u32;
        let sums = kit.array("sums of the weights of lights", count, 4)?;
        let own = Resources::of([("lights", lights), ("light_sums", &sums)]);
        let bind = |shader| kit.bind(shader, &[&own]);
        let [weigh, sum] = [bind(&shaders::PHOTON_LIGHTS)?, bind(&shaders::PHOTON_LIGHTS_SUM)?];
        Ok(PhotonLights { weigh, sum, lights: count, classes, sums })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.weigh.run(rec, &[], groups(self.lights))?;
        self.sum.run(rec, &[], self.classes.into())
    }
}

/// Oracle: the weight of a light.
pub fn weight(frame: &FrameParameters, light: &PointLight, targets: &Targets) -> f32 {
    let xyz = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);
    let glossy = light.position[3].to_bits() & PointLight::GLOSSY != 0;
    let gloss = if glossy { mean(xyz(light.flux)) * mean(xyz(light.f0)) * std::f32::consts::FRAC_1_PI } else { 0.0 };
    let (origin, normal) = (xyz(light.position), xyz(light.normal));
    let mirrored = frame.mirrors[2] > 0;
    let seen: f32 = targets.list.iter().map(|target| target.weight_from(origin, Some(normal), mirrored)).sum();
    (mean(xyz(light.emit)) + gloss) * seen
}

/// Oracle: the light of a class from which a photon starts by a number in [0, 1), and the probability of that; `sums`: those of all
/// classes.
pub fn choose(frame: &FrameParameters, sums: &[f32], class: u32, u: f32) -> (usize, f32) {
    let (each, first) = (frame.pattern[3] as usize, frame.depths[1][1] as usize);
    let begin = class as usize * each;
    let sums = &sums[begin + first..begin + each];
    let whole = sums[sums.len() - 1];
    let i = sums.partition_point(|&sum| sum <= u * whole).min(sums.len() - 1);
    let below = if i > 0 { sums[i - 1] } else { 0.0 };
    (begin + first + i, (sums[i] - below) / whole.max(1e-37))
}
