//! Reconstruction in three stages (Bastos 1999, 5.5.3): bicubic patches until the tree is full, a low-pass filter at the same
//! resolution, and the look-up.
//!
//! **Stage 1.** At each level the vertices that are known are kept; one that is not gets the value of the bicubic Hermite patch one
//! level up, with central differences for derivatives. At the middle of an edge that is (-1, 9, 9, -1) / 16 of the vertices along
//! it, at the middle of a patch the product of two of them. As each vertex has one value in the end, there are no T-vertices, however
//! unequal the levels of neighbours.
//!
//! **Stage 2.** n x n is the support of filter and bilinear look-up together; the weights are binomial, with variance (n - 1) / 4 at
//! the middle of a cell. 2 x 2 is the look-up alone; 4 x 4 filters by (1, 2, 1) / 4, 6 x 6 by (1, 4, 6, 4, 1) / 16, and odd ones have
//! a factor (1, 6, 1) / 8 instead of one (1, 2, 1) / 4.
//!
//! **Stage 3** is bilinear, or bicubic with the filter (1/3, 1/3) of Mitchell and Netravali 1988.
//!
//! Beyond the border of a surface lies its reflection in the border's value, 2 f(0) - f(i). So linear fields are kept up to the
//! border, and values on a border depend on those along it alone: surfaces that share an edge and its vertices have no step there.

use super::quadtree::Shape;
use super::texture::{Grid, Value};
use crate::scene::mitchell_filter;

/// Rows beyond the slanted edge of a triangle that have values.
const BEYOND: usize = 4;

/// A texel, or beyond the borders of the grid the reflection.
pub fn beyond<T: Value>(grid: &Grid<T>, [x, y]: [isize; 2]) -> T {
    let strided = Strided { grid, step: 1 };
    strided.at([x, y])
}

/// Every `step`-th vertex of a grid.
struct Strided<'a, T> {
    grid: &'a Grid<T>,
    step: usize,
}

impl<T: Value> Strided<'_, T> {
    /// Number of the last vertex along each axis.
    fn last(&self) -> [isize; 2] {
        self.grid.size.map(|n| ((n - 1) / self.step) as isize)
    }

    fn at(&self, [x, y]: [isize; 2]) -> T {
        let [last_x, last_y] = self.last();
        let fold = |i: isize, last: isize| match i {
            _ if i < 0 => Some((0, (-i).min(last))),
            _ if i > last => Some((last, (2 * last - i).max(0))),
            _ => None,
        };
        if let Some((border, inner)) = fold(x, last_x) {
            return self.at([border, y]) * 2.0 - self.at([inner, y]);
        }
        if let Some((border, inner)) = fold(y, last_y) {
            return self.at([x, border]) * 2.0 - self.at([x, inner]);
        }
        self.grid.at([x as usize * self.step, y as usize * self.step])
    }
}

/// Fills the vertices of a triangle's grid beyond its slanted edge, s + t = 1, by parallelograms: so bilinear look-ups in cells on the
/// edge are linear between the three vertices of the triangle, and linear fields go on.
pub fn extend<T: Value>(grid: &mut Grid<T>) {
    extend_strided(grid, 1);
}

fn extend_strided<T: Value>(grid: &mut Grid<T>, step: usize) {
    let last = (grid.size[0] - 1) / step;
    for diagonal in last + 1..=(last + BEYOND).min(2 * last) {
        for x in diagonal - last..=last {
            let [x, y] = [x, diagonal - x].map(|n| n * step);
            *grid.at_mut([x, y]) = grid.at([x - step, y]) + grid.at([x, y - step]) - grid.at([x - step, y - step]);
        }
    }
}

/// Weights of four vertices for the bicubic patch between the middle two.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-t3 + 2.0 * t2 - t, 3.0 * t3 - 5.0 * t2 + 2.0, -3.0 * t3 + 4.0 * t2 + t, t3 - t2].map(|w| 0.5 * w)
}

/// The same for Mitchell's filter with B = C = 1/3.
fn mitchell_weights(t: f32) -> [f32; 4] {
    [1.0 + t, t, 1.0 - t, 2.0 - t].map(mitchell_filter)
}

/// The product of weights for four columns and rows around a point.
fn tensor<T: Value>(grid: &Strided<T>, at: [f32; 2], weights: fn(f32) -> [f32; 4]) -> T {
    let last = grid.last();
    let cell = [0, 1].map(|k| at[k].floor().clamp(0.0, (last[k] - 1).max(0) as f32));
    let [across, down] = [0, 1].map(|k| weights(at[k] - cell[k]));
    let mut sum = T::default();
    for (j, wy) in (-1..).zip(down) {
        let mut row = T::default();
        for (i, wx) in (-1..).zip(across) {
            row = row + grid.at([cell[0] as isize + i, cell[1] as isize + j]) * wx;
        }
        sum = sum + row * wy;
    }
    sum
}

/// Bicubic Hermite patches through the vertices, at a point in cells of the grid.
pub fn hermite<T: Value>(grid: &Grid<T>, at: [f32; 2]) -> T {
    tensor(&Strided { grid, step: 1 }, at, catmull_rom)
}

/// Look-up by Mitchell's filter, at a point in cells of the grid.
pub fn mitchell<T: Value>(grid: &Grid<T>, at: [f32; 2]) -> T {
    tensor(&Strided { grid, step: 1 }, at, mitchell_weights)
}

/// Bilinear look-up, at a point in cells of the grid.
pub fn bilinear<T: Value>(grid: &Grid<T>, at: [f32; 2]) -> T {
    tensor(&Strided { grid, step: 1 }, at, |t| [0.0, 1.0 - t, t, 0.0])
}

/// Stage 1: all (2^height + 1)^2 vertices from those that are known, among them the corners of the surface, which are zero where they
/// are not. A triangle is extended beyond its slanted edge.
pub fn fill<T: Value>(shape: Shape, height: u8, known: impl Fn([u32; 2]) -> Option<T>) -> Grid<T> {
    let side = (1usize << height) + 1;
    let mut grid = Grid::square(side, T::default());
    let last = side - 1;
    let inside = |[x, y]: [usize; 2]| shape == Shape::Quad || x + y <= last;
    let value = |[x, y]: [usize; 2]| known([x as u32, y as u32]);
    for corner in [[0, 0], [last, 0], [last, last], [0, last]].into_iter().filter(|&at| inside(at)) {
        *grid.at_mut(corner) = value(corner).unwrap_or_default();
    }
    for level in 1..=height {
        let step = last >> level;
        if shape == Shape::Triangle {
            extend_strided(&mut grid, 2 * step);
        }
        let above = Strided { grid: &grid, step: 2 * step };
        let mut found = Vec::new();
        for y in (0..side).step_by(step) {
            for x in (0..side).step_by(step).filter(|&x| inside([x, y])) {
                let [odd_x, odd_y] = [x, y].map(|n| n / step % 2 == 1);
                if !odd_x && !odd_y {
                    continue;
                }
                let new = || match (shape, x + y == last) {
                    // The slanted edge depends on the vertices along it alone, as the others do.
                    (Shape::Triangle, true) => along_slant(&above, x / step),
                    _ => tensor(&above, [x, y].map(|n| n as f32 / (2 * step) as f32), catmull_rom),
                };
                found.push(([x, y], value([x, y]).unwrap_or_else(new)));
            }
        }
        found.into_iter().for_each(|(at, value)| *grid.at_mut(at) = value);
    }
    if shape == Shape::Triangle {
        extend(&mut grid);
    }
    grid
}

/// The middle between vertices (x - 1) / 2 and (x + 1) / 2 of a triangle's slanted edge.
fn along_slant<T: Value>(above: &Strided<T>, x: usize) -> T {
    let [last, _] = above.last();
    let vertex = |i: isize| above.at([i, last - i]);
    let reflected = |i: isize| match i {
        _ if i < 0 => vertex(0) * 2.0 - vertex((-i).min(last)),
        _ if i > last => vertex(last) * 2.0 - vertex((2 * last - i).max(0)),
        _ => vertex(i),
    };
    let first = (x as isize - 1) / 2;
    (reflected(first) + reflected(first + 1)) * (9.0 / 16.0)
        - (reflected(first - 1) + reflected(first + 2)) * (1.0 / 16.0)
}

/// Taps of the filter of stage 2 on either side of a texel, from it outwards; `width`: 2 to 6.
pub fn taps(width: u32) -> Vec<f32> {
    let mut taps = vec![1.0];
    let mut widen = |side: f32| {
        let middle = 1.0 - 2.0 * side;
        let at = |taps: &[f32], i: isize| taps.get(i.unsigned_abs()).copied().unwrap_or(0.0);
        let of = |i: isize| side * (at(&taps, i - 1) + at(&taps, i + 1)) + middle * at(&taps, i);
        taps = (0..=taps.len() as isize).map(of).collect();
    };
    (0..width.saturating_sub(2) / 2).for_each(|_| widen(0.25));
    if width % 2 == 1 {
        widen(0.125);
    }
    taps
}

/// Stage 2 on a texture whose texels beyond the borders a function gives.
pub fn filter_with<T: Value>(grid: &Grid<T>, width: u32, beyond: impl Fn(&Grid<T>, [isize; 2]) -> T) -> Grid<T> {
    let taps = taps(width);
    let reach = taps.len() as isize - 1;
    let weight = |i: isize| taps[i.unsigned_abs()];
    let mut out = grid.clone();
    for y in 0..grid.size[1] {
        for x in 0..grid.size[0] {
            let mut sum = T::default();
            for j in -reach..=reach {
                for i in -reach..=reach {
                    sum = sum + beyond(grid, [x as isize + i, y as isize + j]) * (weight(i) * weight(j));
                }
            }
            *out.at_mut([x, y]) = sum;
        }
    }
    out
}

/// Stage 2 on the texture of a surface. `width`: 2 to 6; 2 changes nothing.
pub fn filter<T: Value>(grid: &Grid<T>, shape: Shape, width: u32) -> Grid<T> {
    if width <= 2 {
        return grid.clone();
    }
    let mut out = filter_with(grid, width, beyond);
    if shape == Shape::Triangle {
        extend(&mut out);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::quadtree::Tree;
    use crate::radiosity::quadtree::tests::random;
    use crate::radiosity::texture::{interpolated, patch};
    use std::collections::HashSet;

    const SHAPES: [Shape; 2] = [Shape::Quad, Shape::Triangle];

    /// The corners of a tree's leaves in a grid of this height.
    fn vertices(tree: &Tree, height: u8) -> HashSet<[u32; 2]> {
        tree.leaves().flat_map(|(_, e)| e.corners(tree.shape(), height)).collect()
    }

    fn filled(tree: &Tree, height: u8, f: impl Fn(f32, f32) -> f32) -> Grid<f32> {
        let known = vertices(tree, height);
        let scale = (-f32::from(height)).exp2();
        fill(tree.shape(), height, |[x, y]| known.contains(&[x, y]).then(|| f(x as f32 * scale, y as f32 * scale)))
    }

    /// A smooth function with a bright spot.
    fn spot(s: f32, t: f32) -> f32 {
        1.0 / (0.05 + (s - 0.3).powi(2) + (t - 0.4).powi(2)).powi(2)
    }

    #[test]
    fn linear_fields_are_exact_at_every_stage() {
        let f = |s: f32, t: f32| 3.0 * s - 2.0 * t + 5.0;
        for shape in SHAPES {
            for seed in 0..8 {
                let tree = random(shape, 3 + 3 * seed, 5, seed);
                let grid = filled(&tree, 5, f);
                for width in 2..=6 {
                    let smooth = filter(&grid, shape, width);
                    for i in 0..=40 {
                        for j in 0..=if shape == Shape::Quad { 40 } else { 40 - i } {
                            let [s, t] = [i as f32 / 40.0, j as f32 / 40.0];
                            let at = [32.0 * s, 32.0 * t];
                            for found in [bilinear(&smooth, at), hermite(&smooth, at), mitchell(&smooth, at)] {
                                assert!((found - f(s, t)).abs() < 1e-4, "{shape:?} {width} {s} {t}: {found}");
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn known_vertices_are_kept() {
        for shape in SHAPES {
            let tree = random(shape, 20, 5, 11);
            let grid = filled(&tree, 6, spot);
            for [x, y] in vertices(&tree, 6) {
                assert_eq!(grid.at([x as usize, y as usize]), spot(x as f32 / 64.0, y as f32 / 64.0));
            }
        }
    }

    #[test]
    fn edges_with_vertices_of_one_side_have_no_jump_and_less_of_a_slope() {
        // A half split once, the other three times: T-vertices on s = 1/2.
        let mut tree = Tree::full(Shape::Quad, 1);
        for _ in 0..2 {
            let right: Vec<u32> =
                tree.leaves().filter(|(_, e)| 2 * e.cell[0] >= 1 << e.level && e.level > 0).map(|(n, _)| n).collect();
            right.into_iter().for_each(|node| tree.split(node));
        }
        let f = |s: f32, t: f32| (3.0 * s).sin() + (4.0 * t).cos();
        let height = 3;
        let known = vertices(&tree, height);
        let sampled = |[x, y]: [u32; 2]| known.contains(&[x, y]).then(|| f(x as f32 / 8.0, y as f32 / 8.0));
        // Before: each leaf interpolates its own corners.
        let own = |at: [f32; 2]| {
            let element = tree.element(tree.leaf_at(at));
            let span = f32::from(height - element.level).exp2();
            let local = [0, 1].map(|k| at[k] * 8.0 - element.cell[k] as f32 * span);
            let values: Vec<f32> = patch(Shape::Quad, element, height, sampled).into_iter().map(|(_, v)| v).collect();
            bilinear(&Grid { size: [span as usize + 1; 2], values }, local)
        };
        let full = filled(&tree, height, f);
        let (mut before, mut after, mut slope_before, mut slope_after) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
        for i in 1..64 {
            let t = i as f32 / 64.0 + 1e-3;
            let at = |s: f32| [s, t];
            const D: f32 = 1e-2;
            let (low, high) = (0.5 - 1e-6, 0.5 + 1e-6);
            let smooth = |s: f32| hermite(&full, [8.0 * s, 8.0 * t]);
            before = before.max((own(at(high)) - own(at(low))).abs());
            after = after.max((smooth(high) - smooth(low)).abs());
            let slope = |g: &dyn Fn(f32) -> f32| ((g(high + D) - g(high)) - (g(low) - g(low - D))).abs() / D;
            slope_before = slope_before.max(slope(&|s| own(at(s))));
            slope_after = slope_after.max(slope(&smooth));
        }
        assert!(before > 0.05 && after < 1e-4, "jumps {before} {after}");
        assert!(slope_before > 1.0 && slope_after < 0.3 * slope_before, "slopes {slope_before} {slope_after}");
    }

    #[test]
    fn surfaces_with_a_common_edge_agree_along_it() {
        // The edge s = 1 of one is the edge s = 0 of the other, the same vertices known on it.
        let on_edge = |y: u32| [0, 1, 2, 4, 6, 8].contains(&y).then(|| spot(0.5, y as f32 / 8.0));
        let of = |x: u32, other: f32| {
            move |[u, v]: [u32; 2]| {
                if u == x {
                    on_edge(v)
                } else if [u, v].iter().all(|n| n % 8 == 0) {
                    Some(other)
                } else {
                    None
                }
            }
        };
        for width in 2..=6 {
            let left = filter(&fill(Shape::Quad, 3, of(8, 1.0)), Shape::Quad, width);
            let right = filter(&fill(Shape::Quad, 3, of(0, 90.0)), Shape::Quad, width);
            for y in 0..=8 {
                assert!((left.at([8, y]) - right.at([0, y])).abs() < 1e-3, "{width} {y}");
            }
        }
        // The slanted edge of a triangle against the straight edge of a square.
        let slanted = |[u, v]: [u32; 2]| {
            if u + v == 8 {
                on_edge(v)
            } else if u + v == 0 {
                Some(7.0)
            } else {
                None
            }
        };
        let triangle = fill(Shape::Triangle, 3, slanted);
        let square = fill(Shape::Quad, 3, of(0, 90.0));
        (0..=8).for_each(|y| assert!((triangle.at([8 - y, y]) - square.at([0, y])).abs() < 1e-3, "{y}"));
    }

    #[test]
    fn filters_sum_to_one_with_the_variance_of_their_width() {
        for (width, expected) in [
            (2, &[1.0][..]),
            (3, &[0.75, 0.125]),
            (4, &[0.5, 0.25]),
            (5, &[0.4375, 0.25, 0.03125]),
            (6, &[0.375, 0.25, 0.0625]),
        ] {
            let taps = taps(width);
            assert_eq!(taps, expected);
            let both =
                |f: fn(usize) -> f32| taps[0] * f(0) + 2.0 * (1..taps.len()).map(|i| taps[i] * f(i)).sum::<f32>();
            assert_eq!((both(|_| 1.0), both(|i| (i * i) as f32)), (1.0, (width - 2) as f32 / 4.0));
        }
        for i in 0..=20 {
            let sum: f32 = mitchell_weights(i as f32 / 20.0).iter().sum();
            assert!((sum - 1.0).abs() < 1e-6);
        }
        assert_eq!([0.0, 1.0, 2.0].map(mitchell_filter), [16.0 / 18.0, 1.0 / 18.0, 0.0]);
    }

    #[test]
    fn bicubic_reconstruction_is_nearer_to_the_fine_tree() {
        let rms = |grid: &Grid<f32>, look_up: fn(&Grid<f32>, [f32; 2]) -> f32| {
            let scale = (grid.size[0] - 1) as f32;
            let mut sum = 0.0;
            for i in 0..=128 {
                for j in 0..=128 {
                    let [s, t] = [i as f32 / 128.0, j as f32 / 128.0];
                    sum += (look_up(grid, [s * scale, t * scale]) - smooth_spot(s, t)).powi(2);
                }
            }
            (sum / (129.0 * 129.0)).sqrt()
        };
        fn smooth_spot(s: f32, t: f32) -> f32 {
            1.0 / (0.2 + (s - 0.3).powi(2) + (t - 0.4).powi(2))
        }
        let tree = Tree::full(Shape::Quad, 2);
        let grid = filled(&tree, 2, smooth_spot);
        let fine = filled(&tree, 3, smooth_spot);
        let [two, resampled, bicubic] = [rms(&grid, bilinear), rms(&fine, bilinear), rms(&grid, hermite)];
        assert!(bicubic < 0.4 * two && resampled < 0.6 * two, "{two} {resampled} {bicubic}");
        let widths: Vec<f32> = (2..=6).map(|w| rms(&filter(&fine, Shape::Quad, w), bilinear)).collect();
        assert!(widths.windows(2).all(|w| w[0] < w[1]), "a wider filter blurs more: {widths:?}");
        // Interpolation from leaves alone is the bilinear one.
        let known = vertices(&tree, 3);
        let linear = interpolated(&tree, 3, |[x, y]| {
            known.contains(&[x, y]).then(|| smooth_spot(x as f32 / 8.0, y as f32 / 8.0))
        });
        assert!((rms(&linear, bilinear) - two).abs() < 1e-4);
    }
}
