//! Radiosity textures of spheres (Bastos 1999, 5.5.4): six patches of equal area, the faces of the inscribed cube, each a quadrilateral
//! with a tree of its own, resampled into one texture of latitude and longitude.
//!
//! On a face the coordinates are angles, so that elements are of alike size. Of n cells along the finest patch the texture has 4n
//! columns, of longitude, and 2n rows, of latitude from the south pole up. Beyond the left and the right border it goes on at the other;
//! beyond a pole lies the same row turned by 180 degrees, where the author repeats the row.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use glam::Vec3;

use super::quadtree::Shape;
use super::reconstruct::{bilinear, fill, filter_with};
use super::refine::{Root, Solution};
use super::texture::{Grid, Value};
use super::{Light, Order};

/// Number of patches: the faces +x, -x, +y, -y, +z, -z.
pub const PATCHES: usize = 6;

/// Axes of a face: outwards, and those of its coordinates.
fn axes(patch: usize) -> [Vec3; 3] {
    let k = patch / 2;
    let sign = if patch.is_multiple_of(2) { 1.0 } else { -1.0 };
    [sign * Vec3::AXES[k], sign * Vec3::AXES[(k + 1) % 3], Vec3::AXES[(k + 2) % 3]]
}

/// Direction of a point of a patch from the centre.
pub fn direction(patch: usize, at: [f32; 2]) -> Vec3 {
    let [out, s, t] = axes(patch);
    let [x, y] = at.map(|c| (FRAC_PI_4 * (2.0 * c - 1.0)).tan());
    (out + x * s + y * t).normalize()
}

/// Patch and point in a direction.
pub fn patch_at(direction: Vec3) -> (usize, [f32; 2]) {
    let size = direction.abs();
    let k = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let patch = 2 * k + usize::from(direction[k] < 0.0);
    (patch, on(patch, direction))
}

/// Coordinates on a patch, whose face the direction meets.
fn on(patch: usize, direction: Vec3) -> [f32; 2] {
    let [out, s, t] = axes(patch);
    [s, t].map(|axis| 0.5 + 0.5 * (direction.dot(axis) / direction.dot(out)).atan() / FRAC_PI_4)
}

/// The patches of a sphere as surfaces to be refined.
pub fn roots(radius: f32) -> [Root; PATCHES] {
    [Root { shape: Shape::Quad, area: 4.0 * PI * radius * radius / 6.0, halves: [0.5; 2] }; PATCHES]
}

/// The textures of the patches, all of the height of the deepest one: vertices on a common edge are known to both sides, so that there
/// is no step. `first`: index of the first patch in the solution, whose order must be one.
pub fn patches(solution: &Solution, first: usize) -> [Grid<Light>; PATCHES] {
    let height = (first..first + PATCHES).map(|i| solution.trees[i].height()).max().unwrap_or(0);
    let known = |patch: usize, at: [u32; 2]| {
        if solution.options().order != Order::First {
            return None;
        }
        solution.vertex(first + patch, at, height).flatten()
    };
    of_vertices(height, known)
}

/// The same from vertices that a function knows, by patch and place in a grid of 2^height cells.
pub fn of_vertices<T: Value>(height: u8, known: impl Fn(usize, [u32; 2]) -> Option<T>) -> [Grid<T>; PATCHES] {
    let last = 1u32 << height;
    let across = |patch: usize, at: [u32; 2]| {
        if at.iter().all(|&n| n > 0 && n < last) {
            return None;
        }
        let towards = direction(patch, at.map(|n| n as f32 / last as f32));
        let others = (0..PATCHES).filter(|&other| other != patch && towards.dot(axes(other)[0]) > 0.0);
        let places = others.map(|other| (other, on(other, towards).map(|c| c * last as f32)));
        // Only on a common edge or corner do the coordinates end at the face's border.
        let inside = |place: [f32; 2]| place.iter().all(|&c| c > -0.01 && c < last as f32 + 0.01);
        places
            .filter(|&(_, place)| inside(place))
            .find_map(|(other, place)| known(other, place.map(|c| c.round() as u32)))
    };
    std::array::from_fn(|patch| fill(Shape::Quad, height, |at| known(patch, at).or_else(|| across(patch, at))))
}

/// A texture of latitude and longitude: twice as wide as high.
#[derive(Clone, Debug, PartialEq)]
pub struct LatLong<T> {
    /// The texels; the first row is at the south pole, the first column at longitude 0, the direction +x; +y is the north pole.
    pub grid: Grid<T>,
}

impl<T: Value> LatLong<T> {
    /// Resamples patches with 2^h + 1 vertices a side: 4 * 2^h by 2 * 2^h texels, each looked up at its centre.
    pub fn new(patches: &[Grid<T>; PATCHES]) -> LatLong<T> {
        let n = patches.iter().map(|grid| grid.size[0] - 1).max().unwrap_or(1).max(1);
        let size = [4 * n, 2 * n];
        let value = |i: usize| {
            let [longitude, latitude] = angles([(i % size[0]) as f32 + 0.5, (i / size[0]) as f32 + 0.5], size);
            let (patch, at) = patch_at(towards(longitude, latitude));
            let grid = &patches[patch];
            bilinear(grid, at.map(|c| c * (grid.size[0] - 1) as f32))
        };
        LatLong { grid: Grid { size, values: (0..size[0] * size[1]).map(value).collect() } }
    }

    /// Low-pass filter, 2 (none) to 6 texels wide.
    pub fn filtered(&self, width: u32) -> LatLong<T> {
        LatLong { grid: filter_with(&self.grid, width, wrapped) }
    }

    /// Bilinear look-up in a direction.
    pub fn at(&self, direction: Vec3) -> T {
        let [w, h] = self.grid.size.map(|n| n as f32);
        let d = direction.normalize();
        let x = d.z.atan2(d.x).rem_euclid(TAU) / TAU * w - 0.5;
        let y = (d.y.clamp(-1.0, 1.0).asin() / PI + 0.5) * h - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (tx, ty) = (x - x0, y - y0);
        let texel = |dx: isize, dy: isize| wrapped(&self.grid, [x0 as isize + dx, y0 as isize + dy]);
        let row = |dy: isize| texel(0, dy) * (1.0 - tx) + texel(1, dy) * tx;
        row(0) * (1.0 - ty) + row(1) * ty
    }

    /// Mean over the sphere: texels weighed by their solid angle.
    pub fn mean(&self) -> T {
        let [w, h] = self.grid.size;
        let mut sum = T::default();
        for y in 0..h {
            let [low, high] = [y, y + 1].map(|y| (PI * (y as f32 / h as f32 - 0.5)).sin());
            for x in 0..w {
                sum = sum + self.grid.at([x, y]) * (0.5 * (high - low) / w as f32);
            }
        }
        sum
    }
}

/// A texel, or beyond the borders the one that lies there on the sphere.
pub fn wrapped<T: Value>(grid: &Grid<T>, [x, y]: [isize; 2]) -> T {
    let [w, h] = grid.size.map(|n| n as isize);
    let (x, y) = match y {
        _ if y < 0 => (x + w / 2, -1 - y),
        _ if y >= h => (x + w / 2, 2 * h - 1 - y),
        _ => (x, y),
    };
    grid.at([x.rem_euclid(w) as usize, y.clamp(0, h - 1) as usize])
}

/// Longitude and latitude of a place in texels, in radians.
pub(super) fn angles([x, y]: [f32; 2], [w, h]: [usize; 2]) -> [f32; 2] {
    [TAU * x / w as f32, PI * y / h as f32 - FRAC_PI_2]
}

/// The direction of a longitude and a latitude.
pub(super) fn towards(longitude: f32, latitude: f32) -> Vec3 {
    let (sin, cos) = latitude.sin_cos();
    Vec3::new(cos * longitude.cos(), sin, cos * longitude.sin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::refine::{Options, Point, refine};

    fn exact(height: u8, f: impl Fn(Vec3) -> f32) -> LatLong<f32> {
        let n = (1u32 << height) as f32;
        LatLong::new(&of_vertices(height, |patch, at| Some(f(direction(patch, at.map(|c| c as f32 / n))))))
    }

    /// Directions all over the sphere, the poles and the seam among them.
    fn directions() -> impl Iterator<Item = Vec3> {
        let spiral = |i: usize| {
            let y = 1.0 - 2.0 * (i as f32 + 0.5) / 5000.0;
            towards(2.399_963 * i as f32, y.asin())
        };
        (0..5000).map(spiral).chain([Vec3::Y, -Vec3::Y, Vec3::X, Vec3::new(1.0, 0.0, -1e-6), -Vec3::Z])
    }

    #[test]
    fn patches_cover_the_sphere_with_equal_areas() {
        let mut counts = [0; PATCHES];
        for d in directions() {
            let (patch, at) = patch_at(d);
            counts[patch] += 1;
            assert!(at.iter().all(|c| (-1e-6..=1.000_001).contains(c)) && (direction(patch, at) - d).length() < 1e-5);
        }
        assert!(counts.iter().all(|&n| (n - 834i32).abs() < 20), "{counts:?}");
    }

    #[test]
    fn constants_are_exact_and_linear_fields_converge_with_the_square() {
        for width in 2..=6 {
            let flat = exact(3, |_| 2.5).filtered(width);
            assert!(directions().all(|d| (flat.at(d) - 2.5).abs() < 1e-5));
            assert!((flat.mean() - 2.5).abs() < 1e-5);
        }
        let b = Vec3::new(0.3, -0.8, 0.5);
        let error = |height: u8, width: u32| {
            let map = exact(height, |d| 2.0 + b.dot(d)).filtered(width);
            directions().map(|d| (map.at(d) - 2.0 - b.dot(d)).abs()).fold(0.0, f32::max)
        };
        for width in [2, 4, 6] {
            let errors = [2, 3, 4, 5].map(|height| error(height, width));
            assert!(errors.windows(2).all(|e| e[1] < 0.4 * e[0]), "{width}: {errors:?}");
            assert!(errors[3] < 0.01, "{width}: {errors:?}");
        }
        assert!((exact(4, |d| 2.0 + b.dot(d)).mean() - 2.0).abs() < 1e-4, "energy by area");
    }

    #[test]
    fn edges_seam_and_poles_have_no_more_of_a_step_than_the_inside() {
        let f = |d: Vec3| (3.0 * d.x).sin() + d.y * d.z + (2.0 * d.y + d.z).cos();
        for width in [2, 5] {
            let map = exact(4, f).filtered(width);
            const D: f32 = 0.02;
            let step = |at: Vec3, along: Vec3| (map.at(at + D * along) - map.at(at - D * along)).abs();
            let inside = directions()
                .map(|d| {
                    let (u, v) = d.any_orthonormal_pair();
                    step(d, u).max(step(d, v))
                })
                .fold(0.0, f32::max);
            let ring = |i: usize| TAU * i as f32 / 64.0;
            // The twelve edges of the cube lie in six planes, the seam at longitude 0; and across both poles.
            for i in 0..64 {
                let (sin, cos) = ring(i).sin_cos();
                for k in 0..3 {
                    let [a, b, c] = [0, 1, 2].map(|n| Vec3::AXES[(k + n) % 3]);
                    for sign in [1.0, -1.0] {
                        let on_edge = (sin * a + cos * (b + sign * c).normalize()).normalize();
                        assert!(step(on_edge, (b - sign * c).normalize()) < 1.05 * inside);
                    }
                }
                let seam = towards(0.0, 0.5 * PI * sin);
                assert!(step(seam, Vec3::Z) < 1.05 * inside);
                for pole in [Vec3::Y, -Vec3::Y] {
                    assert!(step(pole, Vec3::new(cos, 0.0, sin)) < 1.05 * inside);
                }
            }
        }
    }

    /// Irradiance over pi times radiance at a point with a normal, from a disc of radius 1 at the origin that faces down, where all of it
    /// lies above the point's horizon (form factors of a disc to elements parallel and at right angles to it).
    fn disc(point: Vec3, normal: Vec3) -> f32 {
        let (height, aside) = (-point.y, Vec3::new(point.x, 0.0, point.z));
        let (h2, a2) = (height * height, aside.length_squared());
        let z = h2 + a2 + 1.0;
        let root = (z * z - 4.0 * a2).sqrt();
        let parallel = 0.5 * (1.0 - (h2 + a2 - 1.0) / root);
        let across = if a2 < 1e-8 { 0.0 } else { 0.5 * height / a2.sqrt() * (z / root - 1.0) };
        normal.y * parallel - normal.dot(aside.normalize_or_zero()) * across
    }

    #[test]
    fn a_sphere_under_a_disc_light_has_its_closed_form() {
        let (centre, radius) = (Vec3::new(0.4, -3.0, 0.2), 0.8);
        // The closed form against the sum over the disc.
        let at = centre + radius * Vec3::new(0.3, 0.9, 0.1).normalize();
        let normal = (at - centre).normalize();
        let (mut sum, n) = (0.0, 400);
        for i in 0..n * n {
            let (r, phi) = ((((i % n) as f32 + 0.5) / n as f32).sqrt(), TAU * ((i / n) as f32 + 0.5) / n as f32);
            let to = Vec3::new(r * phi.cos(), 0.0, r * phi.sin()) - at;
            sum += normal.dot(to) * to.y / to.length_squared().powi(2) / (n * n) as f32;
        }
        assert!((disc(at, normal) / sum - 1.0).abs() < 1e-3, "{} {sum}", disc(at, normal));
        // Beyond the horizon the irradiance is black here, in between it is not told.
        let e = |d: Vec3| disc(centre + radius * d, d).max(0.0);
        let options = Options { epsilon: 0.02, height: 5, start: 96, ..Options::default() };
        let mut light = |points: &[Point]| {
            let of = |p: &Point| e(direction(p.root as usize, p.at));
            Ok(points.iter().map(|p| Some(Light { direct: Vec3::splat(of(p)), indirect: Vec3::ZERO })).collect())
        };
        let solution = refine(&roots(radius), &options, &mut light).unwrap();
        let map = LatLong::new(&patches(&solution, 0));
        let (mut worst, mut greatest) = (0.0f32, 0.0f32);
        for d in directions() {
            let point = centre + radius * d;
            // All of the disc lies above the tangent plane.
            let clear = -point.dot(d) - (1.0 - d.y * d.y).max(0.0).sqrt();
            greatest = greatest.max(e(d));
            if clear > 0.15 {
                worst = worst.max((map.at(d).direct.x - e(d)).abs());
            }
        }
        assert!(worst < 0.01 * greatest, "{worst} of {greatest}");
        let by_area = (0..PATCHES).map(|i| solution.mean_of(i, [0.5; 2]).direct.x).sum::<f32>() / 6.0;
        assert!((map.mean().direct.x / by_area - 1.0).abs() < 0.03, "{} {by_area}", map.mean().direct.x);
    }
}
