//! Charts that a file brings: the places of its vertices on light maps ([`Scene::lightmap_uvs`]), kept as they are.
//!
//! The places of an object are good if they lie in [0, 1] and its triangles do not overlap there. If all objects together do not
//! overlap either, they share a page, else each has a page of its own, as programs that bake object by object make them. Triangles
//! without an area on the map, the second side of triangles that are lit on both, and objects whose places are not good are left
//! for new charts.

use std::collections::{BTreeMap, HashMap};

use glam::Vec2;

use super::Options;
use super::charts::{Charts, Face};
use super::sides::Sides;
use crate::scene::Scene;

/// Cells along a side of a map on which overlaps are found.
const CELLS: i32 = 1024;
/// Distance in cells from the border of a triangle up to which a cell may belong to its neighbour too.
const BORDER: f32 = 0.05;
/// Part of an object's cells that may overlap: no unwrapper leaves none at all.
const MAY_OVERLAP: f32 = 1e-3;
/// How far beyond the map a place may lie by rounding.
const BEYOND: f32 = 1e-4;
/// Least area of a triangle on the map as a part of it.
const LEAST_AREA: f32 = 1e-10;
/// Least width of a page.
const LEAST_SIZE: u32 = 16;

/// Lit triangles of an object with their places.
struct Object {
    index: u32,
    triangles: Vec<u32>,
}

/// The charts of the file, and the sides that are left for new ones. Objects that are left as a whole are told in the log.
pub fn of_file(scene: &Scene, sides: &[Sides], density: f32, options: &Options) -> (Charts, Vec<Sides>) {
    let mut charts = Charts { pages: Vec::new(), faces: Vec::new(), count: 0, density };
    let mut rest = sides.to_vec();
    if options.new_charts || scene.lightmap_uvs.is_empty() {
        return (charts, rest);
    }
    let mut lit: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (i, triangle) in (0u32..).zip(&scene.triangles).filter(|(i, _)| sides[*i as usize].count() > 0) {
        lit.entry(triangle.object).or_default().push(i);
    }
    let mut objects = Vec::new();
    for (index, triangles) in lit {
        match good(scene, &triangles) {
            Ok(triangles) => objects.push(Object { index, triangles }),
            Err(why) => {
                let name = &scene.objects[index as usize];
                log::warn!("object {name:?} gets new charts: its texture coordinates of light maps {why}");
            }
        }
    }
    let mut cells = Cells::default();
    objects.iter().for_each(|object| cells.add(scene, &object.triangles));
    // The first page is that of all objects, or each has the next one.
    let shared = cells.are_apart();
    let groups: Vec<&[Object]> = if shared { vec![&objects] } else { objects.chunks(1).collect() };
    for group in groups.into_iter().filter(|group| !group.is_empty()) {
        let of_group = || group.iter().flat_map(|object| object.triangles.iter().copied());
        let of_map: f64 = of_group().map(|i| f64::from(area(places(scene, i)))).sum();
        let of_surface: f64 = of_group().map(|i| f64::from(scene.triangle_area(i as usize))).sum();
        let wanted = f64::from(density) * (of_surface / of_map).sqrt();
        let size = (wanted.ceil() as u32).clamp(LEAST_SIZE, options.max_size);
        if wanted > 1.01 * f64::from(options.max_size) {
            let name = &scene.objects[group[0].index as usize];
            let found = f64::from(density) * f64::from(size) / wanted;
            log::warn!(
                "the map of {name:?} has {found:.3} texels a unit, for --max-size {} allows no more",
                options.max_size
            );
        }
        let page = charts.pages.len() as u32;
        charts.pages.push([size; 2]);
        for object in group {
            let numbers = connected(scene, &object.triangles);
            let most = numbers.iter().max().map_or(0, |n| n + 1);
            for (&triangle, number) in object.triangles.iter().zip(numbers) {
                let left = &mut rest[triangle as usize];
                let back = !left.front;
                *(if back { &mut left.back } else { &mut left.front }) = false;
                let corners =
                    places(scene, triangle).map(|uv| uv.clamp(Vec2::ZERO, Vec2::ONE) * Vec2::splat(size as f32));
                charts.faces.push(Face { triangle, back, page, chart: charts.count + number, corners });
            }
            charts.count += most;
        }
    }
    (charts, rest)
}

/// The places of a triangle's corners.
fn places(scene: &Scene, triangle: u32) -> [Vec2; 3] {
    scene.triangles[triangle as usize].vertices.map(|v| scene.lightmap_uvs[v as usize])
}

fn area([a, b, c]: [Vec2; 3]) -> f32 {
    0.5 * (b - a).perp_dot(c - a).abs()
}

/// The triangles of an object with an area on the map; or why its places are not good.
fn good(scene: &Scene, triangles: &[u32]) -> Result<Vec<u32>, &'static str> {
    let all = || triangles.iter().flat_map(|&i| places(scene, i));
    if all().all(|uv| uv == Vec2::NEG_ONE) {
        return Err("are missing");
    }
    if !all().all(|uv| uv.cmpge(Vec2::splat(-BEYOND)).all() && uv.cmple(Vec2::splat(1.0 + BEYOND)).all()) {
        return Err("lie outside of [0, 1]");
    }
    let with_area: Vec<u32> = triangles.iter().copied().filter(|&i| area(places(scene, i)) > LEAST_AREA).collect();
    if with_area.is_empty() {
        return Err("have no area");
    }
    let mut cells = Cells::default();
    cells.add(scene, &with_area);
    if cells.are_apart() { Ok(with_area) } else { Err("overlap") }
}

/// Cells of a map that triangles cover.
#[derive(Default)]
struct Cells {
    covered: Vec<u64>,
    once: usize,
    twice: usize,
}

impl Cells {
    fn add(&mut self, scene: &Scene, triangles: &[u32]) {
        self.covered.resize((CELLS * CELLS / 64) as usize, 0);
        for &triangle in triangles {
            let [a, b, c] = places(scene, triangle).map(|uv| uv * Vec2::splat(CELLS as f32));
            let turn = (b - a).perp_dot(c - a).signum();
            let inside = |p: Vec2| {
                let beyond = |from: Vec2, to: Vec2| {
                    let along = to - from;
                    turn * along.perp_dot(p - from) > BORDER * along.length()
                };
                beyond(a, b) && beyond(b, c) && beyond(c, a)
            };
            let (low, high) = (a.min(b).min(c) - 0.5, a.max(b).max(c) - 0.5);
            let range = |low: f32, high: f32| (low.ceil() as i32).max(0)..=(high.floor() as i32).min(CELLS - 1);
            for y in range(low.y, high.y) {
                for x in range(low.x, high.x) {
                    if inside(Vec2::new(x as f32 + 0.5, y as f32 + 0.5)) {
                        let (word, bit) = ((x + y * CELLS) as usize / 64, 1u64 << (x % 64));
                        let again = self.covered[word] & bit != 0;
                        *(if again { &mut self.twice } else { &mut self.once }) += 1;
                        self.covered[word] |= bit;
                    }
                }
            }
        }
    }

    fn are_apart(&self) -> bool {
        self.twice as f32 <= MAY_OVERLAP * self.once as f32
    }
}

/// Number of the chart of each triangle: those that share a place at a vertex belong together.
fn connected(scene: &Scene, triangles: &[u32]) -> Vec<u32> {
    let mut of_place: HashMap<[u32; 2], usize> = HashMap::new();
    let mut parent: Vec<usize> = (0..triangles.len()).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    for (i, &triangle) in triangles.iter().enumerate() {
        for uv in places(scene, triangle) {
            let other = *of_place.entry(uv.to_array().map(f32::to_bits)).or_insert(i);
            let [a, b] = [i, other].map(|k| root(&mut parent, k));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut numbers: HashMap<usize, u32> = HashMap::new();
    (0..triangles.len())
        .map(|i| {
            let next = numbers.len() as u32;
            *numbers.entry(root(&mut parent, i)).or_insert(next)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    const FRONT: Sides = Sides { front: true, back: false };

    /// Two squares, an object each, whose places are these of their corners.
    fn squares(first: [[f32; 2]; 4], second: [[f32; 2]; 4]) -> Scene {
        let mut scene = builtin::facing_plates(1.0);
        assert_eq!((scene.positions.len(), scene.triangles.len(), scene.objects.len()), (8, 4, 2));
        scene.lightmap_uvs = first.into_iter().chain(second).map(Vec2::from_array).collect();
        scene
    }

    fn square(low: f32, high: f32) -> [[f32; 2]; 4] {
        [[low, low], [high, low], [high, high], [low, high]]
    }

    fn of(scene: &Scene, sides: Sides) -> (Charts, Vec<Sides>) {
        of_file(scene, &[sides; 4], 10.0, &Options::default())
    }

    #[test]
    fn objects_that_are_apart_share_a_page() {
        let scene = squares(square(0.0, 0.5), square(0.5, 1.0));
        let (charts, rest) = of(&scene, FRONT);
        assert_eq!((charts.pages.len(), charts.faces.len(), charts.count), (1, 4, 2));
        assert!(rest.iter().all(|sides| sides.count() == 0));
        let [size, _] = charts.pages[0];
        let face = charts.faces.iter().find(|f| f.triangle == 0).unwrap();
        let expected = scene.triangles[0].vertices.map(|v| scene.lightmap_uvs[v as usize] * size as f32);
        assert_eq!((face.corners, face.back), (expected, false));
        let surface: f32 = (0..4).map(|i| scene.triangle_area(i)).sum();
        assert_eq!(size, (10.0 * (surface / 0.5).sqrt()).ceil() as u32, "the density that is asked for");
        let most = of_file(&scene, &[FRONT; 4], 1e5, &Options { max_size: 64, ..Options::default() });
        assert_eq!(most.0.pages, [[64, 64]], "as large as a page may be");
    }

    #[test]
    fn objects_that_overlap_have_a_page_each() {
        let (charts, rest) = of(&squares(square(0.1, 0.9), square(0.2, 1.0)), FRONT);
        assert_eq!(charts.pages.len(), 2);
        assert!(charts.faces.iter().all(|f| f.page == f.triangle / 2) && rest.iter().all(|s| s.count() == 0));
    }

    #[test]
    fn what_is_not_good_is_left() {
        let whole = square(0.0, 1.0);
        let folded = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.9, 0.1]];
        for (second, why) in [
            (square(0.5, 1.2), "outside"),
            (square(f32::NAN, 1.0), "outside"),
            (square(-1.0, -1.0), "missing"),
            (square(0.3, 0.3), "no area"),
            (folded, "overlap"),
        ] {
            let scene = squares(whole, second);
            let (charts, rest) = of(&scene, FRONT);
            assert_eq!(charts.faces.iter().map(|f| f.triangle).collect::<Vec<_>>(), [0, 1], "{why}");
            assert!(rest[2] == FRONT && rest[3] == FRONT, "{why}");
            assert!(good(&scene, &[2, 3]).unwrap_err().contains(why), "{why}");
        }
        // A triangle whose corners lie on a line of the map.
        let (charts, rest) = of(&squares(whole, [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, 0.5]]), FRONT);
        assert_eq!((charts.faces.len(), rest[2].count(), rest[3].count()), (3, 0, 1));
    }

    #[test]
    fn the_second_side_is_left() {
        let scene = squares(square(0.0, 0.5), square(0.5, 1.0));
        let (charts, rest) = of(&scene, Sides { front: true, back: true });
        assert!(charts.faces.len() == 4 && charts.faces.iter().all(|f| !f.back));
        assert!(rest.iter().all(|s| *s == Sides { front: false, back: true }));
        let (charts, _) = of(&scene, Sides { front: false, back: true });
        assert!(charts.faces.len() == 4 && charts.faces.iter().all(|f| f.back));
        let options = Options { new_charts: true, ..Options::default() };
        assert!(of_file(&scene, &[FRONT; 4], 10.0, &options).0.faces.is_empty());
    }
}
