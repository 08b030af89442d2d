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

mod grid;

use std::f32::consts::PI;
use std::ops::Range;
use std::path::Path;

use glam::Vec3;
use serde::Deserialize;

pub use self::grid::Grid;
use self::grid::{direction, mix};
use super::anisotropic;
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

/// Exclusive upper bound of the indices of materials with tables.
pub const MAX_MATERIALS: usize = (1 << 13) - 1;

/// Nodes closer than this are one.
const SAME_NODE: f32 = 1e-6;

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

/// The file format of [`Table::load`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TableFile {
    cos_i: Vec<f32>,
    cos_o: Vec<f32>,
    azimuth: Vec<f32>,
    values: Vec<f32>,
}

/// Input of a table.
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

    /// Alpha of a GGX lobe about as wide, in [[`MIN_ALPHA`](super::MIN_ALPHA), 1].
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

#[cfg(test)]
mod tests;
