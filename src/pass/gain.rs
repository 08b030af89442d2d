//! Sums the radiance that the filter adds to each pixel over the passes. The sums tell the filter's bias, which the image leaves out.
//!
//! The *gain* g of a pixel in a pass is its radiance with the filters ([`discontinuity`](super::discontinuity),
//! [`discontinuity_lobes`](super::discontinuity_lobes)) the rays of other pixels' light at edges ([`edges`](super::edges)) and the removal of [`outliers`](super::outliers) less that without:
//!
//! ```text
//! g = throughput (kd / pi (E' - E) + L_s' - L_s) + the same of the second component + what edge rays add - outliers
//! ```
//!
//! where a prime marks what is filtered. Where the filter only takes noise away the mean gain of N passes goes to zero, where it blurs shadows it goes to
//! its bias. Let m be the mean over the passes of g, averaged over its three channels, v the variance of that mean as the passes tell it, and
//! sums go over 5 x 5 pixels. The part
//!
//! ```text
//! s = max(0, 1 - c (N - 1) / (N - 3) sum v / sum m^2),     c = SIGNIFICANCE
//! ```
//!
//! of the mean gain is taken from the mean of the passes ([`resolve`](super::resolve), [`crate::film`]), none before [`MIN_PASSES`]. It is the
//! positive-part estimator of James and Stein (1961) for means of several normal variables: the image lies between the filtered mean, where
//! that is within the noise of the unfiltered one, and the unfiltered mean, to which it converges.
//!
//! A filter that preserves the sum of light moves light from pixel to pixel. The image keeps that sum only if neighbouring pixels give back the same
//! part s; so s comes from a window that neighbours mostly share.
//!
//! A gain that is no number, of light that was none before the filter, counts as zero, and squares of means of more than 2^50 as 2^100.
//!
//! Limits: mirror images that are spread keep their gain. The layers of irradiance are those of the
//! filter, and where summands are kept diffuse and specular light share the part taken away as they share the light.
//!
//! Cost: 15 vec4 and 90 operations a pixel; 10 vec4 more for each pixel of a tile that shows mirrors, glass or narrow lobes; 64 bytes of memory a pixel.

use glam::{DVec4, Vec3};

use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints, groups};
use crate::error::Result;
use crate::film::Film;
use crate::gpu::{Buffer, Recorder, Resources, Shader, shaders};

/// Passes before which nothing is taken away: fewer do not tell their variance.
pub const MIN_PASSES: u32 = 4;
/// Variances by which the square of a mean gain must exceed zero. Higher: bias stays longer. Lower: noise comes back.
pub const SIGNIFICANCE: f64 = 1.5;

/// The gain by second components.
pub struct PathGain {
    kernel: BoundKernel,
    tiles: Buffer,
}

/// The sum of the gain.
pub struct Gain {
    /// A vec4 for each pixel: the gain by its second component and by edge rays, less outliers; zero between frames.
    pub path_gain: Buffer,
    kernel: BoundKernel,
    pixels: u32,
}

/// Light before and after the filter.
pub struct Inputs<'a> {
    /// Shading points.
    pub points: &'a ShadingPoints,
    /// Their throughput.
    pub paths: &'a EyePathState,
    /// Light before the filter.
    pub raw: &'a Lighting,
    /// Light after it.
    pub filtered: &'a Lighting,
    /// A vec4 for each pixel: the gain by its second component and by edge rays, less outliers; zero between frames.
    pub path_gain: &'a Buffer,
}

impl Inputs<'_> {
    fn bind(&self, kit: &Kit, shader: &'static Shader, more: &[&Resources]) -> Result<BoundKernel> {
        let Inputs { points, paths, raw, filtered, path_gain } = self;
        let own = Resources::of([
            ("raw_direct", &raw.direct),
            ("raw_indirect", &raw.indirect),
            ("raw_specular", &raw.specular),
            ("path_gain", path_gain),
        ]);
        let (points, paths, filtered) = (points.resources(), paths.resources(), filtered.resources());
        kit.bind(shader, &[&[&own, &points, &paths, &filtered], more].concat())
    }
}

impl PathGain {
    /// Writes `inputs.path_gain` at the pixels of `tiles`. `region`: planes that pixels show, whose mirror image is spread.
    pub fn new(kit: &Kit, inputs: &Inputs, tiles: &List, region: &Buffer) -> Result<Self> {
        let region = Resources::of([("region", region)]);
        let kernel = inputs.bind(kit, &shaders::GAIN_PATHS, &[&tiles.as_tiles(), &region])?;
        Ok(PathGain { kernel, tiles: tiles.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}

impl Gain {
    /// Adds to `film`.
    pub fn new(kit: &Kit, inputs: &Inputs, film: &Film) -> Result<Self> {
        let kernel = inputs.bind(kit, &shaders::GAIN, &[&film.as_gain()])?;
        Ok(Gain { kernel, path_gain: inputs.path_gain.clone(), pixels: film.pixels() })
    }

    /// Records the clearing of `path_gain`, needed once.
    pub fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.path_gain, 0)
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}

/// Oracle: the radiance that the filter adds to a component. `filtered` and `raw`: irradiance, direct and indirect, and specular radiance.
pub fn reference(throughput: Vec3, kd: Vec3, filtered: [Vec3; 3], raw: [Vec3; 3]) -> Vec3 {
    let [direct, indirect, specular] = [0, 1, 2].map(|i| filtered[i] - raw[i]);
    throughput * (kd * std::f32::consts::FRAC_1_PI * (direct + indirect) + specular)
}

/// Square of the mean gain of a pixel, and the variance of that mean, from the mean of gains (w: of squares) over `passes` passes.
pub fn moments(mean: DVec4, passes: u32) -> [f64; 2] {
    let grey = mean.truncate().element_sum() / 3.0;
    let square = grey * grey;
    [square, (mean.w - square).max(0.0) / f64::from(passes - 1)]
}

/// The part of the mean gain of a pixel that is taken away, from the moments of the pixels around it, its own included.
pub fn share(around: impl Iterator<Item = [f64; 2]>, passes: u32) -> f64 {
    if passes < MIN_PASSES {
        return 0.0;
    }
    let [square, variance] = around.fold([0.0; 2], |sum, moments| [0, 1].map(|i| sum[i] + moments[i]));
    let noise = SIGNIFICANCE * f64::from(passes - 1) / f64::from(passes - 3) * variance;
    if square > noise { (square - noise) / square } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn noise_stays_and_bias_goes() {
        let of = |mean: f64, deviation: f64, passes: u32| {
            let gains = DVec3::splat(mean).extend(mean * mean + deviation * deviation);
            share(std::iter::repeat_n(moments(gains, passes), 9), passes)
        };
        // A mean gain within its own standard deviation is noise.
        assert_eq!(of(0.1, 1.0, 101), 0.0);
        // One of ten standard deviations is bias, but for 1.5 hundredths; and nearly all after many more passes.
        assert!((of(1.0, 1.0, 101) - (1.0 - 1.5 * 100.0 / 98.0 / 100.0)).abs() < 1e-9);
        assert!(of(1.0, 1.0, 100_001) > 0.9999);
        // Three passes do not tell.
        assert_eq!((of(1.0, 0.0, 3), of(1.0, 0.0, 4), of(0.0, 0.0, 4)), (0.0, 1.0, 0.0));
    }
}
