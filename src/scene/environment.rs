//! Light from all around, infinitely far away: a constant, an image of all directions, or a sky.
//!
//! The image is a table over azimuth and height (latitude and longitude): rows from the zenith to the nadir at equal
//! angles, columns around the horizon at equal angles. Seen from inside with +y up, the middle column lies towards -z,
//! where a default camera looks, and columns go to the right. A texel holds radiance, linear Rec. 709.
//!
//! Texels emit evenly: sampling and lighting take the texel of a direction. What is seen directly, in mirrors or through
//! glass is interpolated between texels.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::fmt;
#[cfg(feature = "images")]
use std::io::Cursor;
use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;

#[cfg(feature = "images")]
use super::openexr;
use crate::error::{Error, Result};
use crate::fingerprint::Fnv;
use crate::input::Inputs;

/// Greatest width of the table; larger images are averaged down over squares of texels.
pub const MAX_WIDTH: u32 = 2048;

/// Radiance from all directions.
#[derive(Clone, PartialEq)]
pub struct Environment {
    /// Name for messages: its file, or its kind.
    pub name: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Radiance, rows from the zenith, `width * height`.
    pub texels: Vec<Vec3>,
    /// Unit vectors of the image in the scene: right of its middle, the zenith, and away from its middle.
    pub axes: [Vec3; 3],
}

impl fmt::Debug for Environment {
    /// With a hash in place of the texels.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut texels = Fnv::default();
        texels.add(bytemuck::cast_slice(&self.texels));
        let Environment { name, width, height, axes, .. } = self;
        write!(f, "Environment({name:?}, {width}x{height}, {axes:?}, {:016x})", texels.0)
    }
}

/// Part of the table that is chosen as a whole, and then a direction in it uniformly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Columns and rows: begin and end.
    pub texels: [[u32; 2]; 2],
    /// Smallest azimuth from the left edge of the image, radians, and its range.
    pub azimuth: [f32; 2],
    /// Cosine of the angle from the zenith at the upper edge, and its (negative) range.
    pub cosine: [f32; 2],
    /// Solid angle, sr.
    pub solid_angle: f32,
    /// Mean radiance over the solid angle.
    pub radiance: Vec3,
}

impl Environment {
    /// The same radiance from everywhere.
    pub fn constant(radiance: Vec3) -> Environment {
        Environment {
            name: String::from("constant"),
            width: 1,
            height: 1,
            texels: vec![radiance],
            axes: [Vec3::X, Vec3::Y, Vec3::Z],
        }
    }

    /// An overcast sky over a grey ground: radiance (1 + 2 sin h) / 3 at the height h above the horizon (the standard
    /// overcast sky of Moon and Spencer 1942), times the zenith's, and below the horizon that of a diffuse ground
    /// of albedo 0.2 under it. The zenith's radiance makes the irradiance on level ground pi: a white Lambertian
    /// surface there is as bright as 1.
    pub fn overcast() -> Environment {
        const HEIGHT: u32 = 64;
        // The irradiance of such a sky is 7 pi / 9 times the zenith's radiance.
        let zenith = 9.0 / 7.0;
        let ground = 0.2;
        let row = |y: u32| {
            let up = (PI * (y as f32 + 0.5) / HEIGHT as f32).cos();
            if up > 0.0 { zenith * (1.0 + 2.0 * up) / 3.0 } else { ground }
        };
        Environment {
            name: String::from("overcast sky"),
            width: 1,
            height: HEIGHT,
            texels: (0..HEIGHT).map(|y| Vec3::splat(row(y))).collect(),
            axes: [Vec3::X, Vec3::Y, Vec3::Z],
        }
    }

    /// Reads an OpenEXR (`.exr`) or Radiance (`.hdr`) image of twice as many columns as rows.
    ///
    /// Errors: a file that cannot be read or decoded, of another shape, with negative or not finite radiance.
    pub fn load(path: &Path) -> Result<Environment> {
        Environment::load_from(&Inputs::anywhere(), path)
    }

    /// [`Environment::load`] as one of the files of a scene.
    pub(super) fn load_from(inputs: &Inputs, path: &Path) -> Result<Environment> {
        let bytes = inputs.read(path)?;
        let (width, height, texels) = decode(inputs, path, &bytes)?;
        if width != 2 * height || height == 0 {
            let message = format!("{width}x{height} pixels; an environment needs twice as many columns as rows");
            return Err(Error::file(path, message));
        }
        if let Some(i) = texels.iter().position(|t| !t.is_finite() || t.min_element() < 0.0) {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let message = format!("pixel {x},{y} holds {}; radiance must be finite and not negative", texels[i]);
            return Err(Error::file(path, message));
        }
        let name = path.display().to_string();
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        Ok(Environment { name, width, height, texels, axes }.reduced())
    }

    /// With squares of texels averaged by their solid angles until there are at most [`MAX_WIDTH`] columns.
    fn reduced(self) -> Environment {
        let n = self.width.div_ceil(MAX_WIDTH);
        if n == 1 {
            return self;
        }
        let (width, height) = (self.width / n, self.height / n);
        let texel = |i: u32| {
            let (x, y) = (i % width * n, i / width * n);
            let mut sum = Vec3::ZERO;
            let mut whole = 0.0;
            for row in y..y + n {
                let weight = self.row_solid_angle(row);
                for column in x..x + n {
                    sum += weight * self.texels[(row * self.width + column) as usize];
                    whole += weight;
                }
            }
            sum / whole
        };
        let texels = (0..width * height).into_par_iter().map(texel).collect();
        Environment { width, height, texels, ..self }
    }

    /// With every radiance multiplied.
    pub fn scaled(mut self, by: Vec3) -> Environment {
        self.texels.iter_mut().for_each(|texel| *texel *= by);
        self
    }

    /// Whether any direction is not black.
    pub fn is_bright(&self) -> bool {
        self.texels.iter().any(|texel| texel.max_element() > 0.0)
    }

    /// With another zenith, and turned about it: an angle in radians, counter-clockwise seen from the zenith.
    pub fn turned(mut self, zenith: Vec3, angle: f32) -> Environment {
        let back = if zenith.z.abs() > 0.9 * zenith.length() { -Vec3::Y * zenith.z.signum() } else { Vec3::Z };
        let zenith = zenith.normalize();
        let right = zenith.cross(back).normalize();
        let back = right.cross(zenith);
        let (sin, cos) = angle.sin_cos();
        self.axes = [right * cos - back * sin, zenith, back * cos + right * sin];
        self
    }

    /// Solid angle of a texel of a row.
    pub(super) fn row_solid_angle(&self, row: u32) -> f32 {
        self.solid_angle([[0, 1], [row, row + 1]])
    }

    /// Solid angle of the texels between columns and rows.
    fn solid_angle(&self, [[left, right], [top, bottom]]: [[u32; 2]; 2]) -> f32 {
        let cosine = |row: u32| (f64::from(row) / f64::from(self.height) * std::f64::consts::PI).cos();
        let around = f64::from(right - left) / f64::from(self.width) * std::f64::consts::TAU;
        ((cosine(top) - cosine(bottom)) * around) as f32
    }

    /// Azimuth from the left edge, in turns, and angle from the zenith in half turns, of a unit direction towards the
    /// environment.
    fn place(&self, direction: Vec3) -> [f32; 2] {
        let [x, y, z] = self.axes.map(|axis| direction.dot(axis));
        [0.5 + x.atan2(-z) / TAU, y.clamp(-1.0, 1.0).acos() / PI]
    }

    /// Column and row of the texel in a direction.
    pub fn texel_at(&self, direction: Vec3) -> [u32; 2] {
        let [u, v] = self.place(direction);
        let (width, height) = (self.width as f32, self.height as f32);
        [((u * width) as u32).min(self.width - 1), ((v * height) as u32).min(self.height - 1)]
    }

    /// Radiance that lights surfaces from a direction: that of its texel.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let [x, y] = self.texel_at(direction);
        self.texels[(y * self.width + x) as usize]
    }

    /// Radiance seen in a direction, interpolated between texels.
    pub fn seen(&self, direction: Vec3) -> Vec3 {
        let [u, v] = self.place(direction);
        let (x, y) = (u * self.width as f32 - 0.5, v * self.height as f32 - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (across, down) = (x - left, y - top);
        let column = |offset: i32| (left as i32 + offset).rem_euclid(self.width as i32) as u32;
        let row = |offset: i32| (top as i32 + offset).clamp(0, self.height as i32 - 1) as u32;
        let texel = |i: i32, j: i32| self.texels[(row(j) * self.width + column(i)) as usize];
        let upper = texel(0, 0) * (1.0 - across) + texel(1, 0) * across;
        let lower = texel(0, 1) * (1.0 - across) + texel(1, 1) * across;
        upper * (1.0 - down) + lower * down
    }

    /// Direction towards the environment from an azimuth, in radians from the left edge, and the cosine of the angle from
    /// the zenith.
    pub fn direction(&self, azimuth: f32, cosine: f32) -> Vec3 {
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let (sin, cos) = (azimuth - PI).sin_cos();
        self.axes[0] * (sine * sin) + self.axes[1] * cosine - self.axes[2] * (sine * cos)
    }

    /// Cuts the table into parts of similar radiance, without those that are black. At most [`MAX_PATCHES`].
    ///
    /// A part whose brightest texel exceeds its mean most, weighed by its solid angle, is halved, until what all exceed
    /// their means by is a twentieth of the whole.
    pub fn patches(&self) -> Vec<Patch> {
        let mut parts = vec![self.part([[0, self.width], [0, self.height]])];
        let whole = parts[0].flux.max(f32::MIN_POSITIVE);
        while parts.len() < MAX_PATCHES {
            let excess: f32 = parts.iter().map(|part| part.excess).sum();
            if excess <= 0.05 * whole {
                break;
            }
            // The first of equal ones, so that the order is always the same.
            let worst = (0..parts.len()).fold(0, |a, b| if parts[b].excess > parts[a].excess { b } else { a });
            if parts[worst].excess <= 0.0 {
                break;
            }
            let halves = parts[worst].halves();
            parts.splice(worst..=worst, halves.map(|half| self.part(half)));
        }
        parts.retain(|part| part.flux > 0.0);
        parts.iter().map(|part| self.patch(part.texels)).collect()
    }

    fn patch(&self, texels: [[u32; 2]; 2]) -> Patch {
        let [[left, right], [top, bottom]] = texels;
        let mut radiance = glam::DVec3::ZERO;
        for row in top..bottom {
            let weight = f64::from(self.row_solid_angle(row));
            for column in left..right {
                radiance += self.texels[(row * self.width + column) as usize].as_dvec3() * weight;
            }
        }
        let solid_angle = self.solid_angle(texels);
        let azimuth = |column: u32| column as f32 / self.width as f32 * TAU;
        let cosine = |row: u32| (f64::from(row) / f64::from(self.height) * std::f64::consts::PI).cos();
        Patch {
            texels,
            azimuth: [azimuth(left), azimuth(right) - azimuth(left)],
            cosine: [cosine(top) as f32, (cosine(bottom) - cosine(top)) as f32],
            solid_angle,
            radiance: (radiance / f64::from(solid_angle)).as_vec3(),
        }
    }
}

/// Maximum number of parts of an environment.
pub const MAX_PATCHES: usize = 1024;

/// A part during the cut.
struct Part {
    texels: [[u32; 2]; 2],
    flux: f32,
    /// Solid angle times how much the brightest texel exceeds the mean.
    excess: f32,
    /// Whether it is wider than high, as angles.
    wide: bool,
}

impl Environment {
    fn part(&self, texels: [[u32; 2]; 2]) -> Part {
        let [[left, right], [top, bottom]] = texels;
        // Rows in parallel, summed in their order.
        let rows: Vec<(f32, f32)> = (top..bottom)
            .into_par_iter()
            .map(|row| {
                let at = (row * self.width) as usize;
                let texels = &self.texels[at + left as usize..at + right as usize];
                let mean = |t: &Vec3| t.element_sum() * (1.0 / 3.0);
                let sum: f64 = texels.iter().map(|t| f64::from(mean(t))).sum();
                ((sum * f64::from(self.row_solid_angle(row))) as f32, texels.iter().map(mean).fold(0.0, f32::max))
            })
            .collect();
        let flux: f32 = rows.iter().map(|row| row.0).sum();
        let greatest = rows.iter().map(|row| row.1).fold(0.0, f32::max);
        let single = right - left == 1 && bottom - top == 1;
        let excess = if single { 0.0 } else { (greatest * self.solid_angle(texels) - flux).max(0.0).min(16.0 * flux) };
        let middle = FRAC_PI_2 - PI * (top + bottom) as f32 / (2 * self.height) as f32;
        let width = (right - left) as f32 / self.width as f32 * TAU * middle.cos().max(0.05);
        let height = (bottom - top) as f32 / self.height as f32 * PI;
        Part { texels, flux, excess, wide: right - left > 1 && (width > height || bottom - top == 1) }
    }
}

impl Part {
    fn halves(&self) -> [[[u32; 2]; 2]; 2] {
        let [[left, right], [top, bottom]] = self.texels;
        if self.wide {
            let middle = left + (right - left) / 2;
            [[[left, middle], [top, bottom]], [[middle, right], [top, bottom]]]
        } else {
            let middle = top + (bottom - top) / 2;
            [[[left, right], [top, middle]], [[left, right], [middle, bottom]]]
        }
    }
}

/// Size and texels of a file.
#[cfg(feature = "images")]
fn decode(inputs: &Inputs, path: &Path, bytes: &[u8]) -> Result<(u32, u32, Vec<Vec3>)> {
    let other = |e: String| Error::file(path, format!("not an environment of the kinds .exr and .hdr: {e}"));
    let format = image::guess_format(bytes).map_err(|e| other(e.to_string()))?;
    Ok(if format == image::ImageFormat::OpenExr {
        let reserve = |bytes| inputs.take(path, bytes).map_err(|e| e.to_string());
        let openexr::Pixels { size: [width, height], values } = openexr::decode(bytes, &reserve).map_err(other)?;
        (width, height, values.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect::<Vec<_>>())
    } else {
        let reader = || image::ImageReader::with_format(Cursor::new(bytes), format);
        let (width, height) = reader().into_dimensions().map_err(|e| other(e.to_string()))?;
        // Decoded, converted, and as texels.
        inputs.take(path, u64::from(width) * u64::from(height) * 3 * size_of::<Vec3>() as u64)?;
        let image = reader().decode().map_err(|e| other(e.to_string()))?.into_rgb32f();
        (width, height, image.into_raw().chunks_exact(3).map(Vec3::from_slice).collect())
    })
}

/// Stands for the decoder where it is not compiled.
#[cfg(not(feature = "images"))]
fn decode(_: &Inputs, path: &Path, _: &[u8]) -> Result<(u32, u32, Vec<Vec3>)> {
    Err(Error::file(path, "this program was built without the feature images, which reads environments"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, texel: impl Fn(u32, u32) -> Vec3) -> Environment {
        let height = width / 2;
        let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
        Environment { width, height, texels, ..Environment::constant(Vec3::ONE) }
    }

    #[test]
    fn directions_find_their_texels() {
        let e = image(16, |x, y| Vec3::new(x as f32, y as f32, 0.0)).turned(Vec3::new(0.2, 1.0, 0.3), 0.7);
        for y in 0..8 {
            for x in 0..16 {
                let cosine = (PI * (y as f32 + 0.5) / 8.0).cos();
                let d = e.direction(TAU * (x as f32 + 0.5) / 16.0, cosine);
                assert!((d.length() - 1.0).abs() < 1e-5);
                assert_eq!(e.texel_at(d), [x, y]);
                assert!((e.seen(d) - e.radiance(d)).abs().max_element() < 1e-3, "{x} {y}");
            }
        }
        // The middle of the image is in front of a default camera, its right half to the right.
        let e = image(16, |x, _| Vec3::splat(x as f32));
        assert!((e.seen(-Vec3::Z).x - 7.5).abs() < 1e-4);
        assert_eq!(e.texel_at(Vec3::new(0.1, 0.05, -1.0)), [8, 3]);
        assert_eq!(e.texel_at(Vec3::new(0.0, 1.0, 0.01))[1], 0);
        let turned = e.turned(Vec3::Y, FRAC_PI_2);
        assert!((turned.seen(-Vec3::X).x - 7.5).abs() < 1e-4, "a quarter to the left");
        let upright = image(16, |x, _| Vec3::splat(x as f32)).turned(Vec3::Z, 0.0);
        assert!((upright.axes[1] - Vec3::Z).length() < 1e-6);
        assert!((upright.seen(Vec3::Y).x - 7.5).abs() < 1e-4, "with z up the middle lies towards +y");
    }

    #[test]
    fn patches_cover_what_shines() {
        let sun = |x: u32, y: u32| {
            Vec3::splat(if (x, y) == (37, 9) {
                1e5
            } else if y < 16 {
                1.0 + x as f32 / 64.0
            } else {
                0.0
            })
        };
        let e = image(64, sun);
        let patches = e.patches();
        assert!(patches.len() <= MAX_PATCHES);
        let mut covered = vec![0; 64 * 32];
        let mut flux = 0.0;
        for patch in &patches {
            let [[left, right], [top, bottom]] = patch.texels;
            for y in top..bottom {
                (left..right).for_each(|x| covered[(y * 64 + x) as usize] += 1);
            }
            flux += patch.solid_angle * patch.radiance.x;
            // Every sample of a patch lies in its texels.
            for (u, v) in [(0.01, 0.01), (0.5, 0.5), (0.99, 0.99)] {
                let d = e.direction(patch.azimuth[0] + u * patch.azimuth[1], patch.cosine[0] + v * patch.cosine[1]);
                let [x, y] = e.texel_at(d);
                assert!((left..right).contains(&x) && (top..bottom).contains(&y));
            }
        }
        for (i, &count) in covered.iter().enumerate() {
            let shines = sun(i as u32 % 64, i as u32 / 64).x > 0.0;
            assert!(count <= 1 && (count == 1 || !shines), "texel {i}");
        }
        let exact: f32 = (0..64 * 32).map(|i| sun(i % 64, i / 64).x * e.row_solid_angle(i / 64)).sum();
        assert!((flux / exact - 1.0).abs() < 1e-4, "{flux} {exact}");
        let of_sun = patches.iter().find(|p| p.texels == [[37, 38], [9, 10]]);
        assert!(of_sun.is_some_and(|p| p.radiance.x == 1e5), "the sun is a part of its own");
        assert_eq!(Environment::constant(Vec3::ONE).patches().len(), 1);
    }

    #[test]
    fn the_sky_lights_level_ground_with_pi() {
        let e = Environment::overcast();
        let sum: f32 = (0..e.height)
            .map(|y| {
                let up = (PI * (y as f32 + 0.5) / e.height as f32).cos();
                e.texels[y as usize].x * up.max(0.0) * e.row_solid_angle(y)
            })
            .sum();
        assert!((sum / PI - 1.0).abs() < 2e-3, "{sum}");
        let whole: f32 = (0..e.height).map(|y| e.row_solid_angle(y)).sum();
        assert!((whole / (4.0 * PI) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn large_images_are_averaged() {
        let e = image(4096, |x, y| Vec3::splat(((x + y) % 2) as f32));
        let reduced = e.reduced();
        assert_eq!((reduced.width, reduced.height), (2048, 1024));
        assert!(reduced.texels.iter().all(|t| (t.x - 0.5).abs() < 1e-3));
    }
}
