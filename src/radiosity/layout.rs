//! Textures of surfaces on pages: a budget, a place for each, and the light map of all.
//!
//! Only the most subdivided surfaces have textures of their own size, 2^h + 1 texels a side, as long as the budget lasts (Bastos 1999,
//! 1.3.1). The rest have 2 x 2 texels, their corners, and those on which light is even have one.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::Light;
use super::quadtree::Shape;
use super::reconstruct::{beyond, fill, filter};
use super::refine::{Order, Solution};
use super::surfaces::Surface;
use super::texture::{Grid, accumulate};

/// The texture of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// 2^h + 1 texels a side, or one.
    pub grid: Grid<Light>,
    /// Page, and place of its first texel there.
    pub page: u32,
    /// Column and row.
    pub origin: [u32; 2],
}

impl Texture {
    /// Position on the page in texels of a point of the surface: corners lie at centres of texels.
    pub fn place(&self, at: Vec2) -> Vec2 {
        let span = (self.grid.size[0] - 1) as f32;
        Vec2::new(self.origin[0] as f32, self.origin[1] as f32) + 0.5 + span * at
    }
}

/// Textures of all surfaces, with places still to be chosen. `budget`: texels of textures with more than 2 x 2; `width`: of the filter,
/// 2 to 6.
pub fn textures(surfaces: &[Surface], solution: &Solution, budget: u64, width: u32) -> Vec<Texture> {
    let side = |i: usize| (1u64 << solution.trees[i].height()) + 1;
    let mut order: Vec<usize> = (0..surfaces.len()).filter(|&i| solution.trees[i].height() > 0).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(solution.trees[i].leaf_count()), i));
    let mut own = vec![false; surfaces.len()];
    let mut left = budget;
    for i in order {
        if side(i) * side(i) <= left {
            left -= side(i) * side(i);
            own[i] = true;
        }
    }
    let grid = |i: usize| {
        let shape = surfaces[i].root.shape;
        let height = if own[i] { solution.trees[i].height() } else { 0 };
        let full = clamped(&filter(&fill(shape, height, vertices(solution, i, height)), shape, width));
        let even = !own[i] && solution.trees[i].height() == 0 && is_even(&full, shape, solution);
        let light = solution.mean_of(i, surfaces[i].root.halves);
        if even { Grid::square(1, light) } else { full }
    };
    let grids: Vec<Grid<Light>> = (0..surfaces.len()).into_par_iter().map(grid).collect();
    grids.into_iter().map(|grid| Texture { grid, page: 0, origin: [0, 0] }).collect()
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
    let outer = |texture: &Texture| texture.grid.size[0] as u32 + 2 * padding;
    let mut order: Vec<usize> = (0..textures.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(outer(&textures[i])), i));
    let area: u64 = textures.iter().map(|t| u64::from(outer(t)).pow(2)).sum();
    let largest = textures.iter().map(outer).max().unwrap_or(1);
    let width = ((area as f64 * 1.05).sqrt().ceil() as u32).clamp(largest, most.max(largest));
    let mut pages: Vec<[u32; 2]> = Vec::new();
    let (mut x, mut y, mut row) = (width, 0, 0);
    for i in order {
        let side = outer(&textures[i]);
        if x + side > width {
            (x, y, row) = (0, y + row, side);
        }
        if pages.is_empty() || y + side > most.max(largest) {
            pages.push([width, 0]);
            (x, y, row) = (0, 0, side);
        }
        textures[i].page = pages.len() as u32 - 1;
        textures[i].origin = [x + padding, y + padding];
        if let Some(page) = pages.last_mut() {
            page[1] = page[1].max(y + side);
        }
        x += side;
    }
    pages
}

/// Light of a texel of a texture or around it, by column and row from its first one.
pub fn texel(texture: &Texture, at: [i64; 2]) -> Light {
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
        let surfaces = roots.map(|root| Surface { root, faces: Vec::new(), back: false });
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
                textures(&surfaces, &solution, budget, 2).iter().map(|t| t.grid.size[0]).collect()
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
        for texture in textures(&surfaces, &solution, 1 << 20, 4) {
            let n = texture.grid.size[0];
            let shape = if texture.grid.size == [1, 1] { 1 } else { n };
            assert!((0..shape).all(|i| (texture.grid.at([i, 0]).direct.x - 2.0).abs() < 1e-5));
        }
    }

    #[test]
    fn textures_do_not_overlap() {
        let of = |side: usize| Texture { grid: Grid::square(side, Light::default()), page: 0, origin: [0, 0] };
        let mut all: Vec<Texture> = [1, 2, 65, 2, 33, 1, 65, 17, 9, 1, 1, 2, 5].map(of).to_vec();
        for (padding, most) in [(2, 2048), (1, 80), (16, 97)] {
            let pages = place(&mut all, padding, most);
            let mut owner = HashMap::new();
            for (i, texture) in all.iter().enumerate() {
                let side = texture.grid.size[0] as u32;
                let [w, h] = pages[texture.page as usize];
                assert!(w <= most && h <= most);
                let [x0, y0] = texture.origin;
                assert!(x0 + side + padding <= w && y0 + side + padding <= h, "{i}");
                for y in y0 - padding..y0 + side + padding {
                    for x in x0 - padding..x0 + side + padding {
                        assert_eq!(*owner.entry((texture.page, x, y)).or_insert(i), i);
                    }
                }
            }
        }
    }
}
