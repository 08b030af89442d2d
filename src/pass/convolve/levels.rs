//! Plan of a convolution: levels of the pyramid, rounds of the window.

use std::ops::Range;

use super::{Form, Inputs, MAX_WIDTH, SUMMED, SUPPORT};
use crate::error::{Error, Result};
use crate::pass::layout::ConvolveStep;

/// Taps of an invocation in one dispatch; a single row of the window may exceed it.
const ROUND: u32 = 8192;

/// Upper bound that keeps diameters finite.
const MAX_DIAMETER: f32 = 1e6;

/// Kernels up to this width in texels stay at their level entirely.
pub const STAYS: f32 = 6.0;
/// Kernels from this width in texels on move to the next level entirely.
pub const LEAVES: f32 = 8.0;
/// Minimum width, in diameters, of the disc with the variance of a kernel; narrower kernels are clamped to it.
pub const MIN_BREADTH: f32 = 0.5;
/// Minimum fraction of a kernel's variance that remains after the pyramid's variance is subtracted.
pub const MIN_VARIANCE: f32 = 0.02;

/// Levels, rounds and the table of steps for the device.
pub struct Levels {
    /// A step for each level, one more above the top, and one for each round.
    pub steps: Vec<ConvolveStep>,
    /// Number of levels, the image included.
    pub count: usize,
    /// Texels of all levels but the image.
    pub entries: u32,
    /// Tiles of all levels.
    pub tiles: u32,
    /// Steps of the rounds that sum up kernels.
    pub weigh: Range<usize>,
    /// Steps of the rounds that gather.
    pub gather: Range<usize>,
}

impl Levels {
    /// Levels for `inputs`.
    pub fn new(inputs: &Inputs) -> Result<Levels> {
        let [width, height] = inputs.size;
        if width == 0 || height == 0 || width.max(height) > MAX_WIDTH {
            let message = format!("convolution of {width}x{height} pixels; the sides may have 1 to {MAX_WIDTH}");
            return Err(Error::Setting { name: "--resolution", message });
        }
        // Comparisons with NaN are false.
        let widest = if inputs.widest > 1.0 { inputs.widest.min(MAX_DIAMETER) } else { 1.0 };
        let fast = inputs.chosen() == Form::Fast;
        let invariant = if inputs.by_region { ConvolveStep::INVARIANT } else { 0 };
        let whole = [-(MAX_WIDTH as i32), MAX_WIDTH as i32 + 1];
        let mut levels = Levels { steps: Vec::new(), count: 1, entries: 0, tiles: 0, weigh: 0..0, gather: 0..1 };
        let mut size = inputs.size;
        let mut texel = 1.0;
        let mut top = false;
        loop {
            let level = levels.steps.len();
            // The level above the top exists only as room, so that no level needs to know that it is the last.
            let above_top = top;
            top |= level > 0 && (widest <= STAYS * texel || size == [1, 1]) || !fast;
            let tiles = size.map(|n| n.div_ceil(8));
            let texels = if top { widest / texel } else { (widest / texel).min(LEAVES / MIN_BREADTH) };
            let reach = (0.5 * SUPPORT * texels).min(size[0].max(size[1]) as f32) as u32;
            levels.steps.push(ConvolveStep {
                size,
                tiles,
                first: if level == 0 { 0 } else { levels.entries },
                first_tile: levels.tiles,
                rows: whole,
                flags: ConvolveStep::FIRST_ROUND
                    | ConvolveStep::LAST_ROUND
                    | if top { ConvolveStep::TOP_LEVEL } else { 0 }
                    | invariant,
                layers: inputs.library.layers,
                texel,
                widest,
                reach: reach.div_ceil(8) + 1,
                level: level as u32,
            });
            levels.entries += if level == 0 { 0 } else { 2 * size[0] * size[1] };
            levels.tiles += tiles[0] * tiles[1];
            if above_top {
                break;
            }
            levels.count = level + 1;
            if !fast {
                break;
            }
            size = size.map(|n| n.div_ceil(2));
            texel *= 2.0;
        }
        if !fast {
            let reach = (0.5 * SUPPORT * widest.min(SUMMED)) as u32;
            levels.weigh = levels.rounds(reach, reach);
            let reach = (0.5 * SUPPORT * widest) as u32;
            levels.gather = levels.rounds(reach.min(width - 1), reach.min(height - 1));
        }
        Ok(levels)
    }

    /// Adds the rounds over a window that reaches `columns` and `rows` to each side, as few as the bound on taps
    /// allows.
    fn rounds(&mut self, columns: u32, rows: u32) -> Range<usize> {
        let first = self.steps.len();
        let image = self.steps[0];
        let each = (ROUND / (2 * columns + 1)).max(1) as i32;
        let rows = rows as i32;
        let starts: Vec<i32> = (-rows..=rows).step_by(each as usize).collect();
        for (i, &start) in starts.iter().enumerate() {
            let mut step = ConvolveStep { rows: [start, start + each], ..image };
            step.flags &= !(ConvolveStep::FIRST_ROUND | ConvolveStep::LAST_ROUND);
            if i == 0 {
                step.flags |= ConvolveStep::FIRST_ROUND;
            }
            if i + 1 == starts.len() {
                step.flags |= ConvolveStep::LAST_ROUND;
            }
            self.steps.push(step);
        }
        first..self.steps.len()
    }
}
