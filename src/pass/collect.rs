//! Adds the light that gathered points emit and reflect to the pixels they were gathered for.
//!
//! Light that came in through the eye's diffuse lobe adds to the irradiance (emitters met at once: direct; all else:
//! indirect), light through its specular lobe to the radiance. Cost: 10 vec4 and 20 operations a gather ray.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, Lighting, List, ShadingPoints, push};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// The pass over the rays of one list.
pub struct Collect {
    kernel: BoundKernel,
    work: Buffer,
}

impl Collect {
    /// Adds to `pixels` what `points`, lit by `lighting` and weighted by `beta`, send back.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        list: &List,
        beta: &Buffer,
        lighting: &Lighting,
        pixels: &Lighting,
        steps: &Resources,
    ) -> Result<Self> {
        let own = Resources::of([
            ("beta", beta),
            ("pixel_direct", &pixels.direct),
            ("pixel_indirect", &pixels.indirect),
            ("pixel_specular", &pixels.specular),
        ]);
        let sets = [&points.resources(), &list.resources(), &lighting.resources(), &own, steps];
        Ok(Collect { kernel: kit.bind(&shaders::COLLECT, &sets)?, work: list.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.kernel.run_listed(rec, &push(step), &self.work, LIST_GROUPS)
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
