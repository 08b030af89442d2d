//! Textures of surfaces on pages: a budget, a place for each, and the light map of all.
//!
//! Only the most subdivided surfaces have textures of their own size, 2^h + 1 texels a side, as long as the budget lasts (Bastos 1999,
//! 1.3.1). The rest have 2 x 2 texels, their corners, and those on which light is even have one.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::Light;
use super::balls::Ball;
use super::quadtree::{Shape, Tree};
use super::reconstruct::{beyond, fill, filter};
use super::refine::{Order, Solution};
use super::sphere::{LatLong, PATCHES, of_vertices, wrapped};
use super::surfaces::Surface;
use super::texture::{Grid, accumulate};

/// The texture of a surface or of a sphere.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Index of the surface, or of the first patch of the sphere.
    pub surface: usize,
    /// 2^h + 1 texels a side, or one; of a sphere 4 * 2^h by 2 * 2^h.
    pub grid: Grid<Light>,
    /// For a sphere: columns beyond the seam, which repeat the first ones.
    pub repeated: Option<u32>,
    /// Page, and place of its first texel there.
    pub page: u32,
    /// Column and row.
    pub origin: [u32; 2],
}

impl Texture {
    /// Width and height on the page, without padding.
    pub fn size(&self) -> [u32; 2] {
        let [width, height] = self.grid.size.map(|n| n as u32);
        [width + self.repeated.unwrap_or(0), height]
    }

    /// Position on the page in texels of a point of the surface: corners lie at centres of texels. Of a sphere: of turns and latitude.
    pub fn place(&self, at: Vec2) -> Vec2 {
        let origin = Vec2::new(self.origin[0] as f32, self.origin[1] as f32);
        let [width, height] = self.grid.size.map(|n| n as f32);
        match self.repeated {
            Some(_) => origin + Vec2::new(width, height) * at,
            None => origin + 0.5 + (width - 1.0) * at,
        }
    }
}

/// A texture to be made: the height of its trees, and its size.
struct Wanted {
    surface: usize,
    leaves: usize,
    height: u8,
    size: [u64; 2],
}

/// Textures of all surfaces, with places still to be chosen. `budget`: texels of textures with more than 2 x 2; `width`: of the filter,
/// 2 to 6; `most`: greatest side.
pub fn textures(surfaces: &[Surface], solution: &Solution, budget: u64, width: u32, most: u32) -> Vec<Texture> {
    let wanted = |i: usize| {
        let tree = &solution.trees[i];
        match &surfaces[i].patch {
            None => {
                let side = (1u64 << tree.height()) + 1;
                Some(Wanted { surface: i, leaves: tree.leaf_count(), height: tree.height(), size: [side; 2] })
            }
            Some((ball, 0)) => {
                let trees = &solution.trees[i..i + PATCHES];
                let deepest = trees.iter().map(Tree::height).max().unwrap_or(0);
                let size = |height: u8| {
                    let n = 1u64 << height;
                    [4 * n + u64::from(repeated(ball, height)), 2 * n]
                };
                let fits = (0..=deepest).rev().find(|&height| size(height)[0] <= u64::from(most));
                let height = fits.unwrap_or(0);
                let leaves = trees.iter().map(Tree::leaf_count).sum();
                Some(Wanted { surface: i, leaves, height, size: size(height) })
            }
            Some(_) => None,
        }
    };
    let mut all: Vec<Wanted> = (0..surfaces.len()).filter_map(wanted).collect();
    let mut order: Vec<usize> = (0..all.len()).filter(|&k| all[k].height > 0).collect();
    order.sort_by_key(|&k| (std::cmp::Reverse(all[k].leaves), k));
    let mut left = budget;
    for k in order {
        let [w, h] = all[k].size;
        match w * h <= left {
            true => left -= w * h,
            false => all[k].height = 0,
        }
    }
    let texture = |&Wanted { surface, height, .. }: &Wanted| {
        let (grid, repeated) = match &surfaces[surface].patch {
            Some((ball, _)) => (sphere_grid(solution, surface, height, width), Some(repeated(ball, height))),
            None => (grid(&surfaces[surface], solution, surface, height, width), None),
        };
        Texture { surface, grid, repeated, page: 0, origin: [0, 0] }
    };
    all.par_iter().map(texture).collect()
}

/// The grid of a surface of triangles.
fn grid(surface: &Surface, solution: &Solution, i: usize, height: u8, width: u32) -> Grid<Light> {
    let shape = surface.root.shape;
    let full = clamped(&filter(&fill(shape, height, vertices(solution, i, height)), shape, width));
    match height == 0 && solution.trees[i].height() == 0 && is_even(&full, shape, solution) {
        true => Grid::square(1, solution.mean_of(i, surface.root.halves)),
        false => full,
    }
}

/// The grid of a sphere, whose patches are those from `first` on.
fn sphere_grid(solution: &Solution, first: usize, height: u8, width: u32) -> Grid<Light> {
    let known: Vec<_> = (first..first + PATCHES)
        .map(|i| {
            let own = solution.trees[i].height().min(height);
            (height - own, vertices(solution, i, own))
        })
        .collect();
    // A shallower tree has vertices on some lines of the grid.
    let at = |patch: usize, at: [u32; 2]| {
        let (down, known) = &known[patch];
        at.iter().all(|n| n.is_multiple_of(1 << down)).then(|| known(at.map(|n| n >> down))).flatten()
    };
    clamped(&LatLong::new(&of_vertices(height, at)).filtered(width).grid)
}

/// Columns that a sphere's texture repeats.
fn repeated(ball: &Ball, height: u8) -> u32 {
    (ball.overhang() * (4u32 << height) as f32 - 1e-3).ceil().max(0.0) as u32
}

/// Bicubic patches overshoot; light is not negative.
fn clamped(grid: &Grid<Light>) -> Grid<Light> {
    let values = grid.values.iter().map(|&light| not_negative(light)).collect();
    Grid { size: grid.size, values }
}

fn not_negative(light: Light) -> Light {
    Light { direct: light.direct.max(Vec3::ZERO), indirect: light.indirect.max(Vec3::ZERO) }
}

/// Whether the corners differ by no more than leaves may.
fn is_even(corners: &Grid<Light>, shape: Shape, solution: &Solution) -> bool {
    let count = if shape == Shape::Quad { 4 } else { 3 };
    let of = corners.values.iter().take(count).map(|light| light.total());
    let (low, high) = of.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    (high - low).max_element() <= solution.options().epsilon * solution.mean
}

/// Light at the vertices of a surface as far as it is known. Corners of leaves that lie inside of geometry take the mean of the other
/// corners of leaves around them, ring by ring.
fn vertices(solution: &Solution, surface: usize, height: u8) -> impl Fn([u32; 2]) -> Option<Light> {
    let tree = &solution.trees[surface];
    let (shape, deepest) = (tree.shape(), tree.height());
    let mut known: HashMap<[u32; 2], Option<Light>> = HashMap::new();
    match solution.options().order {
        Order::First => {
            for (_, element) in tree.leaves() {
                for at in element.corners(shape, deepest) {
                    known.insert(at, solution.vertex(surface, at, deepest).flatten());
                }
            }
        }
        Order::Zero => {
            let mut values = vec![Light::default(); tree.len()];
            tree.leaves().for_each(|(node, element)| values[node as usize] = solution.leaf(surface, element));
            let (sums, counts) = accumulate(tree, &values, deepest);
            for (_, element) in tree.leaves() {
                for at in element.corners(shape, deepest) {
                    let place = at.map(|n| n as usize);
                    known.insert(at, Some(sums.at(place) * (1.0 / counts.at(place) as f32)));
                }
            }
        }
    }
    loop {
        let mut sums: HashMap<[u32; 2], (Light, u32)> = HashMap::new();
        for (_, element) in tree.leaves() {
            let corners: Vec<[u32; 2]> = element.corners(shape, deepest).collect();
            let lit: Vec<Light> = corners.iter().filter_map(|at| known[at]).collect();
            if lit.is_empty() || lit.len() == corners.len() {
                continue;
            }
            for at in corners.into_iter().filter(|at| known[at].is_none()) {
                let sum = sums.entry(at).or_default();
                *sum = lit.iter().fold(*sum, |(light, n), l| (light + *l, n + 1));
            }
        }
        if sums.is_empty() {
            break;
        }
        known.extend(sums.into_iter().map(|(at, (light, n))| (at, Some(light * (1.0 / n as f32)))));
    }
    // Trial samples, where the grid has a place for them.
    if solution.options().order == Order::First {
        let leaves = tree.leaves().filter(|(_, e)| e.level < deepest);
        for (_, element) in leaves {
            for part in element.children(shape) {
                for at in part.corners(shape, deepest) {
                    if let Some(Some(light)) = solution.vertex(surface, at, deepest) {
                        known.entry(at).or_insert(Some(light));
                    }
                }
            }
        }
    }
    let up = deepest - height;
    move |at| known.get(&at.map(|n| n << up)).copied().flatten()
}

/// Places textures on pages, in rows, the largest first, with `padding` texels around each; returns the sizes of the pages, none of
/// which is larger than `most`. Textures are no larger than that with their padding.
pub fn place(textures: &mut [Texture], padding: u32, most: u32) -> Vec<[u32; 2]> {
    let outer = |texture: &Texture| texture.size().map(|n| n + 2 * padding);
    let mut order: Vec<usize> = (0..textures.len()).collect();
    order.sort_by_key(|&i| (outer(&textures[i]).map(std::cmp::Reverse)[1], i));
    let area: u64 = textures.iter().map(|t| outer(t).map(u64::from).iter().product::<u64>()).sum();
    let largest = |axis: usize| textures.iter().map(|texture| outer(texture)[axis]).max().unwrap_or(1);
    let (widest, highest) = (largest(0), largest(1));
    let width = ((area as f64 * 1.05).sqrt().ceil() as u32).clamp(widest, most.max(widest));
    let mut pages: Vec<[u32; 2]> = Vec::new();
    let (mut x, mut y, mut row) = (width, 0, 0);
    for i in order {
        let [across, down] = outer(&textures[i]);
        if x + across > width {
            (x, y, row) = (0, y + row, down);
        }
        if pages.is_empty() || y + down > most.max(highest) {
            pages.push([width, 0]);
            (x, y, row) = (0, 0, down);
        }
        textures[i].page = pages.len() as u32 - 1;
        textures[i].origin = [x + padding, y + padding];
        if let Some(page) = pages.last_mut() {
            page[1] = page[1].max(y + down);
        }
        x += across;
    }
    pages
}

/// Light of a texel of a texture or around it, by column and row from its first one.
pub fn texel(texture: &Texture, at: [i64; 2]) -> Light {
    if texture.repeated.is_some() {
        return wrapped(&texture.grid, at.map(|n| n as isize));
    }
    match texture.grid.values[..] {
        [light] => light,
        _ => not_negative(beyond(&texture.grid, at.map(|n| n as isize))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::refine::{Options, Root, refine};

    fn solved(f: impl Fn(u32, [f32; 2]) -> Option<f32>, order: Order) -> (Vec<Surface>, Solution) {
        let roots =
            [Shape::Quad, Shape::Quad, Shape::Triangle].map(|shape| Root { shape, area: 1.0, halves: [0.5; 2] });
        let options = Options { start: 1, order, ..Options::default() };
        let light = |v: f32| Light { direct: Vec3::splat(v), indirect: Vec3::ZERO };
        let mut of = |points: &[crate::radiosity::refine::Point]| {
            Ok(points.iter().map(|p| f(p.root, p.at).map(light)).collect())
        };
        let solution = refine(&roots, &options, &mut of).unwrap();
        let surfaces = roots.map(|root| Surface { root, faces: Vec::new(), back: false, patch: None });
        (surfaces.to_vec(), solution)
    }

    fn steps(root: u32, [s, t]: [f32; 2]) -> Option<f32> {
        Some(match root {
            0 => 1.0 + f32::from(u8::from(s + 0.3 * t > 0.6)),
            1 => 1.0 + s,
            _ => 1.0,
        })
    }

    #[test]
    fn the_most_subdivided_surfaces_have_textures_of_their_own() {
        for order in [Order::Zero, Order::First] {
            let (surfaces, solution) = solved(steps, order);
            let sides = |budget: u64| -> Vec<usize> {
                textures(&surfaces, &solution, budget, 2, 2048).iter().map(|t| t.grid.size[0]).collect()
            };
            let [first, second, third] = sides(1 << 20)[..] else { panic!() };
            assert_eq!((first, third), (65, 1));
            assert_eq!(second == 2, order == Order::First, "a slope is bilinear");
            assert_eq!(sides(65 * 65 - 1)[0], 2, "over the budget");
        }
    }

    #[test]
    fn what_is_inside_geometry_takes_the_light_beside_it() {
        // Half of the surface is covered.
        let covered = |_: u32, [s, _]: [f32; 2]| (s < 0.55).then_some(2.0);
        let (surfaces, solution) = solved(covered, Order::First);
        for texture in textures(&surfaces, &solution, 1 << 20, 4, 2048) {
            let n = texture.grid.size[0];
            let shape = if texture.grid.size == [1, 1] { 1 } else { n };
            assert!((0..shape).all(|i| (texture.grid.at([i, 0]).direct.x - 2.0).abs() < 1e-5));
        }
    }

    #[test]
    fn textures_do_not_overlap() {
        let of = |side: usize| {
            // Some as a sphere has them.
            let (size, repeated) = match side {
                5 | 9 | 17 => ([4 * side, 2 * side], Some(side as u32 / 2)),
                _ => ([side; 2], None),
            };
            let grid = Grid { size, values: vec![Light::default(); size[0] * size[1]] };
            Texture { surface: 0, grid, repeated, page: 0, origin: [0, 0] }
        };
        let mut all: Vec<Texture> = [1, 2, 65, 2, 33, 1, 65, 17, 9, 1, 1, 2, 5].map(of).to_vec();
        for (padding, most) in [(2, 2048), (1, 80), (16, 108)] {
            let pages = place(&mut all, padding, most);
            let mut owner = HashMap::new();
            for (i, texture) in all.iter().enumerate() {
                let [across, down] = texture.size();
                let [w, h] = pages[texture.page as usize];
                assert!(w <= most && h <= most);
                let [x0, y0] = texture.origin;
                assert!(x0 + across + padding <= w && y0 + down + padding <= h, "{i}");
                for y in y0 - padding..y0 + down + padding {
                    for x in x0 - padding..x0 + across + padding {
                        assert_eq!(*owner.entry((texture.page, x, y)).or_insert(i), i);
                    }
                }
            }
        }
    }
}
