//! Quadtrees flattened into textures (Bastos 1999, 5.5.1 and 5.5.2), of order zero and one, from trees full or not.
//!
//! A texture of order zero has 2^h x 2^h texels, one for each element of the deepest level; a leaf above it replicates its value
//! (programs 5.7 and 5.14). One of order one has a texel at each of (2^h + 1)^2 vertices: a leaf adds its value to an accumulator at its
//! corners and 1 to a counter, and the quotient is the mean of the leaves around a vertex (programs 5.10 and 5.11); what leaves above the
//! deepest level leave open, their corners fill by interpolation. Program 5.12 takes a node of the deepest level for a leaf; the test
//! here is that of 5.14, no children.
//!
//! The elements of a triangle are halves of cells. In a texture of order zero the lower halves have the texels of their cells and the
//! inverted ones the texels opposite to them, turned by half a turn about the middle, so that every texel has one element.

use std::ops::{Add, Mul, Sub};

use super::quadtree::{Element, Shape, Tree};

/// A quantity on surfaces: numbers, colours, [`super::Light`].
pub trait Value: Copy + Default + Add<Output = Self> + Sub<Output = Self> + Mul<f32, Output = Self> {}
impl<T: Copy + Default + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>> Value for T {}

/// A texture of `size` texels, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    /// Width and height.
    pub size: [usize; 2],
    /// The texels.
    pub values: Vec<T>,
}

impl<T: Copy> Grid<T> {
    /// A square of equal values.
    pub fn square(side: usize, value: T) -> Grid<T> {
        Grid { size: [side; 2], values: vec![value; side * side] }
    }

    /// The texel in column x and row y.
    pub fn at(&self, [x, y]: [usize; 2]) -> T {
        self.values[x + y * self.size[0]]
    }

    /// The same to write.
    pub fn at_mut(&mut self, [x, y]: [usize; 2]) -> &mut T {
        &mut self.values[x + y * self.size[0]]
    }
}

fn index([x, y]: [u32; 2]) -> [usize; 2] {
    [x as usize, y as usize]
}

/// Texture of order zero with 2^height texels a side; `values`: of the leaves, by node. `height` is at least that of the tree.
pub fn zero_order<T: Value>(tree: &Tree, values: &[T], height: u8) -> Grid<T> {
    let side = 1usize << height;
    let mut grid = Grid::square(side, T::default());
    tree.visit(&mut |leaf, element| {
        let mut open = vec![element];
        while let Some(part) = open.pop() {
            if part.level < height {
                open.extend(part.children(tree.shape()));
                continue;
            }
            let [u, v] = index(part.cell);
            let place = if part.inverted { [side - 1 - u, side - 1 - v] } else { [u, v] };
            *grid.at_mut(place) = values[leaf as usize];
        }
    });
    grid
}

/// The accumulator and the counter of order one, (2^height + 1)^2 texels each.
pub fn accumulate<T: Value>(tree: &Tree, values: &[T], height: u8) -> (Grid<T>, Grid<u32>) {
    let side = (1usize << height) + 1;
    let (mut sums, mut counts) = (Grid::square(side, T::default()), Grid::square(side, 0));
    tree.visit(&mut |leaf, element| {
        for corner in element.corners(tree.shape(), height).map(index) {
            *sums.at_mut(corner) = sums.at(corner) + values[leaf as usize];
            *counts.at_mut(corner) += 1;
        }
    });
    (sums, counts)
}

/// Texture of order one, from values of the leaves, by node. In a triangle texels beyond s + t = 1 stay zero.
pub fn first_order<T: Value>(tree: &Tree, values: &[T], height: u8) -> Grid<T> {
    let (sums, counts) = accumulate(tree, values, height);
    let vertex = |at: [u32; 2]| {
        let count = counts.at(index(at));
        (count > 0).then(|| sums.at(index(at)) * (1.0 / count as f32))
    };
    interpolated(tree, height, vertex)
}

/// Texture of order one from the values at vertices: those that are not known are interpolated from the corners of a leaf.
pub fn interpolated<T: Value>(tree: &Tree, height: u8, vertex: impl Fn([u32; 2]) -> Option<T>) -> Grid<T> {
    let mut grid = Grid::square((1 << height) + 1, T::default());
    tree.visit(&mut |_, element| {
        for (at, value) in patch(tree.shape(), element, height, &vertex) {
            *grid.at_mut(index(at)) = vertex(at).unwrap_or(value);
        }
    });
    grid
}

/// The vertices of the grid on a leaf, interpolated from its corners: bilinear, in a triangle linear.
pub fn patch<T: Value>(
    shape: Shape,
    element: Element,
    height: u8,
    vertex: impl Fn([u32; 2]) -> Option<T>,
) -> Vec<([u32; 2], T)> {
    let span = 1u32 << (height - element.level);
    let places: Vec<[u32; 2]> = element.corners(shape, height).collect();
    let corners: Vec<T> = places.iter().map(|&at| vertex(at).unwrap_or_default()).collect();
    let mut found = Vec::with_capacity(((span + 1) * (span + 1)) as usize);
    for j in 0..=span {
        for i in 0..=span {
            let [s, t] = [i as f32 / span as f32, j as f32 / span as f32];
            let (at, value) = match shape {
                Shape::Quad => {
                    let [low, high] =
                        [corners[0] * (1.0 - s) + corners[1] * s, corners[3] * (1.0 - s) + corners[2] * s];
                    ([places[0][0] + i, places[0][1] + j], low * (1.0 - t) + high * t)
                }
                Shape::Triangle if i + j > span => continue,
                Shape::Triangle => {
                    let value = corners[0] * (1.0 - s - t) + corners[1] * s + corners[2] * t;
                    let [x, y] = places[0];
                    (if element.inverted { [x - i, y - j] } else { [x + i, y + j] }, value)
                }
            };
            found.push((at, value));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::quadtree::tests::random;

    /// Leaf i has the value i + 1, nodes with children none that would be noticed as right.
    fn numbered(tree: &Tree) -> Vec<f32> {
        let mut values = vec![-1e9; tree.len()];
        tree.leaves().zip(1..).for_each(|((node, _), i)| values[node as usize] = i as f32);
        values
    }

    #[test]
    fn every_leaf_of_a_full_tree_has_one_texel_and_every_texel_one_leaf() {
        for shape in [Shape::Quad, Shape::Triangle] {
            for height in 0..=5 {
                let tree = Tree::full(shape, height);
                let grid = zero_order(&tree, &numbered(&tree), height);
                let mut found: Vec<f32> = grid.values.clone();
                found.sort_unstable_by(f32::total_cmp);
                let all: Vec<f32> = (1..=1 << (2 * height)).map(|i| i as f32).collect();
                assert_eq!(found, all, "{shape:?} {height}");
            }
        }
        let tree = Tree::full(Shape::Quad, 2);
        let grid = zero_order(&tree, &numbered(&tree), 2);
        for (node, element) in tree.leaves() {
            assert_eq!(grid.at(index(element.cell)), numbered(&tree)[node as usize]);
        }
    }

    #[test]
    fn trees_by_hand() {
        // Height 1: 1 2 below, 4 3 above.
        let tree = Tree::full(Shape::Quad, 1);
        let values = [0.0, 1.0, 2.0, 3.0, 4.0];
        assert_eq!(zero_order(&tree, &values, 1).values, [1.0, 2.0, 4.0, 3.0]);
        assert_eq!(first_order(&tree, &values, 1).values, [1.0, 1.5, 2.0, 2.5, 2.5, 2.5, 4.0, 3.5, 3.0]);
        // Height 2: the second leaf is split once more. The last row of 5.13: leaves replicate over span^2 texels.
        let mut tree = Tree::full(Shape::Quad, 1);
        tree.split(2);
        let values = [0.0, 1.0, 0.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let rows = [[1.0, 1.0, 5.0, 6.0], [1.0, 1.0, 8.0, 7.0], [4.0, 4.0, 3.0, 3.0], [4.0, 4.0, 3.0, 3.0]];
        assert_eq!(zero_order(&tree, &values, 2).values, rows.concat());
        let grid = first_order(&tree, &values, 2);
        // The middle: leaves 1, 8, 3, 4; the T-vertex at (2, 1): 5 and 8 alone, and (1, 0): from corners 1 and (1 + 5) / 2.
        assert_eq!([grid.at([2, 2]), grid.at([2, 1]), grid.at([1, 0])], [4.0, 6.5, 2.0]);
        // Height 3: a chain into the corner (1, 1).
        let mut tree = Tree::new(Shape::Quad);
        (0..3).for_each(|i| tree.split(4 * i - if i > 0 { 1 } else { 0 }));
        let grid = zero_order(&tree, &numbered(&tree), 3);
        assert_eq!((tree.leaf_count(), tree.height()), (10, 3));
        let mut counts = [0; 11];
        grid.values.iter().for_each(|v| counts[*v as usize] += 1);
        assert_eq!(counts, [0, 16, 16, 16, 4, 4, 4, 1, 1, 1, 1]);
        // A triangle of height 1: the three corners and the middle, which has the texel that is left.
        let tree = Tree::full(Shape::Triangle, 1);
        let values = [0.0, 1.0, 2.0, 3.0, 4.0];
        assert_eq!(zero_order(&tree, &values, 1).values, [1.0, 2.0, 3.0, 4.0]);
        let grid = first_order(&tree, &values, 1);
        let vertices = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [0, 2]].map(|at| grid.at(at));
        let expected = [1.0f32, 7.0 / 3.0, 2.0, 8.0 / 3.0, 3.0, 3.0];
        assert!(vertices.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{vertices:?}");
    }

    #[test]
    fn counters_are_those_of_the_mesh() {
        let tree = Tree::full(Shape::Quad, 2);
        let (sums, counts) = accumulate(&tree, &numbered(&tree), 2);
        assert_eq!(counts.values.len(), 25);
        let edge = [1, 2, 2, 2, 1];
        for y in 0..5 {
            for x in 0..5 {
                assert_eq!(counts.at([x, y]), edge[x] * edge[y]);
            }
        }
        assert_eq!(sums.values.iter().sum::<f32>(), 4.0 * (1..=16).sum::<u32>() as f32);
        // Six elements of a triangle meet inside, three on an edge, one at a corner.
        let tree = Tree::full(Shape::Triangle, 3);
        let (_, counts) = accumulate(&tree, &numbered(&tree), 3);
        assert_eq!([[2, 2], [3, 0], [4, 4], [0, 0], [8, 0]].map(|at| counts.at(at)), [6, 3, 3, 1, 1]);
        for (shape, corners) in [(Shape::Quad, 4.0), (Shape::Triangle, 3.0)] {
            let tree = random(shape, 60, 6, 3);
            let values = numbered(&tree);
            let (sums, counts) = accumulate(&tree, &values, 6);
            let total: f64 = tree.leaves().map(|(node, _)| f64::from(values[node as usize])).sum();
            let found: f64 = sums.values.iter().map(|v| f64::from(*v)).sum();
            assert_eq!(found, corners * total);
            assert_eq!(counts.values.iter().sum::<u32>() as usize, corners as usize * tree.leaf_count());
        }
    }

    #[test]
    fn constants_are_exact() {
        for shape in [Shape::Quad, Shape::Triangle] {
            for seed in 0..10 {
                let tree = random(shape, 25, 5, seed);
                let values = vec![3.25; tree.len()];
                assert!(zero_order(&tree, &values, 6).values.iter().all(|v| *v == 3.25));
                let grid = first_order(&tree, &values, 6);
                for y in 0..=64 {
                    for x in 0..=if shape == Shape::Quad { 64 } else { 64 - y } {
                        assert!((grid.at([x, y]) - 3.25).abs() < 1e-6, "{x} {y}");
                    }
                }
            }
        }
    }
}
