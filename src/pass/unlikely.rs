//! Spreads over its neighbours what an unlikely component shows beyond them.
//!
//! Beyond the first mirror or glass a path chooses one component ([`eye_paths`](super::eye_paths)). Of the pixels that show a ball of glass one in some
//! twenty-five sees the room by reflection inside the ball, where the others look through it: dots, which are most of the error of a first
//! frame there. Each of them stands for the share of that reflection in all pixels around it. Let W be the slots of its component, in the 5 x 5
//! pixels around it that lie in its tile of 8 x 8 pixels, whose paths chose components too, T the mean over the channels of a slot's throughput, and M the sum of the radiance of those
//! among them whose path chose no component of a probability below one half, over the sum of their T: what they see beyond mirrors and glass. With the filter's weight w ([`Filter::weight`](crate::settings::Filter::weight)) such a slot of
//! radiance L gives its surplus to all of W in proportion to T, which falls towards the rim of a ball:
//!
//! ```text
//! D = w s (L - T M),     L' = L - D + T sum over the slots whose W holds this one of D / sum_W T,     L = L_e + throughput (kd / pi E + L_s)
//! ```
//!
//! The factor s, at most 1, keeps the grey of |D| / sum_W T below [`MOST`] times the least L / T of the likely slots of W: a lamp among them would
//! leave a dark ring around itself. The sum over the image is kept. The change is made in the emission of the slots, which may become negative in single pixels. The gain of the
//! filter ([`gain`](super::gain)) includes it, so that edges in what the component shows get sharp where the passes show that they are more than noise.
//! Slots without a likely one in W keep their light.
//!
//! Cost: for each pixel of a tile that shows mirrors, glass or narrow lobes two flags read and 4 vec4 read and written; for each slot of an unlikely path
//! 175 vec4 and 600 operations, for each slot that a path chose 64 vec4 and 700 operations. Memory: 16 bytes a slot.

use glam::Vec3;

use super::layout::FrameParameters;
use super::outliers::Inputs;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Greatest part that a slot receives over its throughput, in units of the same of the darkest likely one around. Higher: fewer dots, and darker rings around lamps that are seen in
/// glass.
pub const MOST: f32 = 0.1;

/// The pass.
pub struct Unlikely {
    /// Of each slot: radiance that it gives away; throughput of the slots that share it, 0: none.
    pub surplus: Buffer,
    find: BoundKernel,
    spread: BoundKernel,
    tiles: Buffer,
}

impl Unlikely {
    /// For images of two components of `slots` slots in all. The emission of the points is changed, and the gain by second components receives the change.
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

/// A slot of W.
#[derive(Clone, Copy, Debug)]
pub struct Other {
    /// Radiance L.
    pub radiance: Vec3,
    /// Mean over the channels of its throughput, T.
    pub through: f32,
    /// Whether its path chose no component of a probability below one half.
    pub likely: bool,
}

/// Oracle: the surplus of a slot of an unlikely path, and its part for a slot of W of throughput 1. `all`: the slots of W, itself included.
pub fn reference(frame: &FrameParameters, own: &Other, all: &[Other]) -> [Vec3; 2] {
    let likely = || all.iter().filter(|other| other.likely && other.through > 0.0);
    if likely().next().is_none() {
        return [Vec3::ZERO; 2];
    }
    let grey = |l: Vec3| l.element_sum() / 3.0;
    let seen = likely().map(|o| o.radiance).sum::<Vec3>() / likely().map(|o| o.through).sum::<f32>();
    let more = own.radiance - own.through * seen;
    let through: f32 = all.iter().map(|o| o.through).sum();
    let least = likely().map(|o| grey(o.radiance) / o.through).fold(f32::MAX, f32::min).max(0.0);
    let most = MOST * through * least;
    let surplus = frame.lens[2] * (most / grey(more).abs().max(1e-30)).min(1.0) * more;
    [surplus, surplus / through]
}
