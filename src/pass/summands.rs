//! Running sums for the summands of the image (Bastos 1999, chapter 4, equation 4.15):
//!
//! ```text
//! L = L_emission + L_diffuse + L_specular
//! L_emission = L_e                                emission of the surface that the eye sees
//! L_diffuse  = kd / pi (E_direct + E_indirect)    its view-independent reflection
//! L_specular = lobe of the virtual lights + spread mirror image + second component + all light from mirrors and glass
//! ```
//!
//! The surface is the first that the eye ray hits, and everything seen in a mirror or through glass is the specular
//! summand of that surface. The image of a rendering with summands is their sum, rounded once for each addition, to the
//! last bit.
//!
//! The pass comes before `accumulate`. It adds the light of second components and mirror images, which without summands
//! is added to the emission of the pixels at once.
//!
//! Differs from the thesis in that: the three come from one pass over the same shading points and not from separate
//! renderings.
//!
//! Cost: 21 vec4 and 40 operations a pixel, and 112 bytes of memory.

use glam::Vec3;

use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints, groups};
use crate::error::Result;
use crate::film::Film;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// The pass.
pub struct Summands {
    /// Light of second components and of mirror images.
    pub reflected: Buffer,
    kernel: BoundKernel,
    pixels: u32,
}

impl Summands {
    /// Adds to the summands of `film`, in `sums`. `merge` and `superpose` add to `reflected`.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        paths: &EyePathState,
        lighting: &Lighting,
        film: &Film,
        sums: &Resources,
    ) -> Result<Self> {
        let reflected = kit.vec4s("reflected", film.pixels())?;
        let own = Resources::of([("reflected", &reflected)]);
        let sets = [&points.resources(), &paths.resources(), &lighting.resources(), &own, sums];
        Ok(Summands { kernel: kit.bind(&shaders::SUMMANDS, &sets)?, reflected, pixels: film.pixels() })
    }

    /// Records the clearing of `reflected` at the start of a frame.
    pub fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.reflected, 0)
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}

/// Oracle: emission, diffuse and specular light of a pixel; `by_mirror`: it shows a mirror or glass.
pub fn reference(
    (emitted, by_mirror): (Vec3, bool),
    throughput: Vec3,
    kd: Vec3,
    sums: [Vec3; 3],
    reflected: Vec3,
) -> [Vec3; 3] {
    let body = throughput * kd * std::f32::consts::FRAC_1_PI * (sums[0] + sums[1]);
    let gloss = throughput * sums[2] + reflected;
    if by_mirror { [Vec3::ZERO, Vec3::ZERO, gloss + emitted + body] } else { [emitted, body, gloss] }
}
