//! Spreads over its neighbours what an unlikely component shows beyond them.
//!
//! Beyond the first mirror or glass a path chooses one component ([`eye_paths`](super::eye_paths)). Of the pixels that show a ball of glass one in some
//! twenty-five sees the room by reflection inside the ball, where the others look through it: dots, which are most of the error of a first
//! frame there. Each of them stands for the share of that reflection in all pixels around it. Let W be the slots of its component, in the 5 x 5
//! pixels around it that lie in its tile of 8 x 8 pixels, whose paths chose components too, and M the mean radiance of those among them whose path
//! chose no component of a probability below one half. With the filter's weight w ([`Filter::weight`](crate::settings::Filter::weight)) such a slot of
//! radiance L gives its surplus to all of W alike:
//!
//! ```text
//! D = w s (L - M),     L' = L - D + sum over the slots whose W holds this one of D / |W|,     L = L_e + throughput (kd / pi E + L_s)
//! ```
//!
//! The factor s, at most 1, keeps the grey of each part |D| / |W| below [`MOST`] times that of the darkest likely slot of W: a lamp among them would
//! leave a dark ring around itself. The sum over the image is kept. The change is made in the emission of the slots, which may become negative in single pixels. The gain of the
//! filter ([`gain`](super::gain)) includes it, so that edges in what the component shows get sharp where the passes show that they are more than noise.
//! Slots without a likely one in W keep their light.
//!
//! Cost: for each pixel of a tile that shows mirrors, glass or narrow lobes two flags read and 4 vec4 read and written; for each slot of an unlikely path
//! 175 vec4 and 600 operations, for each slot that a path chose 64 vec4 and 700 operations. Memory: 16 bytes a slot.

use glam::Vec3;

use super::layout::FrameParameters;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, EyePathState, Kit, Lighting, List, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Greatest part that a slot receives, over the radiance of the darkest likely one around. Higher: fewer dots, and darker rings around lamps that are seen in
/// glass.
pub const MOST: f32 = 0.1;

/// The pass.
pub struct Unlikely {
    /// Of each slot: radiance that it gives away; number of slots that share it, 0: none.
    pub surplus: Buffer,
    find: BoundKernel,
    spread: BoundKernel,
    tiles: Buffer,
}

/// Inputs.
pub struct Inputs<'a> {
    /// Shading points; their emission is changed.
    pub points: &'a ShadingPoints,
    /// Eye paths to them.
    pub paths: &'a EyePathState,
    /// Their light.
    pub lighting: &'a Lighting,
    /// Tiles with second components.
    pub tiles: &'a List,
    /// Planes that pixels show, whose mirror image is spread.
    pub region: &'a Buffer,
    /// The gain by second components, which receives the change, if it is summed.
    pub path_gain: Option<&'a Buffer>,
}

impl Unlikely {
    /// For images of two components of `slots` slots in all.
    pub fn new(kit: &Kit, inputs: &Inputs, slots: u32) -> Result<Unlikely> {
        let Inputs { points, paths, lighting, tiles, region, path_gain } = *inputs;
        let surplus = kit.vec4s("surplus of unlikely components", slots)?;
        let own = Resources::of([
            ("surplus", &surplus),
            ("region", region),
            // Without the sum of the gain the kernel has no such binding.
            ("path_gain", path_gain.unwrap_or(&surplus)),
        ]);
        let sets = [&own, &points.resources(), &paths.resources(), &lighting.resources(), &tiles.as_tiles()];
        let spread = if path_gain.is_some() { &shaders::UNLIKELY_GAIN } else { &shaders::UNLIKELY };
        Ok(Unlikely {
            find: kit.bind(&shaders::UNLIKELY_FIND, &sets)?,
            spread: kit.bind(spread, &sets)?,
            tiles: tiles.work.clone(),
            surplus,
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.find.run_listed(rec, &[], &self.tiles, LIST_GROUPS)?;
        self.spread.run_listed(rec, &[], &self.tiles, LIST_GROUPS)
    }
}

/// Oracle: the 5 x 5 pixels around one that lie in its tile of an image of this size.
pub fn around(frame: &FrameParameters, pixel: u32) -> Vec<u32> {
    let [width, height, ..] = frame.size;
    let axis = |at: u32, size: u32| {
        let corner = at / 8 * 8;
        let last = (corner + 5).min(size.max(3) - 3);
        let middle = at.clamp((corner + 2).min(last), last);
        (corner.max(middle.saturating_sub(2))..=middle + 2).filter(move |&there| there < size.min(corner + 8))
    };
    let (x, y) = (pixel % width, pixel / width);
    axis(y, height).flat_map(|y| axis(x, width).map(move |x| y * width + x)).collect()
}

/// Oracle: the surplus of a slot of an unlikely path of this radiance, and its part for each slot of W. `others`: radiance of the slots of W,
/// itself included, and whether their path is likely.
pub fn reference(frame: &FrameParameters, radiance: Vec3, others: &[(Vec3, bool)]) -> [Vec3; 2] {
    let likely: Vec<Vec3> = others.iter().filter(|(_, likely)| *likely).map(|&(l, _)| l).collect();
    if likely.is_empty() {
        return [Vec3::ZERO; 2];
    }
    let grey = |l: Vec3| l.element_sum() / 3.0;
    let more = radiance - likely.iter().sum::<Vec3>() / likely.len() as f32;
    let least = likely.iter().map(|&l| grey(l)).fold(f32::MAX, f32::min).max(0.0);
    let most = MOST * others.len() as f32 * least;
    let surplus = frame.lens[2] * (most / grey(more).abs().max(1e-30)).min(1.0) * more;
    [surplus, surplus / others.len() as f32]
}
