//! What gathered points emit and reflect is added to the pixels they were gathered for.
//!
//! Light that came in through the eye's diffuse lobe adds to the irradiance (emitters met at once: direct; all else:
//! indirect), light through its specular lobe to the radiance. Cost: 10 vec4 and 20 operations a gather ray.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::{Kernels, List, Receivers, Sums, push};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};

/// The pass over the rays of one list.
pub struct Collect {
    kernel: Kernel,
    bindings: Bindings,
    work: Buffer,
}

impl Collect {
    /// Adds to `pixels` what `receivers`, lit by `sums` and weighted by `beta`, send back.
    pub fn new(
        kernels: &Kernels,
        receivers: &Receivers,
        list: &List,
        beta: &Buffer,
        sums: &Sums,
        pixels: &Sums,
        steps: &Buffer,
    ) -> Result<Self> {
        let kernel = kernels.collect.clone();
        let bindings = kernel.bind(&[
            ("work", (&list.work).into()),
            ("list", (&list.pixels).into()),
            ("steps", steps.into()),
            ("beta", beta.into()),
            ("emitted", (&receivers.emitted).into()),
            ("receiver_kd", (&receivers.kd).into()),
            ("receiver_wo", (&receivers.wo).into()),
            ("direct", (&sums.direct).into()),
            ("indirect", (&sums.indirect).into()),
            ("specular", (&sums.specular).into()),
            ("pixel_direct", (&pixels.direct).into()),
            ("pixel_indirect", (&pixels.indirect).into()),
            ("pixel_specular", (&pixels.specular).into()),
        ])?;
        Ok(Collect { kernel, bindings, work: list.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        rec.dispatch_indirect(&self.kernel, &self.bindings, &push(step), &self.work, LIST_GROUPS)
    }
}

/// One gathered point.
#[derive(Clone, Copy, Debug)]
pub struct Gathered {
    /// Throughput from the eye, without the albedo of the eye's diffuse lobe.
    pub beta: Vec3,
    /// The eye's first lobe was the specular one.
    pub specular: bool,
    /// Emission times throughput.
    pub emitted: Vec3,
    /// Albedo of the point.
    pub kd: Vec3,
    /// It is lit.
    pub lit: bool,
    /// Direct irradiance, indirect irradiance, specular radiance at the point.
    pub sums: [Vec3; 3],
}

/// Oracle: what is added to the pixel's direct and indirect irradiance and specular radiance.
pub fn reference(point: &Gathered, bounce: u32) -> [Vec3; 3] {
    let [direct, indirect, specular] = point.sums;
    let reflected = if point.lit {
        point.beta * (point.kd * std::f32::consts::FRAC_1_PI * (direct + indirect) + specular)
    } else {
        Vec3::ZERO
    };
    match (point.specular, bounce) {
        (true, _) => [Vec3::ZERO, Vec3::ZERO, reflected + point.emitted],
        (false, 1) => [point.emitted, reflected, Vec3::ZERO],
        (false, _) => [Vec3::ZERO, reflected + point.emitted, Vec3::ZERO],
    }
}
