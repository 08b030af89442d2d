//! Light for pixels whose windows found few that agree: on mouldings, leaves and thin things, along silhouettes and creases.
//!
//! The window of the [`discontinuity`] buffer gives such pixels little, so that first frames show dots and the pattern of the classes
//! there. Let q be the lack of a window, the share of its weight that found no pixel that agrees (0: all did). Two pixels i and j, k steps apart along a column,
//! a row or a diagonal, exchange indirect irradiance once with k = 1, then with k = 3, together a window of 9 x 9 in 18 taps:
//!
//! ```text
//! E'_i = E_i + w / 9 sum over the eight j of a_ij max(q_i, q_j) (E_j - E_i)
//! ```
//!
//! with a_ij = 1 if they are near each other and do not face away from each other, else 0: their shading normals have a cosine of at least
//! [`MIN_COSINE`], and their distance is at most the one that the discontinuity buffer allows. The weights are symmetrical, so that the sum of irradiance
//! stays, and so do constants. Where all windows are full nothing changes: shadows on smooth surfaces stay as sharp as they were.
//!
//! Direct light has less noise, and shadows that such an exchange would blur. Of a pixel with a lack, whose direct irradiance has the grey g, it takes
//! only what exceeds [`ABOVE`] times the second greatest grey g_2 of the alike pixels beside it, of which there must be two, and gives it to these n pixels and itself in equal parts:
//!
//! ```text
//! S_i = w max(g - 1.2 g_2, 0) / g E_i,     E'_i = E_i - S_i + sum over j alike and i itself of S_j / (n_j + 1)
//! ```
//!
//! The weight w of the pass is [`Filter::sparse_weight`](crate::settings::Filter::sparse_weight), 1 / (number of the pass), so the bias of the mean of N passes, light that leaks over creases and between surfaces that lie near each
//! other, vanishes as log(N) / N. The gain of the filter ([`gain`](super::gain)) includes it. Not with the paper's test of agreement, whose windows
//! divide by what they found.
//!
//! Source: none; it extends Wald et al. 2002, 4.3.
//!
//! Cost of a pixel: 27 vec4 read and 4 written; near windows with a lack some 40 more vec4 and 300 operations. Memory: 16 bytes a slot, with direct light 32.

use glam::{IVec2, Vec3};

use super::discontinuity::{self, Discontinuity, Guide};
use super::layout::{FrameParameters, Window};
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, List};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Minimum scalar product of the shading normals of pixels that exchange light.
///
/// Higher: dots remain on mouldings. Lower: both sides of thin things exchange light.
pub const MIN_COSINE: f32 = 0.0;

/// Least ratio of a pixel's direct irradiance to the second greatest around from which on it is lowered.
///
/// Higher: dots remain. Lower: small lights on surfaces are blurred.
pub const ABOVE: f32 = 1.2;

/// Steps of the two exchanges.
pub const STEPS: [i32; 2] = [1, 3];

/// The pass.
pub struct SparseWindows {
    /// Indirect irradiance after the first exchange; w: lack of the window.
    pub moved_indirect: Buffer,
    /// Of each slot, the part of its surplus of direct light that each pixel that shares it receives; w: their number, 0: none.
    pub surplus: Option<Buffer>,
    kernels: [BoundKernel; 2],
    windows: Vec<Window>,
    tiles: Buffer,
    tile_count: u32,
}

impl SparseWindows {
    /// Changes what the filter of these inputs leaves.
    pub fn new(kit: &Kit, inputs: &discontinuity::Inputs, filter: &Discontinuity) -> Result<SparseWindows> {
        let [width, height] = inputs.size;
        let slots = width * height * inputs.components;
        let moved_indirect = kit.vec4s("indirect light of sparse windows", slots)?;
        let surplus = match inputs.filter.direct {
            false => None,
            true => Some(kit.vec4s("surplus of sparse windows", slots)?),
        };
        let own = Resources::of([
            ("moved_indirect", &moved_indirect),
            ("filtered_indirect", &filter.filtered.indirect),
            ("filtered_direct", &filter.filtered.direct),
            // Without direct light the kernels have no such binding.
            ("surplus", surplus.as_ref().unwrap_or(&moved_indirect)),
        ]);
        let sets = [&filter.guides().and(&own), &inputs.ideal_tiles.as_tiles()];
        let shaders = match inputs.filter.direct {
            true => [&shaders::SPARSE_WINDOWS_FIRST, &shaders::SPARSE_WINDOWS],
            false => [&shaders::SPARSE_WINDOWS_FIRST_INDIRECT, &shaders::SPARSE_WINDOWS_INDIRECT],
        };
        let [first, last] = shaders.map(|shader| kit.bind(shader, &sets));
        let List { work, .. } = inputs.ideal_tiles;
        Ok(SparseWindows {
            kernels: [first?, last?],
            windows: Window::of_components(&inputs.filter, inputs.pattern, inputs.components),
            tiles: work.clone(),
            tile_count: width.div_ceil(8) * height.div_ceil(8),
            moved_indirect,
            surplus,
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        for kernel in &self.kernels {
            for window in &self.windows {
                let push = bytemuck::bytes_of(window);
                match window.component {
                    0 => kernel.run(rec, push, self.tile_count.into())?,
                    _ => kernel.run_listed(rec, push, &self.tiles, LIST_GROUPS)?,
                }
            }
        }
        Ok(())
    }
}

/// Oracle: whether two shading points, `apart` pixels from each other, exchange light.
pub fn alike(a: &Guide, b: &Guide, apart: f32) -> bool {
    a.extent.min(b.extent) > 0.0
        && a.shading.dot(b.shading) >= MIN_COSINE
        && a.point.distance(b.point) <= apart * a.extent.max(b.extent).sqrt()
}

/// The pixels a number of steps from one, of an image of this size, and their distances in pixels.
fn around([width, height]: [i32; 2], pixel: usize, steps: i32) -> impl Iterator<Item = (usize, f32)> {
    let here = IVec2::new(pixel as i32 % width, pixel as i32 / width);
    let offsets = (0..9).map(|i| IVec2::new(i % 3 - 1, i / 3 - 1)).filter(|offset| *offset != IVec2::ZERO);
    offsets.filter_map(move |offset| {
        let there = here + steps * offset;
        let inside = (0..width).contains(&there.x) && (0..height).contains(&there.y);
        inside.then(|| ((there.y * width + there.x) as usize, steps as f32 * offset.as_vec2().length()))
    })
}

/// Oracle: the indirect irradiance of all pixels of one component. `lacks`: those of their windows.
pub fn indirect(frame: &FrameParameters, guides: &[Guide], lacks: &[f32], irradiance: &[Vec3]) -> Vec<Vec3> {
    let size = [frame.size[0] as i32, frame.size[1] as i32];
    let mut now = irradiance.to_vec();
    for steps in STEPS {
        let gain = |i: usize| -> Vec3 {
            let others = around(size, i, steps).filter(|&(j, apart)| alike(&guides[i], &guides[j], apart));
            others.map(|(j, _)| lacks[i].max(lacks[j]) * (now[j] - now[i])).sum()
        };
        now = (0..now.len()).map(|i| now[i] + frame.shift[3] / 9.0 * gain(i)).collect();
    }
    now
}

/// Oracle: the direct irradiance of all pixels of one component.
pub fn direct(frame: &FrameParameters, guides: &[Guide], lacks: &[f32], irradiance: &[Vec3]) -> Vec<Vec3> {
    let size = [frame.size[0] as i32, frame.size[1] as i32];
    let mut changed = irradiance.to_vec();
    for i in (0..irradiance.len()).filter(|&i| lacks[i] > 0.0 && guides[i].extent > 0.0) {
        let others = around(size, i, 1).filter(|&(j, apart)| alike(&guides[i], &guides[j], apart));
        let sharing: Vec<usize> = others.map(|(j, _)| j).collect();
        let mut greys: Vec<f32> = sharing.iter().map(|&j| irradiance[j].element_sum() / 3.0).collect();
        greys.sort_by(|a, b| b.total_cmp(a));
        let grey = irradiance[i].element_sum() / 3.0;
        let Some(second) = greys.get(1) else { continue };
        let surplus = frame.shift[3] * (grey - ABOVE * second).max(0.0) / grey.max(1e-30) * irradiance[i];
        let part = surplus / (1 + sharing.len()) as f32;
        changed[i] += part - surplus;
        sharing.iter().for_each(|&j| changed[j] += part);
    }
    changed
}
