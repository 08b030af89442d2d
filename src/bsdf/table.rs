//! Lobes by tabulated values, as from measurements.
//!
//! A [`Table`] holds f(wi, wo) in 1/sr without Fresnel's term at the nodes of cos theta_i, cos theta_o and the azimuth between both
//! directions (0 where they are on the same side of the normal, pi in the plane of mirror reflection). From that [`Table::new`] makes one
//! function for all passes, trilinear on a [`Grid`] whose two axes of cosines are the same:
//!
//! - nodes of both axes of cosines, of 0 and of 1, and azimuths 0 and pi; beyond the outermost given nodes values are constant;
//! - a direction along the normal has no azimuth: values there are means over it;
//! - f is replaced by (f(wi, wo) + f(wo, wi)) / 2, which is reciprocal. Where that changes more than [`MAX_ASYMMETRY`] of the reflected light the
//!   table is refused;
//! - the albedo a is linear between nodes of cos theta_o, so where it is at most 1 at the nodes it is nowhere more. An excess (a - 1) cos theta_o of up to
//!   [`MAX_EXCESS`], and a up to [`MAX_ALBEDO`], count as errors of interpolation, which are greatest towards the horizon: values become s(cos theta_i) s(cos theta_o) f,
//!   with s found by iteration and 1 where nothing is to be lowered. Above that the table is refused.
//!
//! # Directions
//!
//! ```text
//! p(wi) = f(wi, wo) cos_i / a(wo)       a(wo) = integral of f cos_i, the albedo
//! ```
//!
//! f is linear between rows of cos theta_o, and so is a. A sample takes one of both rows at random, then an interval of cos theta_i from the row's cumulative sums.
//! Within it the density of t, from 0 to 1, is the product of two linear functions: the cosine, and the integral of f over the azimuth. With their values A0, A1, c0, c1
//! at the ends that is a mixture of three densities that have closed inverses,
//!
//! ```text
//! A0 c0 (1 - t)^2 + (A0 c1 + A1 c0) t (1 - t) + A1 c1 t^2
//! t = 1 - (1 - u)^(1/3),   1/2 - sin(arcsin(1 - 2 u) / 3),   u^(1/3)
//! ```
//!
//! The azimuth comes from cumulative sums, which are linear in t; within an interval f is linear. So p is exact, and no sample has a weight above the albedo.
//!
//! # In one number
//!
//! A lobe is one number wherever it is stored, [`Reflectance::alpha`](super::Reflectance::alpha); between 1 and 2 it stands for a table: above the bits
//! of 1.0, 13 bits of the index of the material that has the table + 1, 9 bits of its width in steps of a 50th of an octave, and a bit for the
//! widened table. The width is the alpha of a GGX lobe about as wide, by the mean over incidence of the greatest f cos_i cos_o, which for GGX is
//! near 1 / (4 pi alpha^2).
//!
//! # Lobes of lights
//!
//! A table narrower than [`MIN_LIGHT_ALPHA`] has a widened one: f convolved over wi with a von Mises-Fisher kernel whose width makes up for
//! the difference (kappa = 1 / (2 (least^2 - alpha^2)); what it moves below the horizon is reflected there), made reciprocal again, at fixed nodes.

use std::f32::consts::{PI, TAU};
use std::ops::Range;
use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;
use serde::Deserialize;

use super::{MIN_ALPHA, anisotropic, basis, reflect};
use crate::error::{Error, Result};
use crate::input::Inputs;
use crate::plan::MIN_LIGHT_ALPHA;
use crate::scene::Material;

/// Maximum number of nodes on an axis of a [`Grid`]; eight halvings find an interval.
pub const MAX_NODES: usize = 256;

/// Maximum number of values of a [`Grid`]: 16 MiB on the device.
pub const MAX_VALUES: usize = 1 << 21;

/// Greatest part of the reflected light by which a table may differ from its reciprocal mean.
pub const MAX_ASYMMETRY: f64 = 0.2;

/// Part of the reflected light from which on such a difference is warned of.
const NOTED_ASYMMETRY: f64 = 0.02;

/// Greatest excess of the albedo over 1, times the cosine, that is lowered.
pub const MAX_EXCESS: f64 = 0.05;

/// Greatest albedo that is lowered, at any cosine.
pub const MAX_ALBEDO: f64 = 2.0;

/// Steps of [`Grid::lowered`].
const LOWERINGS: u32 = 32;

/// Exclusive upper bound of the indices of materials with tables.
pub const MAX_MATERIALS: usize = (1 << 13) - 1;

/// Nodes closer than this are one.
const SAME_NODE: f32 = 1e-6;

/// Nodes of each axis of a widened table.
const WIDE_NODES: usize = 25;

/// Side of the square of sample points that a widened table is made from.
const WIDE_SAMPLES: usize = 16;

/// Cosine of the angle from the mirror direction within which a mirror image shows light: the tangent is 2.
const COS_OF_IMAGE: f32 = 0.447_213_6;

/// Bits of 1.0.
const BASE: u32 = 0x3f80_0000;

/// Bits of the index of a material + 1.
const MATERIAL_SHIFT: u32 = 10;

/// An isotropic reflectance distribution, without Fresnel's term.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    exact: Grid,
    /// For the lobes of lights, if they must be wider.
    wide: Option<Grid>,
    alpha: f32,
    image_share: f32,
}

/// A reciprocal function of two directions, trilinear between nodes, with the sums by which directions are chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// From 0 to 1.
    cosines: Vec<f32>,
    /// From 0 to pi.
    azimuths: Vec<f32>,
    /// f: cos theta_o varies slowest, azimuth fastest.
    values: Vec<f32>,
    /// For each value the integral of f over the azimuth from 0 to its own.
    partial: Vec<f32>,
    /// For each pair of cosines the integral of f cos theta_i over all azimuths and over cos theta_i from 0 to its own.
    reflected: Vec<f32>,
}

/// The file format of [`Table::load`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TableFile {
    cos_i: Vec<f32>,
    cos_o: Vec<f32>,
    azimuth: Vec<f32>,
    values: Vec<f32>,
}

/// What a table is made from.
struct Raw {
    cos_i: Vec<f32>,
    cos_o: Vec<f32>,
    azimuth: Vec<f32>,
    values: Vec<f32>,
}

impl Table {
    /// From the nodes of the three axes, and the values f in 1/sr at all their combinations: `cos_i` varies slowest, `azimuth` fastest.
    ///
    /// `azimuth` is the angle in radians between the projections of the two directions, 0 to pi; pi is the plane of mirror
    /// reflection. Cosines are between 0 and 1. The nodes need not be evenly spaced. Their spacing must be smaller than the lobe: a peak between
    /// two nodes is lost.
    ///
    /// Errors: axes that do not increase or are out of range, a wrong number of values, values that are negative or not finite, more
    /// than [`MAX_NODES`] nodes or [`MAX_VALUES`] values once both axes of cosines are joined, albedos above [`MAX_EXCESS`] or [`MAX_ALBEDO`], exchanged
    /// directions that differ by more than [`MAX_ASYMMETRY`].
    pub fn new(cos_i: Vec<f32>, cos_o: Vec<f32>, azimuth: Vec<f32>, values: Vec<f32>) -> Result<Table> {
        let name = String::from("table of reflectances");
        match Table::of(&Raw { cos_i, cos_o, azimuth, values }) {
            Ok((table, _)) => Ok(table),
            Err(message) => Err(Error::Resource { name, message }),
        }
    }

    /// The table of a function of (wi, wo) about +z, at the same cosines for both directions. Errors: as [`Table::new`].
    pub fn tabulate(cosines: &[f32], azimuths: &[f32], f: impl Fn(Vec3, Vec3) -> f32) -> Result<Table> {
        let mut values = Vec::with_capacity(cosines.len() * cosines.len() * azimuths.len());
        for &i in cosines {
            for &o in cosines {
                values.extend(azimuths.iter().map(|&azimuth| f(direction(i, azimuth), direction(o, 0.0))));
            }
        }
        Table::new(cosines.to_vec(), cosines.to_vec(), azimuths.to_vec(), values)
    }

    /// Reads a TOML file with the four arrays of [`Table::new`]: `cos_i`, `cos_o`, `azimuth`, `values`.
    pub fn load(path: &Path) -> Result<Table> {
        Table::load_from(&Inputs::anywhere(), path)
    }

    /// [`Table::load`] as one of the files of a scene.
    pub(crate) fn load_from(inputs: &Inputs, path: &Path) -> Result<Table> {
        let text = inputs.read_text(path)?;
        let line = |span: Range<usize>| text[..span.start].matches('\n').count() + 1;
        let file: TableFile = toml::from_str(&text).map_err(|e| Error::File {
            path: path.to_path_buf(),
            line: e.span().map(line),
            message: e.message().trim_end().to_string(),
        })?;
        let TableFile { cos_i, cos_o, azimuth, values } = file;
        let (table, asymmetry) =
            Table::of(&Raw { cos_i, cos_o, azimuth, values }).map_err(|message| Error::file(path, message))?;
        if asymmetry > NOTED_ASYMMETRY {
            let percent = 100.0 * asymmetry;
            log::warn!("{}: exchanged directions differ by {percent:.0} %; their mean is used", path.display());
        }
        Ok(table)
    }

    /// With the part of the light by which exchanged directions differ.
    fn of(raw: &Raw) -> Result<(Table, f64), String> {
        raw.check()?;
        let (cosines, azimuths) = raw.joined()?;
        let mut values = Vec::with_capacity(cosines.len() * cosines.len() * azimuths.len());
        for &o in &cosines {
            for &i in &cosines {
                values.extend(azimuths.iter().map(|&azimuth| raw.at(i, o, azimuth)));
            }
        }
        let (exact, asymmetry) = Grid::new(cosines, azimuths, values)?;
        for (albedo, &cos) in exact.albedos().into_iter().zip(&exact.cosines).rev() {
            if (albedo - 1.0) * f64::from(cos) > MAX_EXCESS || albedo > MAX_ALBEDO {
                let (degrees, most) = (cos.acos().to_degrees(), (1.0 + MAX_EXCESS / f64::from(cos)).min(MAX_ALBEDO));
                return Err(format!(
                    "light from cosine {cos} ({degrees:.0} degrees from the normal) is reflected {albedo:.3} times; a surface reflects no more than it receives, and up to {most:.2} is taken for an error"
                ));
            }
        }
        let exact = exact.lowered();
        let alpha = exact.width();
        let wide = (alpha < MIN_LIGHT_ALPHA).then(|| exact.widened(alpha)).transpose()?;
        let image_share = exact.image_share();
        Ok((Table { exact, wide, alpha, image_share }, asymmetry))
    }

    /// f(wi, wo) in 1/sr about +z, for unit directions above the surface.
    pub fn eval(&self, wi: Vec3, wo: Vec3) -> f32 {
        self.exact.eval(Vec3::Z, wi, wo)
    }

    /// Alpha of a GGX lobe about as wide, in [[`MIN_ALPHA`], 1].
    pub fn alpha(&self) -> f32 {
        self.alpha
    }

    /// Part of the light that is reflected to where a mirror image shows it: within an angle of tangent 2 from the mirror direction.
    pub(crate) fn image_share(&self) -> f32 {
        self.image_share
    }

    /// The function itself, and what the lobes of lights take in its place.
    pub(crate) fn grids(&self) -> [&Grid; 2] {
        [&self.exact, self.wide.as_ref().unwrap_or(&self.exact)]
    }
}

/// Whether an alpha stands for a table.
pub fn is_table(alpha: f32) -> bool {
    alpha > 1.0 && alpha < 2.0
}

/// The number for the table of a material by its index, below [`MAX_MATERIALS`].
pub fn number(material: u32, table: &Table) -> f32 {
    f32::from_bits(BASE + ((material + 1) << MATERIAL_SHIFT | anisotropic::step_of(table.alpha) << 1))
}

/// The table that an alpha stands for.
pub(super) fn find(materials: &[Material], alpha: f32) -> Option<&Grid> {
    if !is_table(alpha) {
        return None;
    }
    let word = alpha.to_bits() - BASE;
    let material = materials.get((word >> MATERIAL_SHIFT).checked_sub(1)? as usize)?;
    Some(material.lobe.as_ref()?.grids()[(word & 1) as usize])
}

/// The number for the same table, widened to at least this alpha; of any that it is wider than the widened table has [`MIN_LIGHT_ALPHA`].
pub(super) fn widened(alpha: f32, least: f32) -> f32 {
    let word = alpha.to_bits() - BASE;
    let (step, least) = (word >> 1 & 0x1ff, anisotropic::step_of(least));
    if step <= least { alpha } else { f32::from_bits(BASE + (word & !0x3ff | least << 1 | 1)) }
}

/// Alpha of a GGX lobe about as wide.
pub(super) fn width_of(alpha: f32) -> f32 {
    anisotropic::alpha_of((alpha.to_bits() - BASE) >> 1 & 0x1ff)
}

/// The words of the tables of all materials on the device: for each material up to the last that has one, where its table and its widened table begin; each of
/// these is the numbers of cosines and azimuths, both axes, the values, and both kinds of sums.
pub(crate) fn words(materials: &[Material]) -> Vec<u32> {
    let count = materials.iter().rposition(|m| m.lobe.is_some()).map_or(0, |last| last + 1);
    let mut words = vec![0; 2 * count];
    let mut known: Vec<(*const Table, [u32; 2])> = Vec::new();
    for (i, table) in materials[..count].iter().enumerate().filter_map(|(i, m)| Some((i, m.lobe.as_deref()?))) {
        let same = known.iter().find(|(other, _)| std::ptr::eq(*other, table)).map(|(_, at)| *at);
        let at = same.unwrap_or_else(|| {
            let first = words.len() as u32;
            table.exact.append_to(&mut words);
            let second = if table.wide.is_some() { words.len() as u32 } else { first };
            table.wide.iter().for_each(|wide| wide.append_to(&mut words));
            [first, second]
        });
        known.push((table, at));
        words[2 * i..2 * i + 2].copy_from_slice(&at);
    }
    // A buffer has one word at least.
    words.resize(words.len().max(4), 0);
    words
}

fn direction(cos: f32, azimuth: f32) -> Vec3 {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
}

fn mix(a: f32, b: f32, t: f32) -> f32 {
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

impl Raw {
    fn check(&self) -> Result<(), String> {
        check_axis("cos_i", &self.cos_i, 1.0)?;
        check_axis("cos_o", &self.cos_o, 1.0)?;
        check_axis("azimuth", &self.azimuth, PI)?;
        let [a, b, c] = [self.cos_i.len(), self.cos_o.len(), self.azimuth.len()];
        if self.values.len() != a.saturating_mul(b).saturating_mul(c) {
            return Err(format!(
                "{} values for {a} x {b} x {c} nodes; there must be one for each node",
                self.values.len()
            ));
        }
        if let Some(i) = self.values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            let (cos_i, cos_o, azimuth) = (self.cos_i[i / (b * c)], self.cos_o[i / c % b], self.azimuth[i % c]);
            let value = self.values[i];
            return Err(format!(
                "value {i}, at cos_i {cos_i}, cos_o {cos_o}, azimuth {azimuth}, is {value}; it must be finite and not negative"
            ));
        }
        Ok(())
    }

    /// The axis of both cosines, with its ends, and that of the azimuth.
    fn joined(&self) -> Result<(Vec<f32>, Vec<f32>), String> {
        let axis = |nodes: &mut dyn Iterator<Item = f32>, end: f32| {
            // The ends first, so that they stay exact.
            let mut all: Vec<f32> =
                nodes.filter(|x| (SAME_NODE..=end - SAME_NODE).contains(x)).chain([0.0, end]).collect();
            all.sort_by(f32::total_cmp);
            all.dedup_by(|b, a| *b - *a < SAME_NODE);
            all
        };
        let cosines = axis(&mut self.cos_i.iter().chain(&self.cos_o).copied(), 1.0);
        let azimuths = axis(&mut self.azimuth.iter().copied(), PI);
        let (n, m) = (cosines.len(), azimuths.len());
        if n.max(m) > MAX_NODES || n * n * m > MAX_VALUES {
            return Err(format!(
                "{n} different cosines and {m} azimuths; there may be {MAX_NODES} of each, and {MAX_VALUES} values, the square of the first number by the second"
            ));
        }
        Ok((cosines, azimuths))
    }

    /// Trilinear, and constant beyond the outermost nodes.
    fn at(&self, cos_i: f32, cos_o: f32, azimuth: f32) -> f32 {
        let (i, x) = locate(&self.cos_i, cos_i);
        let (j, y) = locate(&self.cos_o, cos_o);
        let (k, z) = locate(&self.azimuth, azimuth);
        let along_azimuth = |i: usize, j: usize| {
            let row = (i * self.cos_o.len() + j) * self.azimuth.len();
            mix(self.values[row + k[0]], self.values[row + k[1]], z)
        };
        let along_cos_o = |i: usize| mix(along_azimuth(i, j[0]), along_azimuth(i, j[1]), y);
        mix(along_cos_o(i[0]), along_cos_o(i[1]), x)
    }
}

fn check_axis(name: &str, nodes: &[f32], max: f32) -> Result<(), String> {
    if nodes.is_empty() {
        return Err(format!("{name} has no nodes; one at least is needed"));
    }
    // A file holds pi in decimals.
    if let Some(x) = nodes.iter().find(|x| !(0.0..=max * 1.000_001).contains(*x)) {
        return Err(format!("{name} has a node at {x}; nodes must lie between 0 and {max}"));
    }
    if let Some(pair) = nodes.windows(2).find(|pair| pair[0] >= pair[1]) {
        return Err(format!("{name} has the node {} before {}; nodes must increase", pair[0], pair[1]));
    }
    Ok(())
}

/// The two nodes around x and the weight of the second. `nodes` is not empty and increases.
fn locate(nodes: &[f32], x: f32) -> ([usize; 2], f32) {
    let last = nodes.len() - 1;
    let after = nodes.partition_point(|&node| node <= x);
    if after == 0 || after > last {
        let end = after.min(last);
        return ([end, end], 0.0);
    }
    let (low, high) = (nodes[after - 1], nodes[after]);
    ([after - 1, after], (x - low) / (high - low))
}

/// The interval of an axis, of two nodes at least, that holds x, and the weight of its end.
fn interval(nodes: &[f32], x: f32) -> (usize, f32) {
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
    fn new(cosines: Vec<f32>, azimuths: Vec<f32>, mut values: Vec<f32>) -> Result<(Grid, f64), String> {
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
    fn lowered(mut self) -> Grid {
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
    fn albedos(&self) -> Vec<f64> {
        (0..self.cosines.len()).map(|row| f64::from(self.albedo(row))).collect()
    }

    /// Alpha of a GGX lobe about as wide.
    fn width(&self) -> f32 {
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
    fn image_share(&self) -> f32 {
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
    fn widened(&self, alpha: f32) -> Result<Grid, String> {
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
    pub(super) fn eval(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
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
    pub(super) fn pdf(&self, n: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let over = self.over_pdf(n.dot(wi), n.dot(wo));
        if over > 0.0 { self.eval(n, wi, wo) / over } else { 0.0 }
    }

    /// A direction wi for wo, above the surface.
    pub(super) fn sample(&self, n: Vec3, wo: Vec3, u: [f32; 2]) -> Vec3 {
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

    fn append_to(&self, words: &mut Vec<u32>) {
        words.extend([self.cosines.len() as u32, self.azimuths.len() as u32]);
        let all = [&self.cosines, &self.azimuths, &self.values, &self.partial, &self.reflected];
        words.extend(all.into_iter().flatten().map(|x| x.to_bits()));
    }
}

#[cfg(test)]
mod tests;
