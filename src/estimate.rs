//! The error of the mean of all passes, estimated from the passes.
//!
//! The estimate is of [`relative_error`] of the image against its limit, the mean of infinitely many passes with the same
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

use crate::film::MAX_PASSES;
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
    (squares[..counted].iter().sum::<f64>() / counted as f64).sqrt()
}

/// Which of the pixels that were added count.
pub type Counts<'a> = &'a dyn Fn(usize) -> bool;

/// Sums of radiance over the first passes, at a few pixels.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sums {
    /// Passes of each instance.
    counts: [u32; INSTANCES as usize],
    /// Three channels for each pixel, for each instance; empty before its first pass.
    radiance: [Vec<f64>; INSTANCES as usize],
    /// The part of `radiance` that the filter added.
    gain: [Vec<f64>; INSTANCES as usize],
}

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
    /// The part of the gain that the image leaves out, for each pixel.
    shares: Vec<f64>,
}

impl Default for History {
    fn default() -> Self {
        History { block: INSTANCES, kept: Vec::new(), latest: Sums::default(), shares: Vec::new() }
    }
}

impl History {
    /// Number of passes.
    pub fn passes(&self) -> u32 {
        self.latest.passes()
    }

    /// Adds a pass of an instance, by the instance's sums after it: three vectors for each pixel, as
    /// [`Probe`](crate::pass::probe::Probe) copies them.
    pub fn add(&mut self, instance: u32, sums: &[Vec4]) {
        let of_pixel = |sum: &[Vec4]| (sum[0].as_dvec4() + sum[1].as_dvec4()).truncate().to_array();
        let instance = instance as usize;
        self.latest.counts[instance] += 1;
        self.latest.radiance[instance] = sums.chunks_exact(3).flat_map(of_pixel).collect();
        // The sum of the gain is that of both instances.
        let mut gain: Vec<f64> = sums.chunks_exact(3).flat_map(|sum| sum[2].as_dvec4().truncate().to_array()).collect();
        let other = &self.latest.gain[1 - instance];
        gain.iter_mut().zip(other).for_each(|(gain, other)| *gain -= other);
        self.latest.gain[instance] = gain;
        self.shares = sums.chunks_exact(3).map(|sum| f64::from(sum[2].w)).collect();
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
        self.estimate_of(&|_| true)
    }

    /// The error of the pixels of which `counts` holds, by their place among those that were added; `None`: unknown.
    pub fn estimate_of(&self, counts: Counts) -> Option<f32> {
        let passes = f64::from(self.passes());
        let [a, b] = [0, 1].map(|instance| self.shown(&self.latest, instance, counts));
        if self.passes() < MIN_PASSES || a.len() != b.len() {
            return None;
        }
        let image: Vec<f64> = a.iter().zip(&b).map(|(a, b)| (a + b) / passes).collect();
        // Two blocks have level 1.
        let levels = self.kept.len().max(1).ilog2().min(MAX_LEVEL);
        let mut contrasts = self.cells(levels, (a.len(), counts));
        walsh_transform(&mut contrasts);
        let squares: Vec<f64> = contrasts.par_iter().map(|sum| mean_square_error(&image, sum, passes)).collect();
        let half = 1 << levels;
        let of_level = |level: u32| {
            let functions = if level == 0 { 0..1 } else { 1 << (level - 1)..1 << level };
            // The first of all is the image itself.
            let of_level: Vec<f64> =
                functions.flat_map(|w| [w, w + half]).filter(|&w| w > 0).map(|w| squares[w]).collect();
            (of_level.iter().sum::<f64>() / of_level.len() as f64).sqrt()
        };
        let errors: Vec<f64> = (0..=levels).map(of_level).collect();
        Some(at_level_0(&errors) as f32)
    }

    /// Sums of radiance of an instance, as far as the image shows it.
    fn shown(&self, sums: &Sums, instance: usize, counts: Counts) -> Vec<f64> {
        let (radiance, gain) = (&sums.radiance[instance], &sums.gain[instance]);
        let of_pixel = |i: usize| (3 * i..3 * i + 3).map(move |k| radiance[k] - self.shares[i] * gain[k]);
        (0..radiance.len() / 3).filter(|&i| counts(i)).flat_map(of_pixel).collect()
    }

    /// Sums of radiance of 2^levels cells of each instance, and each one's number of passes as a last number. The index of
    /// a cell has the instance in the highest bit and then the binary digits of its place in time, the first as the
    /// lowest bit.
    fn cells(&self, levels: u32, (numbers, counts): (usize, Counts)) -> Vec<Vec<f64>> {
        let mut cells = vec![vec![0.0; numbers + 1]; (INSTANCES as usize) << levels];
        let unfinished = Some(&self.latest).filter(|sums| !sums.passes().is_multiple_of(self.block));
        let mut start = &Sums::default();
        for end in self.kept.iter().chain(unfinished) {
            let middle = 0.5 * f64::from(start.passes() + end.passes()) / f64::from(self.passes());
            let place = ((middle * f64::from(1 << MAX_LEVEL)) as u32).reverse_bits() >> (32 - MAX_LEVEL);
            let place = place as usize & ((1 << levels) - 1);
            for instance in 0..INSTANCES as usize {
                let cell = &mut cells[place + (instance << levels)];
                let last = cell.len() - 1;
                cell[last] += f64::from(end.counts[instance] - start.counts[instance]);
                cell.iter_mut().zip(self.shown(end, instance, counts)).for_each(|(sum, x)| *sum += x);
                cell.iter_mut().zip(self.shown(start, instance, counts)).for_each(|(sum, x)| *sum -= x);
            }
            start = end;
        }
        cells
    }

    /// All sums as bytes, little endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let words = [self.block, self.kept.len() as u32].into_iter().chain(self.sums().flat_map(|sums| sums.counts));
        let mut bytes: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
        let numbers = self.sums().flat_map(|sums| sums.radiance.iter().chain(&sums.gain).flatten());
        bytes.extend(numbers.chain(&self.shares).flat_map(|x| x.to_le_bytes()));
        bytes
    }

    /// Restores a history of `pixels` pixels from [`History::to_bytes`]; `None`: wrong number of bytes, or
    /// passes that there cannot be.
    pub fn from_bytes(bytes: &[u8], pixels: usize) -> Option<History> {
        let (words, rest) = bytes.split_at_checked(8)?;
        let word = |at: usize| words.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
        let (block, kept) = (word(0)?, word(4)? as usize);
        if block == 0 || block > MAX_PASSES || kept > MAX_BLOCKS {
            return None;
        }
        let (counts, numbers) = rest.split_at_checked(4 * INSTANCES as usize * (kept + 1))?;
        let mut numbers =
            numbers.chunks_exact(8).map(|c| f64::from_le_bytes([c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]]));
        let sums = |counts: &[u8]| {
            let counts = std::array::from_fn(|i| u32::from_le_bytes(std::array::from_fn(|byte| counts[4 * i + byte])));
            // An instance without a pass has no sums.
            let [radiance, gain] = [(); 2].map(|()| {
                counts.map(|count: u32| numbers.by_ref().take(if count > 0 { 3 * pixels } else { 0 }).collect())
            });
            Sums { counts, radiance, gain }
        };
        let mut all: Vec<Sums> = counts.chunks_exact(4 * INSTANCES as usize).map(sums).collect();
        let latest = all.pop()?;
        let history = History { block, kept: all, latest, shares: numbers.collect() };
        let complete = |sums: &Sums| {
            let mut arrays = sums.counts.iter().zip(sums.radiance.iter().zip(&sums.gain));
            let wanted = |count: u32| if count > 0 { 3 * pixels } else { 0 };
            arrays.all(|(&count, (radiance, gain))| [radiance.len(), gain.len()] == [wanted(count); 2])
        };
        let passes = |sums: &Sums| sums.counts.iter().map(|&count| u64::from(count)).sum::<u64>();
        let grows = |(a, b): (&Sums, &Sums)| a.counts.iter().zip(b.counts).all(|(a, b)| *a <= b);
        // Then those before have no more.
        if passes(&history.latest) > u64::from(MAX_PASSES) || !history.sums().zip(history.sums().skip(1)).all(grows) {
            return None;
        }
        let shares = if history.passes() > 0 { pixels } else { 0 };
        let complete = history.sums().all(complete) && history.shares.len() == shares;
        (complete && history.to_bytes().len() == bytes.len()).then_some(history)
    }

    /// The sums that are kept, then the latest.
    fn sums(&self) -> impl Iterator<Item = &Sums> {
        self.kept.iter().chain([&self.latest])
    }
}

/// Replaces 2^n arrays by their sums with the signs of the Walsh functions: array i gets the sign -1 in sum w if an odd number
/// of bits are set in both i and w.
fn walsh_transform(arrays: &mut [Vec<f64>]) {
    let mut stride = 1;
    while stride < arrays.len() {
        for pairs in arrays.chunks_exact_mut(2 * stride) {
            let (low, high) = pairs.split_at_mut(stride);
            for (low, high) in low.iter_mut().zip(high) {
                for (a, b) in low.iter_mut().zip(high) {
                    (*a, *b) = (*a + *b, *a - *b);
                }
            }
        }
        stride *= 2;
    }
}

/// Mean square of the errors of the image if its limit is the image plus or minus a contrast, of which `sum` has the sums
/// with signs, and the sum of the signs themselves as a last number.
fn mean_square_error(image: &[f64], sum: &[f64], passes: f64) -> f64 {
    // Blocks of different lengths leave a part of the mean, whose loss is made up for.
    let excess = sum[image.len()] / passes;
    let scale = 1.0 / (1.0 - excess * excess).max(0.1).sqrt();
    let contrast = |(m, sum): (&f64, &f64)| (sum / passes - excess * m) * scale;
    let from = |sign: f64| {
        let limit: Vec<f64> = image.iter().zip(sum).map(|(m, s)| m + sign * contrast((m, s))).collect();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::{key, random_f32};

    /// Nearly normal, with mean 0 and variance 1.
    fn normal(seed: u32, a: u32, b: u32) -> f64 {
        (0..12).map(|i| f64::from(random_f32(key(seed, i, a, b)))).sum::<f64>() - 6.0
    }

    /// Sums of passes whose pixels `radiance(pass, pixel)` gives, and the image.
    fn history(passes: u32, pixels: u32, radiance: impl Fn(u32, u32) -> f64) -> (History, Vec<f64>) {
        let mut history = History::default();
        let image = go_on(&mut history, 0..passes, pixels, radiance);
        (history, image)
    }

    fn go_on(history: &mut History, passes: Range<u32>, pixels: u32, radiance: impl Fn(u32, u32) -> f64) -> Vec<f64> {
        let split = |&x: &f64| [x as f32, (x - f64::from(x as f32)) as f32, 0.0].map(Vec4::splat);
        let mut sums = [(); INSTANCES as usize].map(|()| vec![0.0; pixels as usize]);
        for pass in 0..passes.end {
            let sums = &mut sums[(pass % INSTANCES) as usize];
            (0..).zip(sums.iter_mut()).for_each(|(pixel, sum)| *sum += radiance(pass, pixel));
            if pass >= passes.start {
                history.add(pass % INSTANCES, &sums.iter().flat_map(split).collect::<Vec<_>>());
            }
        }
        let [a, b] = sums;
        a.iter().zip(&b).flat_map(|(a, b)| [(a + b) / f64::from(passes.end); 3]).collect()
    }

    #[test]
    fn pixels_that_do_not_count_change_nothing() {
        let noise = |pass, pixel| 2.0 + 0.3 * normal(3, pass, pixel);
        let (alone, _) = history(16, 200, noise);
        // Lamps, and pixels that show nothing, in between.
        let (all, _) = history(16, 400, |pass, pixel| match pixel % 4 {
            0 | 1 => noise(pass, pixel / 4 * 2 + pixel % 4),
            2 => 0.0,
            _ => 5000.0 + normal(4, pass, pixel),
        });
        assert_eq!(all.estimate_of(&|i| i % 4 < 2), alone.estimate());
        assert!(all.estimate() < alone.estimate().map(|error| 0.1 * error));
    }

    #[test]
    fn errors_are_relative_and_bounded_and_the_greatest_are_left_out() {
        let reference = vec![2.0; 3 * 1000];
        let floor = 0.01 * 4.0;
        let tenth: Vec<f64> = reference.iter().map(|b| b * 1.1).collect();
        assert!((relative_error(&tenth, &reference) - (0.04f64 / (4.0 + floor)).sqrt()).abs() < 1e-12);
        assert_eq!(relative_error(&reference, &reference), 0.0);
        // 5 of 1000 pixels may be anything, and no pixel counts more than the maximum.
        for wrong in [1e6, f64::NAN, f64::INFINITY] {
            let mut image = reference.clone();
            image[..15].fill(wrong);
            assert_eq!(relative_error(&image, &reference), 0.0, "{wrong}");
            image[15..18].fill(wrong);
            assert!((relative_error(&image, &reference) - (4.0f64 / 995.0).sqrt()).abs() < 1e-12, "{wrong}");
            image.fill(wrong);
            assert_eq!(relative_error(&image, &reference), MAX_PIXEL_ERROR, "{wrong}");
        }
        assert_eq!(relative_error(&[0.0; 9], &[0.0; 9]), 0.0);
        assert_eq!(relative_error(&[1.0; 9], &[0.0; 9]), MAX_PIXEL_ERROR);
        assert_eq!(relative_error(&[], &[]), 0.0);
    }

    #[test]
    fn walsh_functions_are_orthogonal() {
        let unit = |i: usize| (0..8).map(|j| if i == j { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
        let mut rows: Vec<Vec<f64>> = (0..8).map(unit).collect();
        walsh_transform(&mut rows);
        for (w, row) in rows.iter().enumerate() {
            for (i, &sign) in row.iter().enumerate() {
                assert_eq!(sign, if (w & i).count_ones() % 2 == 0 { 1.0 } else { -1.0 });
            }
            for (v, other) in rows.iter().enumerate() {
                let product: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                assert_eq!(product, if v == w { 8.0 } else { 0.0 });
            }
        }
    }

    #[test]
    fn blocks_merge_and_cells_share_all_passes() {
        for passes in [8, 9, 31, 32, 63, 64, 65, 66, 127, 128, 129, 130, 200, 333] {
            let (history, image) = history(passes, 2, |pass, pixel| f64::from(pass + pixel));
            assert!(history.kept.len() <= MAX_BLOCKS && (passes < 64 || history.kept.len() >= MAX_BLOCKS / 2));
            for (i, sums) in (1..).zip(&history.kept) {
                assert_eq!(sums.passes(), i * history.block);
                assert_eq!(sums.counts[0], sums.counts[1]);
            }
            assert!(passes - history.block < history.kept.last().unwrap().passes());
            for levels in [1, 2] {
                let cells = history.cells(levels, (history.latest.radiance[0].len(), &|_| true));
                let total = |i: usize| cells.iter().map(|cell| cell[i]).sum::<f64>();
                assert_eq!(total(6), f64::from(passes));
                assert!((total(0) - image[0] * f64::from(passes)).abs() < 1e-6, "{passes}");
                // Each cell has its part of the passes, to a block's length.
                let share = f64::from(passes) / cells.len() as f64;
                for cell in &cells {
                    assert!((cell[6] - share).abs() <= f64::from(history.block), "{} of {passes}", cell[6]);
                    assert!(cell[6] > 0.0);
                }
            }
        }
    }

    /// Estimate by error, for seeds; the limit is 1 in all pixels.
    fn ratios(passes: u32, pixels: u32, radiance: impl Fn(u32, u32, u32) -> f64) -> Vec<f64> {
        let ratio = |seed| {
            let (history, image) = history(passes, pixels, |pass, pixel| radiance(seed, pass, pixel));
            f64::from(history.estimate().unwrap()) / relative_error(&image, &vec![1.0; image.len()])
        };
        (0..16).map(ratio).collect()
    }

    #[test]
    fn estimates_of_independent_passes_are_right() {
        for passes in [8, 16, 23, 64, 90] {
            // Errors of single pixels; those of 20 groups of pixels; those of pixels together with one of the image.
            let single = ratios(passes, 400, |seed, pass, pixel| 1.0 + 0.2 * normal(seed, pass, pixel));
            let groups = ratios(passes, 400, |seed, pass, pixel| 1.0 + 0.2 * normal(seed, pass, pixel % 20));
            let both = ratios(passes, 400, |seed, pass, pixel| {
                1.0 + 0.2 * normal(seed, pass, pixel) + 0.08 * normal(seed, pass, 1000)
            });
            for (what, ratios, wanted) in [("single", single, 15), ("groups", groups, 11), ("both", both, 11)] {
                let good = ratios.iter().filter(|r| (0.77..=1.3).contains(*r)).count();
                let mean = ratios.iter().map(|r| r.ln()).sum::<f64>() / 16.0;
                println!("{what}, {passes} passes: {good} of 16, mean logarithm {mean:.3}");
                assert!(good >= wanted && mean.abs() < 0.15, "{what}, {passes} passes: {ratios:.2?}");
            }
        }
    }

    #[test]
    fn an_error_that_all_pixels_share_is_not_averaged_away() {
        // The error of one run is one number; only its mean square over many can be known.
        let estimate = |seed| {
            let (history, _) = history(64, 10, |pass, _| 1.0 + 0.5 * normal(seed, pass, 0));
            f64::from(history.estimate().unwrap()).powi(2)
        };
        let mean = ((0..32).map(estimate).sum::<f64>() / 32.0).sqrt() / (0.5 / 8.0);
        assert!((0.75..1.25).contains(&mean), "{mean}");
    }

    #[test]
    fn passes_that_cancel_are_noticed() {
        // Errors of consecutive passes of an instance are differences of random numbers, so those of the mean fall as 1/N.
        let error = |seed, pass: u32, pixel| {
            let d = |i: u32| normal(seed + 100 * (pass % 2), i, pixel);
            0.5 * (d(pass / 2 + 1) - d(pass / 2))
        };
        let ratios = ratios(64, 400, |seed, pass, pixel| 1.0 + error(seed, pass, pixel));
        // If passes were taken for independent the ratio would be 5.6, the root of half the number of passes of an instance.
        assert!(ratios.iter().all(|r| (0.7..2.0).contains(r)), "{ratios:.2?}");
    }

    #[test]
    fn the_part_of_the_gain_that_the_image_leaves_out_is_no_part_of_its_error() {
        let own = |pass, pixel| 1.0 + 0.5 * normal(3, pass, pixel);
        let gain = |pass, pixel| 0.5 + 0.25 * normal(4, pass, pixel);
        for share in [0.0f32, 0.5, 1.0] {
            let mut with_gain = History::default();
            let mut sums = [[[0.0f64; 50]; 2]; 2];
            for pass in 0..40 {
                let instance = (pass % INSTANCES) as usize;
                for pixel in 0..50 {
                    let g = gain(pass, pixel);
                    sums[instance][0][pixel as usize] += own(pass, pixel) + g;
                    sums[instance][1][pixel as usize] += g;
                }
                let of_pixel = |pixel: usize| {
                    let (l, all) = (sums[instance][0][pixel], sums[0][1][pixel] + sums[1][1][pixel]);
                    [
                        Vec4::splat(l as f32),
                        Vec4::splat((l - f64::from(l as f32)) as f32),
                        Vec4::splat(all as f32).with_w(share),
                    ]
                };
                with_gain.add(pass % INSTANCES, &(0..50).flat_map(of_pixel).collect::<Vec<_>>());
            }
            let left = |pass, pixel| own(pass, pixel) + f64::from(1.0 - share) * gain(pass, pixel);
            let [found, expected] = [with_gain.estimate(), history(40, 50, left).0.estimate()].map(Option::unwrap);
            assert!((found / expected - 1.0).abs() < 1e-4, "{found} for {expected}");
            let restored = History::from_bytes(&with_gain.to_bytes(), 50);
            assert_eq!(restored, Some(with_gain));
        }
    }

    #[test]
    fn what_is_no_number_is_no_small_error() {
        let spoilt = |pass: u32, pixel: u32| if pass == 3 && pixel < 50 { f64::NAN } else { 1.0 };
        let (history, _) = history(8, 100, spoilt);
        assert!(history.estimate().is_some_and(|e| e > 1.0), "{:?}", history.estimate());
        assert_eq!(super::tests::history(7, 1, |_, _| 1.0).0.estimate(), None);
        assert_eq!(super::tests::history(8, 1, |_, _| 1.0).0.estimate(), Some(0.0));
        assert_eq!(History::default().estimate(), None);
    }

    #[test]
    fn bytes_come_back_and_go_on() {
        let radiance = |pass, pixel| 1.0 + 0.5 * normal(7, pass, pixel);
        let (whole, _) = history(70, 5, radiance);
        for stop in [0, 1, 2, 33, 64, 69] {
            let (part, _) = history(stop, 5, radiance);
            let bytes = part.to_bytes();
            let mut restored = History::from_bytes(&bytes, 5).unwrap();
            assert_eq!(restored, part);
            go_on(&mut restored, stop..70, 5, radiance);
            assert_eq!((restored.estimate(), &restored), (whole.estimate(), &whole));
            assert_eq!(History::from_bytes(&bytes[..bytes.len() - 1], 5), None);
            // Counts that shrink, and counts beyond all passes.
            for count in [u32::MAX, MAX_PASSES + 1] {
                let mut other = bytes.clone();
                other[8..12].copy_from_slice(&count.to_le_bytes());
                assert_eq!(History::from_bytes(&other, 5), None, "{count}");
            }
            assert_eq!(History::from_bytes(&[bytes.as_slice(), &[0]].concat(), 5), None);
            assert!(stop == 0 || History::from_bytes(&bytes, 6).is_none());
        }
    }
}
