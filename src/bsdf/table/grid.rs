//! The function of a table, and how directions are chosen by it.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use rayon::prelude::*;

use super::MAX_ASYMMETRY;
use crate::bsdf::{MIN_ALPHA, basis, reflect};
use crate::plan::MIN_LIGHT_ALPHA;

/// Steps of [`Grid::lowered`].
const LOWERINGS: u32 = 32;

/// Nodes of each axis of a widened table.
pub(super) const WIDE_NODES: usize = 25;

/// Side of the square of sample points that a widened table is made from.
const WIDE_SAMPLES: usize = 16;

/// Cosine of the angle from the mirror direction within which a mirror image shows light: the tangent is 2.
const COS_OF_IMAGE: f32 = 0.447_213_6;

/// A reciprocal function of two directions, trilinear between nodes, with the sums by which directions are chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// From 0 to 1.
    pub(super) cosines: Vec<f32>,
    /// From 0 to pi.
    pub(super) azimuths: Vec<f32>,
    /// f: cos theta_o varies slowest, azimuth fastest.
    pub(super) values: Vec<f32>,
    /// For each value the integral of f over the azimuth from 0 to its own.
    pub(super) partial: Vec<f32>,
    /// For each pair of cosines the integral of f cos theta_i over all azimuths and over cos theta_i from 0 to its own.
    pub(super) reflected: Vec<f32>,
}

/// The direction by its cosine and azimuth about +z.
pub(super) fn direction(cos: f32, azimuth: f32) -> Vec3 {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
}

/// From a to b.
pub(super) fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Position in [0, 1] for a uniform number, of a density that goes linearly from a to b.
fn sample_linear(a: f32, b: f32, u: f32) -> f32 {
    let root = mix(a * a, b * b, u).max(0.0).sqrt();
    (u * (a + b) / (a + root).max(1e-37)).clamp(0.0, 1.0)
}

/// Position in [0, 1] for a uniform number, of a density that is the product of two functions that go linearly from a to b.
fn sample_product([a0, b0]: [f32; 2], [a1, b1]: [f32; 2], u: f32) -> f32 {
    // Six times the integrals of the three parts.
    let parts = [2.0 * a0 * a1, a0 * b1 + b0 * a1, 2.0 * b0 * b1];
    let target = u * (parts[0] + parts[1] + parts[2]);
    let within = |before: f32, part: usize| ((target - before) / parts[part].max(1e-37)).clamp(0.0, 1.0);
    if target < parts[0] {
        1.0 - (1.0 - within(0.0, 0)).cbrt()
    } else if target < parts[0] + parts[1] {
        0.5 - ((1.0 - 2.0 * within(parts[0], 1)).asin() / 3.0).sin()
    } else {
        within(parts[0] + parts[1], 2).cbrt()
    }
}

/// The interval of an axis, of two nodes at least, that holds x, and the weight of its end.
pub(super) fn interval(nodes: &[f32], x: f32) -> (usize, f32) {
    let k = cell(nodes.len(), |k| nodes[k] <= x);
    (k, ((x - nodes[k]) / (nodes[k + 1] - nodes[k])).clamp(0.0, 1.0))
}

/// The last of `count` - 1 intervals that begins at or before what is looked for, or else the first.
fn cell(count: usize, begins_before: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (0, count - 1);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if begins_before(middle) { low = middle } else { high = middle }
    }
    low
}

impl Grid {
    /// From axes with their ends. With the part of the light by which exchanged directions differ; an error if it is too much.
    pub(super) fn new(cosines: Vec<f32>, azimuths: Vec<f32>, mut values: Vec<f32>) -> Result<(Grid, f64), String> {
        let (n, m) = (cosines.len(), azimuths.len());
        // Trapezoidal weights.
        let weights = |nodes: &[f32]| -> Vec<f32> {
            let at = |k: usize| nodes[k.min(nodes.len() - 1)];
            (0..nodes.len()).map(|k| 0.5 * (at(k + 1) - at(k.saturating_sub(1)))).collect()
        };
        let of_azimuth = weights(&azimuths);
        for (pair, row) in values.chunks_exact_mut(m).enumerate() {
            if pair / n == n - 1 || pair % n == n - 1 {
                let mean = row.iter().zip(&of_azimuth).map(|(f, w)| f * w).sum::<f32>() / PI;
                row.fill(mean);
            }
        }
        let of_cosine = weights(&cosines);
        let (mut light, mut difference, mut worst) = (0.0, 0.0, (0.0, 0));
        for i in 0..n * n * m {
            let (o, wi, azimuth) = (i / (m * n), i / m % n, i % m);
            if wi > o {
                continue;
            }
            let exchanged = (wi * n + o) * m + azimuth;
            let (one, other) = (values[i], values[exchanged]);
            let weight = f64::from(of_cosine[o] * of_cosine[wi] * of_azimuth[azimuth] * cosines[o] * cosines[wi]);
            let by = weight * f64::from((one - other).abs());
            light += weight * 0.5 * f64::from(one + other);
            difference += by;
            if by > worst.0 {
                worst = (by, i);
            }
            let mean = 0.5 * (one + other);
            (values[i], values[exchanged]) = (mean, mean);
        }
        let asymmetry = if light > 0.0 { difference / light } else { 0.0 };
        if asymmetry > MAX_ASYMMETRY {
            let i = worst.1;
            let (a, b, azimuth) = (cosines[i / m % n], cosines[i / (m * n)], azimuths[i % m]);
            return Err(format!(
                "values for exchanged directions differ by {:.0} % of the light, most at cosines {a} and {b}, azimuth {azimuth}; a reflectance is the same both ways, and up to {:.0} % are taken for errors",
                100.0 * asymmetry,
                100.0 * MAX_ASYMMETRY
            ));
        }
        let mut grid = Grid { cosines, azimuths, values, partial: Vec::new(), reflected: Vec::new() };
        grid.sum();
        Ok((grid, asymmetry))
    }

    /// Makes both kinds of sums.
    fn sum(&mut self) {
        let (n, m) = (self.cosines.len(), self.azimuths.len());
        self.partial = Vec::with_capacity(n * n * m);
        for row in self.values.chunks_exact(m) {
            let mut sum = 0.0;
            self.partial.push(0.0);
            for l in 1..m {
                sum += 0.5 * f64::from(row[l - 1] + row[l]) * f64::from(self.azimuths[l] - self.azimuths[l - 1]);
                self.partial.push(sum as f32);
            }
        }
        self.reflected = Vec::with_capacity(n * n);
        for o in 0..n {
            let whole = |i: usize| f64::from(self.partial[(o * n + i) * m + m - 1]);
            let mut sum = 0.0;
            self.reflected.push(0.0);
            for i in 1..n {
                let (low, width) = (f64::from(self.cosines[i - 1]), f64::from(self.cosines[i] - self.cosines[i - 1]));
                // Both sides of the plane of incidence.
                sum += 2.0 * width * (whole(i - 1) * (0.5 * low + width / 6.0) + whole(i) * (0.5 * low + width / 3.0));
                self.reflected.push(sum as f32);
            }
        }
    }

    fn scaled(self, factor: f32) -> Grid {
        let by = |values: Vec<f32>| values.into_iter().map(|v| v * factor).collect();
        Grid { values: by(self.values), partial: by(self.partial), reflected: by(self.reflected), ..self }
    }

    /// With albedos of at most 1: the values of each pair of cosines multiplied by a factor of either.
    pub(super) fn lowered(mut self) -> Grid {
        let (n, m) = (self.cosines.len(), self.azimuths.len());
        for step in 0..=LOWERINGS {
            let albedos = self.albedos();
            if albedos.iter().all(|albedo| *albedo <= 1.0) {
                break;
            }
            // The last step lowers more than needed, if at all.
            let power = if step == LOWERINGS { 1.0 } else { 0.5 };
            let factors: Vec<f32> = albedos.iter().map(|albedo| albedo.max(1.0).powf(-power) as f32).collect();
            for (pair, row) in self.values.chunks_exact_mut(m).enumerate() {
                let factor = factors[pair / n] * factors[pair % n];
                row.iter_mut().for_each(|value| *value *= factor);
            }
            self.sum();
        }
        self
    }

    /// Albedo of light from each cosine: the integral of f cos_i.
    pub(super) fn albedos(&self) -> Vec<f64> {
        (0..self.cosines.len()).map(|row| f64::from(self.albedo(row))).collect()
    }

    /// Alpha of a GGX lobe about as wide.
    pub(super) fn width(&self) -> f32 {
        let (n, m) = (self.cosines.len(), self.azimuths.len());
        let (mut light, mut peaks) = (0.0, 0.0);
        for (o, albedo) in self.albedos().into_iter().enumerate() {
            let cos = f64::from(self.cosines[o]);
            let at = |k: usize| f64::from(self.cosines[k.min(n - 1)]);
            let weight = cos * (at(o + 1) - at(o.saturating_sub(1)));
            let peak = |i: usize| {
                let row = &self.values[(o * n + i) * m..][..m];
                f64::from(self.cosines[i]) * f64::from(row.iter().copied().fold(0.0, f32::max))
            };
            light += weight * albedo;
            peaks += weight * cos * (0..n).map(peak).fold(0.0, f64::max);
        }
        let alpha2 = if peaks > 0.0 { light / (4.0 * std::f64::consts::PI * peaks) } else { 1.0 };
        (alpha2.sqrt() as f32).clamp(MIN_ALPHA, 1.0)
    }

    /// See [`Table::image_share`].
    pub(super) fn image_share(&self) -> f32 {
        let (mut all, mut shown) = (0.0, 0.0);
        for (row, &cos) in self.cosines.iter().enumerate() {
            let wo = direction(cos, 0.0);
            let light = cos * self.albedo(row);
            for i in 0..64 {
                let wi = self.sample(Vec3::Z, wo, [i / 8, i % 8].map(|k| (k as f32 + 0.5) / 8.0));
                all += light;
                shown += if wi.dot(reflect(wo, Vec3::Z)) > COS_OF_IMAGE { light } else { 0.0 };
            }
        }
        if all > 0.0 { shown / all } else { 0.0 }
    }

    /// A table about as wide as GGX of alpha [`MIN_LIGHT_ALPHA`], of one of a lesser alpha. It reflects less than this one from any cosine of a
    /// tenth or more, at least a quarter.
    pub(super) fn widened(&self, alpha: f32) -> Result<Grid, String> {
        let kappa = 0.5 / (MIN_LIGHT_ALPHA * MIN_LIGHT_ALPHA - alpha * alpha).max(1e-3);
        let even = |end: f32| (0..WIDE_NODES).map(move |k| end * k as f32 / (WIDE_NODES - 1) as f32);
        // By the angle, from grazing on.
        let mut cosines: Vec<f32> = even(0.5 * PI).map(f32::sin).collect();
        cosines[WIDE_NODES - 1] = 1.0;
        let azimuths: Vec<f32> = even(PI).collect();
        let kernel = |cos: f32| kappa / (TAU * (1.0 - (-2.0 * kappa).exp())) * (kappa * (cos - 1.0)).exp();
        let row = |&o: &f32| {
            let wo = direction(o, 0.0);
            let points = (0..WIDE_SAMPLES * WIDE_SAMPLES).map(|i| {
                let u = [i / WIDE_SAMPLES, i % WIDE_SAMPLES].map(|k| (k as f32 + 0.5) / WIDE_SAMPLES as f32);
                let wi = self.sample(Vec3::Z, wo, u);
                // Few of the samples are near the horizon, where each would weigh much.
                (wi, self.over_pdf(wi.z.max(0.01), o) / (WIDE_SAMPLES * WIDE_SAMPLES) as f32)
            });
            let points: Vec<(Vec3, f32)> = points.collect();
            let mut values = Vec::with_capacity(WIDE_NODES * WIDE_NODES);
            for &i in &cosines {
                for &azimuth in &azimuths {
                    let wi = direction(i, azimuth);
                    let part = |(at, f): &(Vec3, f32)| {
                        f * (kernel(wi.dot(*at)) + kernel(wi.dot(*at * Vec3::new(1.0, 1.0, -1.0))))
                    };
                    values.push(points.iter().map(part).sum::<f32>());
                }
            }
            values
        };
        let values: Vec<Vec<f32>> = cosines.par_iter().map(row).collect();
        let values = values.concat();
        // Convolved over one of the directions, it is reciprocal only on average.
        let (mut halves, n, m) = (values.clone(), WIDE_NODES, WIDE_NODES);
        for (i, value) in halves.iter_mut().enumerate() {
            *value = 0.5 * (values[i] + values[(i / m % n * n + i / (m * n)) * m + i % m]);
        }
        let (wide, _) = Grid::new(cosines, azimuths, halves)?;
        let exact = self.albedos();
        let least = (wide.albedos().into_iter().zip(&wide.cosines))
            .filter(|(albedo, cos)| *albedo > 0.0 && **cos >= 0.1)
            .map(|(albedo, cos)| {
                let (k, t) = interval(&self.cosines, *cos);
                (exact[k] + (exact[k + 1] - exact[k]) * f64::from(t)) / albedo
            })
            .fold(1.0, f64::min);
        Ok(wide.scaled(least.max(0.25) as f32))
    }

    /// f for unit directions above the surface.
    pub(in crate::bsdf) fn eval(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let (cos_i, cos_o) = (n.dot(wi), n.dot(wo));
        let azimuth = n.dot(wi.cross(wo)).abs().atan2(wi.dot(wo) - cos_i * cos_o);
        let (o, y) = interval(&self.cosines, cos_o);
        let (i, x) = interval(&self.cosines, cos_i);
        let (l, z) = interval(&self.azimuths, azimuth);
        let along_azimuth = |o: usize, i: usize| {
            let at = (o * self.cosines.len() + i) * self.azimuths.len() + l;
            mix(self.values[at], self.values[at + 1], z)
        };
        let along_cos_i = |o: usize| mix(along_azimuth(o, i), along_azimuth(o, i + 1), x);
        mix(along_cos_i(o), along_cos_i(o + 1), y)
    }

    /// The albedo by a row of cos theta_o.
    fn albedo(&self, row: usize) -> f32 {
        self.reflected[(row + 1) * self.cosines.len() - 1]
    }

    /// f over the density of [`Grid::sample`], by the cosines.
    fn over_pdf(&self, cos_i: f32, cos_o: f32) -> f32 {
        let (o, y) = interval(&self.cosines, cos_o);
        mix(self.albedo(o), self.albedo(o + 1), y) / cos_i.max(1e-7)
    }

    /// Density over solid angle of [`Grid::sample`] for unit directions above the surface.
    pub(in crate::bsdf) fn pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let over = self.over_pdf(n.dot(wi), n.dot(wo));
        if over > 0.0 { self.eval(n, wi, wo) / over } else { 0.0 }
    }

    /// A direction wi for wo, above the surface.
    pub(in crate::bsdf) fn sample(&self, n: Vec3, wo: Vec3, u: [f32; 2]) -> Vec3 {
        let (count, turns) = (self.cosines.len(), self.azimuths.len());
        let (row, y) = interval(&self.cosines, n.dot(wo));
        // One of both rows.
        let (first, second) = ((1.0 - y) * self.albedo(row), y * self.albedo(row + 1));
        let share = first / (first + second).max(1e-37);
        let (row, along) =
            if u[0] < share { (row, u[0] / share) } else { (row + 1, (u[0] - share) / (1.0 - share).max(1e-7)) };
        // The cosine.
        let sums = &self.reflected[row * count..][..count];
        let target = along * sums[count - 1];
        let i = cell(count, |k| sums[k] <= target);
        let rest = ((target - sums[i]) / (sums[i + 1] - sums[i]).max(1e-37)).clamp(0.0, 1.0);
        let part = |i: usize, l: usize| self.partial[(row * count + i) * turns + l];
        let t =
            sample_product([part(i, turns - 1), part(i + 1, turns - 1)], [self.cosines[i], self.cosines[i + 1]], rest);
        let cos = mix(self.cosines[i], self.cosines[i + 1], t);
        // The azimuth, of either sign.
        let sum = |l: usize| mix(part(i, l), part(i + 1, l), t);
        let target = (2.0 * u[1] - 1.0).abs() * sum(turns - 1);
        let l = cell(turns, |l| sum(l) <= target);
        let rest = ((target - sum(l)) / (sum(l + 1) - sum(l)).max(1e-37)).clamp(0.0, 1.0);
        let value = |l: usize| {
            let at = (row * count + i) * turns + l;
            mix(self.values[at], self.values[at + turns], t)
        };
        let z = sample_linear(value(l), value(l + 1), rest);
        let azimuth = mix(self.azimuths[l], self.azimuths[l + 1], z);
        let flat = wo - n * n.dot(wo);
        let x = if flat.length_squared() > 1e-12 { flat.normalize() } else { basis(n).0 };
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let across = if u[1] < 0.5 { -azimuth.sin() } else { azimuth.sin() };
        x * (sin * azimuth.cos()) + n.cross(x) * (sin * across) + n * cos
    }

    pub(super) fn append_to(&self, words: &mut Vec<u32>) {
        words.extend([self.cosines.len() as u32, self.azimuths.len() as u32]);
        let all = [&self.cosines, &self.azimuths, &self.values, &self.partial, &self.reflected];
        words.extend(all.into_iter().flatten().map(|x| x.to_bits()));
    }
}
