//! Reflectance distributions of glossy lobes, without their Fresnel factor: the input of [`kernels`](super::kernels).
//!
//! Directions are unit vectors away from the surface, whose normal is +z. All lobes but [`Lobe::Anisotropic`] are isotropic.

use std::f32::consts::PI;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::{Vec3, Vec3Swizzles};
use serde::Deserialize;

use crate::bsdf::{MIN_ALPHA, Reflectance, anisotropic, phong};
use crate::error::{Error, Result};
use crate::input::Inputs;

/// Maximum exponent of [`Lobe::Phong`]: the lobe is then as narrow as GGX with the minimum alpha.
pub const MAX_EXPONENT: f32 = 1e6;

/// A glossy lobe.
#[derive(Clone, Debug, PartialEq)]
pub enum Lobe {
    /// The renderer's own lobe ([`Reflectance::eval_specular`]) with F = 1.
    Ggx {
        /// Roughness, [`MIN_ALPHA`] to 1; the square of the perceptual roughness.
        alpha: f32,
    },
    /// The renderer's lobe of two widths ([`anisotropic`]) with F = 1.
    Anisotropic {
        /// The number that stands for it, about +z.
        alpha: f32,
    },
    /// A lobe of constant shape about the mirror direction r (thesis 7.4.2), in the form of Lafortune and Willems 1994, which is
    /// reciprocal and conserves energy: f = (n + 2) / (2 pi) (r.wi)^n.
    ///
    /// `Ns` of an MTL file is the exponent of the cosine at the half vector instead. The renderer reads it as GGX with
    /// alpha^2 = 2 / (Ns + 2); about the mirror direction, which turns twice as fast, its exponent is near Ns / 4.
    Phong {
        /// The exponent n, 1 to [`MAX_EXPONENT`].
        exponent: f32,
    },
    /// The renderer's other lobe ([`phong`]) with F = 1.
    Cosine {
        /// The exponent d, in [`phong::EXPONENTS`].
        exponent: f32,
    },
    /// Tabulated values.
    Table(Arc<Table>),
}

impl Lobe {
    /// The same mirrored in the xz plane.
    pub(super) fn mirrored(&self) -> Lobe {
        let of = |alpha: f32| anisotropic::unpack(alpha, Vec3::Z).map(|grain| grain.along * Vec3::new(1.0, -1.0, 1.0));
        match *self {
            Lobe::Anisotropic { alpha } => Lobe::Anisotropic {
                alpha: of(alpha).map_or(alpha, |along| anisotropic::with_direction(alpha, along, Vec3::Z)),
            },
            ref other => other.clone(),
        }
    }

    /// Whether it is its own mirror image in the plane of incidence, from wherever it is seen.
    pub(super) fn is_isotropic(&self) -> bool {
        !matches!(self, Lobe::Anisotropic { .. })
    }

    /// f(wi, wo) in 1/sr; 0 if either direction is not above the surface.
    pub fn eval(&self, wi: Vec3, wo: Vec3) -> f32 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return 0.0;
        }
        match self {
            Lobe::Ggx { alpha } | Lobe::Anisotropic { alpha } => {
                let white = Reflectance { kd: Vec3::ZERO, f0: Vec3::ONE, f90: 1.0, alpha: *alpha };
                white.eval_specular(Vec3::Z, wi, wo).x
            }
            Lobe::Cosine { exponent } => {
                phong::pdf(Vec3::Z, wi, wo, *exponent) * phong::over_pdf(wi.z, wo.z, *exponent)
            }
            Lobe::Phong { exponent } => {
                // cos^n from the chord, |wi - r|^2 = 2 (1 - cos): near 1 the cosine itself has lost its digits.
                let mirror = Vec3::new(-wo.x, -wo.y, wo.z);
                let one_minus_cos = 0.5 * wi.distance_squared(mirror);
                if one_minus_cos >= 1.0 {
                    return 0.0;
                }
                (exponent + 2.0) / (2.0 * PI) * (exponent * (-one_minus_cos).ln_1p()).exp()
            }
            Lobe::Table(table) => table.eval(wi, wo),
        }
    }

    /// Checks the parameters; the error describes the problem.
    pub(super) fn check(&self) -> Result<(), String> {
        match self {
            Lobe::Ggx { alpha } if !(MIN_ALPHA..=1.0).contains(alpha) => {
                Err(format!("alpha of GGX is {alpha}; it must lie between {MIN_ALPHA} and 1"))
            }
            Lobe::Anisotropic { alpha } if !(alpha.is_finite() && anisotropic::is_anisotropic(*alpha)) => {
                Err(format!("{alpha} stands for no lobe of two widths"))
            }
            Lobe::Phong { exponent } if !(1.0..=MAX_EXPONENT).contains(exponent) => {
                Err(format!("the exponent of Phong is {exponent}; it must lie between 1 and {MAX_EXPONENT}"))
            }
            Lobe::Cosine { exponent } if !phong::EXPONENTS.contains(exponent) => {
                let (low, high) = phong::EXPONENTS.into_inner();
                Err(format!("the exponent of the cosine is {exponent}; it must lie between {low} and {high}"))
            }
            _ => Ok(()),
        }
    }
}

/// An isotropic reflectance distribution given by its values at the nodes of a grid, trilinear between them and constant
/// beyond the outermost ones.
///
/// The nodes need not be evenly spaced. Their spacing must be smaller than the lobe: a peak between two nodes is lost.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    cos_i: Vec<f32>,
    cos_o: Vec<f32>,
    azimuth: Vec<f32>,
    values: Vec<f32>,
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

impl Table {
    /// From the nodes of the three axes, and the values f in 1/sr at all their combinations: `cos_i` varies slowest, `azimuth` fastest.
    ///
    /// `azimuth` is the angle in radians between the projections of the two directions, 0 to pi; pi is the plane of mirror
    /// reflection. Cosines are between 0 and 1. Errors: axes that do not increase or are out of range, a wrong number of
    /// values, values that are negative or not finite.
    pub fn new(cos_i: Vec<f32>, cos_o: Vec<f32>, azimuth: Vec<f32>, values: Vec<f32>) -> Result<Table> {
        let table = Table { cos_i, cos_o, azimuth, values };
        match table.check() {
            Ok(()) => Ok(table),
            Err(message) => Err(Error::Resource { name: String::from("table of reflectances"), message }),
        }
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
        let table = Table { cos_i: file.cos_i, cos_o: file.cos_o, azimuth: file.azimuth, values: file.values };
        table.check().map_err(|message| Error::file(path, message))?;
        Ok(table)
    }

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

    fn eval(&self, wi: Vec3, wo: Vec3) -> f32 {
        let (a, b) = (wi.xy(), wo.xy());
        let azimuth = a.perp_dot(b).abs().atan2(a.dot(b));
        let (i, x) = locate(&self.cos_i, wi.z);
        let (j, y) = locate(&self.cos_o, wo.z);
        let (k, z) = locate(&self.azimuth, azimuth);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let along_azimuth = |i: [usize; 2], n: usize, m: usize| {
            let row = (i[n] * self.cos_o.len() + j[m]) * self.azimuth.len();
            mix(self.values[row + k[0]], self.values[row + k[1]], z)
        };
        let along_cos_o = |n: usize| mix(along_azimuth(i, n, 0), along_azimuth(i, n, 1), y);
        mix(along_cos_o(0), along_cos_o(1), x)
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
mod tests {
    use super::*;

    fn direction(cos: f32, azimuth: f32) -> Vec3 {
        let sin = (1.0 - cos * cos).sqrt();
        Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
    }

    fn message(result: Result<Table>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn table_is_trilinear_and_constant_beyond_its_ends() {
        let f = |a: f32, b: f32, c: f32| 1.0 + 2.0 * a + 3.0 * b + 0.5 * c + a * b * c;
        let (cos_i, cos_o, azimuth) = (vec![0.1, 0.3, 0.9], vec![0.2, 1.0], vec![0.0, 0.5, 2.0, PI]);
        let mut values = Vec::new();
        for &a in &cos_i {
            for &b in &cos_o {
                values.extend(azimuth.iter().map(|&c| f(a, b, c)));
            }
        }
        let table = Lobe::Table(Arc::new(Table::new(cos_i, cos_o, azimuth, values).unwrap()));
        // Multilinear functions are reproduced; the sign of the azimuth does not matter.
        for (a, b, c) in [(0.2, 0.5, 1.0), (0.7, 0.9, -2.5), (0.3, 0.2, 0.5), (0.5, 0.6, 3.1)] {
            let found = table.eval(direction(a, 0.7 + c), direction(b, 0.7));
            let expected = f(a, b, c.abs());
            assert!((found - expected).abs() < 1e-4, "{a} {b} {c}: {found} for {expected}");
        }
        let found = table.eval(direction(0.95, 1.0), direction(0.1, 0.0));
        assert!((found - f(0.9, 0.2, 1.0)).abs() < 1e-4, "{found}");
        assert_eq!(table.eval(Vec3::new(1.0, 0.0, -0.1), Vec3::Z), 0.0);
    }

    #[test]
    fn table_refuses_what_it_cannot_use() {
        let one = || vec![0.5];
        assert!(message(Table::new(vec![], one(), one(), one())).contains("cos_i has no nodes"));
        assert!(message(Table::new(one(), vec![0.5, 0.5], one(), one())).contains("must increase"));
        assert!(message(Table::new(one(), one(), vec![-0.1], one())).contains("azimuth has a node at -0.1"));
        assert!(message(Table::new(vec![f32::NAN], one(), one(), one())).contains("cos_i has a node at NaN"));
        assert!(message(Table::new(one(), one(), one(), vec![1.0; 2])).contains("2 values for 1 x 1 x 1 nodes"));
        let values = vec![1.0, 1.0, f32::INFINITY, 1.0];
        let refused = message(Table::new(vec![0.1, 0.2], one(), vec![0.3, 0.4], values));
        assert!(refused.contains("value 2, at cos_i 0.2, cos_o 0.5, azimuth 0.3, is inf"), "{refused}");
        assert!(message(Table::new(one(), one(), one(), vec![-1.0])).contains("not negative"));
    }

    #[test]
    fn table_from_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lobe.toml");
        let good = "cos_i = [0.5]\ncos_o = [0, 1]\nazimuth = [0, 3.141592653589793]\nvalues = [0.1, 0.2, 0.3, 0.4]\n";
        std::fs::write(&path, good).unwrap();
        let table = Table::load(&path).unwrap();
        assert_eq!(table, Table::new(vec![0.5], vec![0.0, 1.0], vec![0.0, PI], vec![0.1, 0.2, 0.3, 0.4]).unwrap());
        for (text, expected) in [
            (good.replace("cos_o", "cos_x"), "lobe.toml:2: unknown field `cos_x`"),
            (good.replace("0.4", "-0.4"), "lobe.toml: value 3"),
        ] {
            std::fs::write(&path, text).unwrap();
            let refused = message(Table::load(&path));
            assert!(refused.contains(expected), "{refused}");
        }
        assert!(message(Table::load(&folder.path().join("none.toml"))).contains("reading failed"));
    }

    #[test]
    fn phong_is_reciprocal_and_narrow_where_it_should_be() {
        let lobe = Lobe::Phong { exponent: 40.0 };
        let (a, b) = (direction(0.8, 2.9), direction(0.7, 0.0));
        let expected = 42.0 / (2.0 * PI) * a.dot(Vec3::new(-b.x, -b.y, b.z)).powf(40.0);
        assert!((lobe.eval(a, b) / expected - 1.0).abs() < 1e-4);
        assert!((lobe.eval(b, a) / expected - 1.0).abs() < 1e-4);
        // Half its peak at cos^n = 1/2, even if 1 - cos is below the rounding of f32.
        let narrow = Lobe::Phong { exponent: MAX_EXPONENT };
        let half = (2.0 * std::f32::consts::LN_2 / MAX_EXPONENT).sqrt();
        let ratio = narrow.eval(Vec3::new(half.sin(), 0.0, half.cos()), Vec3::Z) / narrow.eval(Vec3::Z, Vec3::Z);
        assert!((ratio - 0.5).abs() < 1e-3, "{ratio}");
        assert_eq!(Lobe::Phong { exponent: 2.0 }.eval(direction(0.1, 0.0), direction(0.1, 0.0)), 0.0);
    }
}
