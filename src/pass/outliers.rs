//! Takes away emission that a path found by chance: single pixels much brighter than those around them.
//!
//! Where a path has split as often as it may it chooses one component ([`eye_paths`](super::eye_paths)). One path in twenty-five
//! then finds a reflection that carries a twenty-fifth of the light, and a lamp in it is as bright as the lamp itself, for the path stands for the others too. Curved glass also makes lamps so small
//! that the ray of a pixel meets them in few passes. In the first frames such pixels are most of the error. Where a path chose a component of a probability below
//! one half, or passed three mirrors and surfaces of glass, the emission along it is lowered so that the pixel's component has at most [`ABOVE`] times the radiance that four of the eight pixels around it have
//! (those of its tile of 8 x 8 pixels); with the filter's weight ([`Filter::weight`](crate::settings::Filter::weight)):
//!
//! ```text
//! L_e' = L_e - w min(L_e, L (1 - ABOVE G_4 / G)),     G the grey of L = L_e + throughput (kd / pi E + L_s), G_4 the fourth greatest around it
//! ```
//!
//! where G exceeds ABOVE G_4. The gain of the filter ([`gain`](super::gain)) includes this loss, so the image gets the light back where the
//! passes show that it is more than noise.
//!
//! Bias: after Zirr, Hanika and Dachsbacher (2018), who weigh such samples by what neighbours support, it is a loss of light that fades as log(N) / N over N passes.
//!
//! Cost: for each pixel of a tile that shows mirrors, glass or narrow lobes two vec4 and two flags read and 4 vec4 written, and for each slot with such emission 70 vec4
//! and 400 operations. Memory: 16 bytes a slot.

use glam::Vec3;

use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Radiance over that of four pixels around it from which a pixel is an outlier. Higher: brighter dots. Lower: highlights lose more light
/// in the first passes.
pub const ABOVE: f32 = 2.0;

/// The pass.
pub struct Outliers {
    /// Radiance taken from each slot.
    pub removed: Buffer,
    find: BoundKernel,
    remove: BoundKernel,
    tiles: Buffer,
}

/// Inputs.
pub struct Inputs<'a> {
    /// Shading points; their emission is lowered.
    pub points: &'a ShadingPoints,
    /// Eye paths to them.
    pub paths: &'a EyePathState,
    /// Their light.
    pub lighting: &'a Lighting,
    /// Tiles with second components.
    pub tiles: &'a List,
    /// Planes that pixels show, whose mirror image is spread.
    pub region: &'a Buffer,
    /// The gain by second components, which receives what is taken, if it is summed.
    pub path_gain: Option<&'a Buffer>,
}

impl Outliers {
    /// For images of two components of `slots` slots in all.
    pub fn new(kit: &Kit, inputs: &Inputs, slots: u32) -> Result<Outliers> {
        let Inputs { points, paths, lighting, tiles, region, path_gain } = *inputs;
        let removed = kit.vec4s("outliers", slots)?;
        let own = Resources::of([
            ("removed", &removed),
            ("region", region),
            // Without the sum of the gain the kernel has no such binding.
            ("path_gain", path_gain.unwrap_or(&removed)),
        ]);
        let sets = [&own, &points.resources(), &paths.resources(), &lighting.resources(), &tiles.as_tiles()];
        let remove = if path_gain.is_some() { &shaders::OUTLIERS_GAIN } else { &shaders::OUTLIERS };
        Ok(Outliers {
            find: kit.bind(&shaders::OUTLIERS_FIND, &sets)?,
            remove: kit.bind(remove, &sets)?,
            tiles: tiles.work.clone(),
            removed,
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.find.run_listed(rec, &[], &self.tiles, LIST_GROUPS)?;
        self.remove.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}

/// Oracle: pixels around one, in its tile of an image of this size; fewer than eight only at borders of small images.
pub fn around(frame: &FrameParameters, pixel: u32) -> Vec<u32> {
    let [width, height, ..] = frame.size;
    let axis = |at: u32, size: u32| {
        let corner = at & !7;
        let last = (corner + 6).min(size.max(2) - 2);
        let middle = i64::from(at.clamp((corner + 1).min(last), last));
        (middle - 1..=middle + 1).filter(move |there| (0..i64::from(size)).contains(there))
    };
    let (x, y) = (pixel % width, pixel / width);
    let places = axis(y, height).flat_map(|y| axis(x, width).map(move |x| (y * i64::from(width) + x) as u32));
    places.filter(|&other| other != pixel).collect()
}

/// Oracle: emission taken from a component of a pixel that an unlikely path found. `emission` and `radiance` (the emission included) are its own,
/// `others` the radiance of those around it.
pub fn reference(frame: &FrameParameters, emission: Vec3, radiance: Vec3, others: &[Vec3]) -> Vec3 {
    let grey = |l: Vec3| l.element_sum() / 3.0;
    // Pixels that the image does not have are as bright as this one.
    let mut greys: Vec<f32> = others.iter().map(|&l| grey(l)).collect();
    greys.resize(8, grey(radiance));
    greys.sort_by(|a, b| b.total_cmp(a));
    let share = (1.0 - ABOVE * greys[3] / grey(radiance).max(1e-30)).max(0.0);
    (frame.lens[2] * share * radiance).min(emission)
}
