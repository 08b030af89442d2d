//! The error of the mean of all passes, estimated from the passes.
//!
//! What is estimated: [`relative_error`] of the image against its limit, the mean of infinitely many passes with the same
//! settings. Bias, as by clipping or filters, is the error of the limit and no part of it.
//!
//! How: the N passes x_i of a pixel form cells, which are blocks of consecutive passes of one instance. A *contrast* gives
//! each cell a sign s, half of them -1. Then c = 1/N sum s_i x_i has mean 0 and, if cells are independent, the variance of
//! the error of the image, pixel for pixel and with the same correlation between pixels. So the image m is as far from
//! its limit as from m - c and from m + c, and the estimate is a mean over contrasts of the root mean square of these two
//! errors. Percentile and bound of the error apply to each contrast as to the image, and so do errors that
//! pixels have in common, because they share virtual lights.
//!
//! Passes of one instance are not independent, for they are segments of one low-discrepancy sequence: their errors cancel
//! in part. Contrasts of long blocks contain this, and those of short ones do not. So there are levels: level 0 is the
//! difference of the two instances, which are independent (Kollig and Keller 2002); level l > 0 has the 2^l contrasts
//! whose signs are the Walsh functions of 2^(l-1) to 2^l - 1 changes of sign, for both instances alike and opposed.
//! Level 0 has no bias, but is a single contrast. So the estimate is the value at level 0 of a line fitted to the
//! logarithms of all levels' errors.

use std::ops::Range;

use glam::Vec4;
use rayon::prelude::*;

use crate::plan::INSTANCES;

/// Relative errors of a pixel count at most as much as this.
pub const MAX_PIXEL_ERROR: f64 = 2.0;
/// Fraction of the pixels that count, those with the least error.
pub const COUNTED_PIXELS: f64 = 0.995;
/// Number of passes before which nothing is estimated: with fewer, estimates are often off by half.
pub const MIN_PASSES: u32 = 8;

/// Maximum number of blocks of passes.
const MAX_BLOCKS: usize = 32;
/// Highest level of contrasts: 16 blocks tell their signs apart.
const MAX_LEVEL: u32 = 4;
/// Slopes of the line, of natural logarithms by level: from independent passes to errors that fall as 1/N.
const SLOPES: Range<f64> = 0.0..0.5 * std::f64::consts::LN_2;

/// Relative error of an image, three channels for each pixel: the root mean square over pixels of
///
/// e = min(sqrt(mean over channels of (a - b)^2 / (b^2 + 0.01 mean(b)^2)), [`MAX_PIXEL_ERROR`]),
///
/// where a is the image, b the reference and mean(b) its mean over pixels and channels, without the pixels of the
/// greatest error: [`COUNTED_PIXELS`] are counted. So a few bright spikes or unresolved edges do not outweigh an image. A
/// pixel that is not finite has the maximum error.
pub fn relative_error(image: &[f64], reference: &[f64]) -> f64 {
    let finite = reference.iter().filter(|b| b.is_finite());
    let level = finite.clone().sum::<f64>() / finite.count().max(1) as f64;
    let floor = 0.01 * level * level;
    // Of nothing against nothing: 0 / 0.
    let square = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b) * (a - b) / (b * b + floor) };
    let of_pixel = |(a, b): (&[f64], &[f64])| {
        let mean = a.iter().zip(b).map(square).sum::<f64>() / 3.0;
        // The bound also replaces what is no number.
        mean.min(MAX_PIXEL_ERROR * MAX_PIXEL_ERROR)
    };
    let mut squares: Vec<f64> = image.chunks_exact(3).zip(reference.chunks_exact(3)).map(of_pixel).collect();
    let counted = (COUNTED_PIXELS * squares.len() as f64).ceil() as usize;
    if counted == 0 {
        return 0.0;
    }
    squares.select_nth_unstable_by(counted - 1, f64::total_cmp);
    squares.truncate(counted);
    // In order, so that the sum does not depend on how the selection permutes.
    squares.sort_unstable_by(f64::total_cmp);
    (squares.iter().sum::<f64>() / counted as f64).sqrt()
}

/// Sums of radiance over the first passes, at a few pixels.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sums {
    /// Passes of each instance.
    counts: [u32; INSTANCES as usize],
    /// Three channels for each pixel, for each instance; empty before its first pass.
    radiance: [Vec<f64>; INSTANCES as usize],
}

static NO_SUMS: Sums = Sums { counts: [0; INSTANCES as usize], radiance: [const { Vec::new() }; INSTANCES as usize] };

impl Sums {
    fn passes(&self) -> u32 {
        self.counts.iter().sum()
    }
}

/// Sums after each of some 16 to 32 blocks of passes, all of the same length but for the last.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// Passes in a block, the same number of each instance.
    block: u32,
    /// After each complete block.
    kept: Vec<Sums>,
    latest: Sums,
}

impl Default for History {
    fn default() -> Self {
        History { block: INSTANCES, kept: Vec::new(), latest: Sums::default() }
    }
}

/// Passes of one instance in one block.
struct Cell<'a> {
    instance: usize,
    /// Passes in its middle, of all passes.
    middle: f64,
    passes: f64,
    before: &'a [f64],
    after: &'a [f64],
}

impl Cell<'_> {
    /// Sum of its passes.
    fn sum(&self, i: usize) -> f64 {
        self.after[i] - self.before.get(i).copied().unwrap_or(0.0)
    }
}

impl History {
    /// Number of passes.
    pub fn passes(&self) -> u32 {
        self.latest.passes()
    }

    /// Adds a pass of an instance, by the instance's sums after it: two vectors for each pixel, as
    /// [`Probe`](crate::pass::probe::Probe) copies them.
    pub fn add(&mut self, instance: u32, sums: &[Vec4]) {
        let of_pixel = |sum: &[Vec4]| (sum[0].as_dvec4() + sum[1].as_dvec4()).truncate().to_array();
        let instance = instance as usize;
        self.latest.counts[instance] += 1;
        self.latest.radiance[instance] = sums.chunks_exact(2).flat_map(of_pixel).collect();
        if self.passes().is_multiple_of(self.block) {
            if self.kept.len() == MAX_BLOCKS {
                // Two blocks become one.
                self.block *= 2;
                let block = self.block;
                self.kept.retain(|sums| sums.passes().is_multiple_of(block));
            }
            if self.passes().is_multiple_of(self.block) {
                self.kept.push(self.latest.clone());
            }
        }
    }

    /// The error of the image; `None`: unknown.
    pub fn estimate(&self) -> Option<f32> {
        let passes = f64::from(self.passes());
        let [a, b] = &self.latest.radiance;
        if self.passes() < MIN_PASSES || a.len() != b.len() {
            return None;
        }
        let image: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a + b) / passes).collect();
        let cells = self.cells();
        // Two blocks have level 1.
        let levels = self.kept.len().max(1).ilog2().min(MAX_LEVEL) + 1;
        let contrasts: Vec<(u32, u32, bool)> = (0..levels)
            .flat_map(|level| match level {
                0 => vec![(0, 0, true)],
                _ => (1 << (level - 1)..1 << level).flat_map(|h| [(level, h, false), (level, h, true)]).collect(),
            })
            .collect();
        let squares: Vec<(u32, f64)> = contrasts
            .into_par_iter()
            .map(|(level, h, opposed)| {
                let sign = |cell: &Cell| {
                    let sign = walsh(h, cell.middle / passes);
                    if opposed && cell.instance == 1 { -sign } else { sign }
                };
                let signs: Vec<f64> = cells.iter().map(sign).collect();
                (level, mean_square_error(&image, &cells, &signs, passes))
            })
            .collect();
        let of_level = |level: u32| {
            let of_level = squares.iter().filter(|(l, _)| *l == level).map(|(_, square)| square);
            (of_level.clone().sum::<f64>() / of_level.count() as f64).sqrt()
        };
        let errors: Vec<f64> = (0..levels).map(of_level).collect();
        Some(at_level_0(&errors) as f32)
    }

    /// All sums as bytes, little endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let words = [self.block, self.kept.len() as u32].into_iter().chain(self.sums().flat_map(|sums| sums.counts));
        let mut bytes: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
        let numbers = self.sums().flat_map(|sums| sums.radiance.iter().flatten());
        bytes.extend(numbers.flat_map(|x| x.to_le_bytes()));
        bytes
    }

    /// Restores a history of `pixels` pixels from [`History::to_bytes`]; `None`: wrong number of bytes.
    pub fn from_bytes(bytes: &[u8], pixels: usize) -> Option<History> {
        let (words, rest) = bytes.split_at_checked(8)?;
        let word = |at: usize| words.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
        let (block, kept) = (word(0)?, word(4)? as usize);
        if block == 0 || kept > MAX_BLOCKS {
            return None;
        }
        let (counts, numbers) = rest.split_at_checked(4 * INSTANCES as usize * (kept + 1))?;
        let mut numbers =
            numbers.chunks_exact(8).map(|c| f64::from_le_bytes([c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]]));
        let sums = |counts: &[u8]| {
            let counts = std::array::from_fn(|i| u32::from_le_bytes(std::array::from_fn(|byte| counts[4 * i + byte])));
            // An instance without a pass has no sums.
            let radiance =
                counts.map(|count: u32| numbers.by_ref().take(if count > 0 { 3 * pixels } else { 0 }).collect());
            Sums { counts, radiance }
        };
        let mut all: Vec<Sums> = counts.chunks_exact(4 * INSTANCES as usize).map(sums).collect();
        let latest = all.pop()?;
        let history = History { block, kept: all, latest };
        (history.to_bytes().len() == bytes.len()).then_some(history)
    }

    /// The sums that are kept, then the latest.
    fn sums(&self) -> impl Iterator<Item = &Sums> {
        self.kept.iter().chain([&self.latest])
    }

    fn cells<'a>(&'a self) -> Vec<Cell<'a>> {
        let unfinished = Some(&self.latest).filter(|sums| !sums.passes().is_multiple_of(self.block));
        let ends = self.kept.iter().chain(unfinished);
        let starts = [&NO_SUMS].into_iter().chain(&self.kept);
        let of_block = |(start, end): (&'a Sums, &'a Sums)| {
            (0..INSTANCES as usize).map(move |instance| Cell {
                instance,
                middle: 0.5 * f64::from(start.passes() + end.passes()),
                passes: f64::from(end.counts[instance] - start.counts[instance]),
                before: &start.radiance[instance],
                after: &end.radiance[instance],
            })
        };
        starts.zip(ends).flat_map(of_block).collect()
    }
}

/// A Walsh function, which is 1 or -1, of `t` in [0, 1): with `changes` changes of sign, up to 15.
fn walsh(changes: u32, t: f64) -> f64 {
    // The Gray code of the number of changes selects binary digits of t, the first by its lowest bit.
    let digits = ((t * f64::from(1 << MAX_LEVEL)) as u32).reverse_bits() >> (32 - MAX_LEVEL);
    if ((changes ^ changes >> 1) & digits).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 }
}

/// Mean square of the errors of the image if its limit is the image plus or minus a contrast.
fn mean_square_error(image: &[f64], cells: &[Cell], signs: &[f64], passes: f64) -> f64 {
    // Blocks of different lengths leave a remainder of the mean, whose loss is made up for.
    let excess = signs.iter().zip(cells).map(|(s, cell)| s * cell.passes).sum::<f64>() / passes;
    let scale = 1.0 / (1.0 - excess * excess).max(0.1).sqrt();
    let contrast = |i: usize| {
        let sum = signs.iter().zip(cells).map(|(s, cell)| s * cell.sum(i)).sum::<f64>();
        (sum / passes - excess * image[i]) * scale
    };
    let contrast: Vec<f64> = (0..image.len()).map(contrast).collect();
    let from = |sign: f64| {
        let limit: Vec<f64> = image.iter().zip(&contrast).map(|(m, c)| m + sign * c).collect();
        relative_error(image, &limit).powi(2)
    };
    0.5 * (from(1.0) + from(-1.0))
}

/// Value at 0 of a line through the logarithms of `errors`, by level. Weights are square roots of the numbers of
/// contrasts: in between those for contrasts that know nothing of one another and those for contrasts that deviate together.
fn at_level_0(errors: &[f64]) -> f64 {
    if errors.contains(&0.0) {
        // Logarithms tell nothing: passes are equal, or nearly so.
        return errors.iter().copied().fold(0.0, f64::max);
    }
    let points = (0..).zip(errors).map(|(level, error)| (f64::from(level), error.ln(), f64::from(1 << level).sqrt()));
    let total: f64 = points.clone().map(|(_, _, w)| w).sum();
    let level = points.clone().map(|(l, _, w)| w * l).sum::<f64>() / total;
    let mean = points.clone().map(|(_, y, w)| w * y).sum::<f64>() / total;
    let square: f64 = points.clone().map(|(l, _, w)| w * (l - level).powi(2)).sum();
    let slope = if square > 0.0 { points.map(|(l, y, w)| w * (l - level) * y).sum::<f64>() / square } else { 0.0 };
    (mean - slope.clamp(SLOPES.start, SLOPES.end) * level).exp()
}
