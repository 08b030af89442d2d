//! The surfaces of a scene: pairs of triangles that form a planar convex quadrilateral, and the triangles that are left.
//!
//! The coordinates (s, t) of a quadrilateral are those that its two triangles give it, (0, 0), (1, 0), (1, 1) and (0, 1) at its corners
//! and the diagonal between the first and the third: on a parallelogram they are bilinear, elsewhere they have a bend on the diagonal, as
//! any texture on two triangles has.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::balls::{Ball, balls};
use super::quadtree::Shape;
use super::refine::Root;
use super::sphere;
use crate::bake::sides::Sides;
use crate::error::Result;
use crate::scene::Scene;
use crate::view::Texel;

/// Coordinates of the corners of a triangle that has a surface for itself.
const ALONE: [[f32; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
/// Greatest sine of the angle between two triangles of a quadrilateral.
const PLANAR: f32 = 1e-3;
/// Distance from the edges of a surface of its outermost points, in cells of the finest level: at the edge itself rounding decides on
/// which side of an adjoining wall they lie.
const INWARDS: f32 = 0.05;

/// One side of one or two triangles, or a patch of a sphere.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Shape and area.
    pub root: Root,
    /// Its triangles with the coordinates of their corners: where s >= t, then where s < t.
    pub faces: Vec<(u32, [Vec2; 3])>,
    /// Their backs, else their fronts.
    pub back: bool,
    /// The sphere of which it is a patch, with the patch's number; it has no faces of its own then.
    pub patch: Option<(Arc<Ball>, usize)>,
}

impl PartialEq for Surface {
    fn eq(&self, other: &Surface) -> bool {
        let patch = match (&self.patch, &other.patch) {
            (None, None) => true,
            (Some((a, i)), Some((b, k))) => Arc::ptr_eq(a, b) && i == k,
            _ => false,
        };
        patch && (self.root, &self.faces, self.back) == (other.root, &other.faces, other.back)
    }
}

impl Surface {
    /// The point at coordinates (s, t), moved off the edges by a part of the finest cell of a tree of this height.
    pub fn texel(&self, at: [f32; 2], height: u8) -> Texel {
        if let Some((ball, patch)) = &self.patch {
            return ball.texel(sphere::direction(*patch, at));
        }
        let inset = INWARDS * (-f32::from(height)).exp2();
        let at = match self.root.shape {
            Shape::Quad => Vec2::from_array(at).clamp(Vec2::splat(inset), Vec2::splat(1.0 - inset)),
            Shape::Triangle => {
                let weights = Vec3::new(1.0 - at[0] - at[1], at[0], at[1]).max(Vec3::splat(inset));
                Vec2::new(weights.y, weights.z) / weights.element_sum()
            }
        };
        let upper = self.faces.len() > 1 && at.x < at.y;
        let (triangle, [a, b, c]) = self.faces[usize::from(upper)];
        let (e1, e2, to) = (b - a, c - a, at - a);
        let area = e1.perp_dot(e2);
        Texel { triangle, uv: [to.perp_dot(e2) / area, e1.perp_dot(to) / area], back: self.back }
    }
}

/// Object, material and the positions of the ends of an edge: models often repeat vertices.
type Edge = (u32, u32, [[u32; 3]; 2]);

/// Two triangles, each with the number of the first vertex of their common edge.
struct Pair {
    /// Thousandths by which it misses a parallelogram.
    skew: u32,
    triangles: [(u32, usize); 2],
}

/// The surfaces of the lit sides, in the order of their first triangles, then the patches of spheres. Triangles without area have none.
///
/// Errors: a tree over the triangles of a sphere that cannot be built.
pub fn surfaces(scene: &Scene, sides: &[Sides]) -> Result<Vec<Surface>> {
    let balls = balls(scene, sides)?;
    let taken: HashSet<(u32, bool)> =
        balls.iter().flat_map(|ball| ball.faces().map(|(triangle, _)| (triangle, ball.back()))).collect();
    let mut found = Vec::new();
    for back in [false, true] {
        let lit = |i: u32| {
            sides[i as usize].has(back) && scene.triangle_area(i as usize) > 0.0 && !taken.contains(&(i, back))
        };
        let all: Vec<u32> = (0..scene.triangles.len() as u32).filter(|&i| lit(i)).collect();
        let mut pairs = pairs(scene, &all);
        pairs.sort_by_key(|pair| {
            let [(a, _), (b, _)] = pair.triangles;
            (pair.skew, b - a, a)
        });
        let mut taken = vec![false; scene.triangles.len()];
        for Pair { triangles: [(i, k), (j, m)], .. } in pairs {
            if taken[i as usize] || taken[j as usize] {
                continue;
            }
            taken[i as usize] = true;
            taken[j as usize] = true;
            // The common edge is the diagonal from (1, 1) to (0, 0) of the first, and back of the second.
            let mut corners = [[Vec2::ZERO; 3]; 2];
            for (n, at) in [Vec2::ONE, Vec2::ZERO, Vec2::X].into_iter().enumerate() {
                corners[0][(k + n) % 3] = at;
            }
            for (n, at) in [Vec2::ZERO, Vec2::ONE, Vec2::Y].into_iter().enumerate() {
                corners[1][(m + n) % 3] = at;
            }
            let areas = [i, j].map(|t| scene.triangle_area(t as usize));
            let area = areas[0] + areas[1];
            let root = Root { shape: Shape::Quad, area, halves: areas.map(|a| a / area) };
            found.push(Surface { root, faces: vec![(i, corners[0]), (j, corners[1])], back, patch: None });
        }
        for i in all.into_iter().filter(|&i| !taken[i as usize]) {
            let root = Root { shape: Shape::Triangle, area: scene.triangle_area(i as usize), halves: [0.5; 2] };
            found.push(Surface { root, faces: vec![(i, ALONE.map(Vec2::from_array))], back, patch: None });
        }
    }
    found.sort_by_key(|surface| (surface.faces[0].0, surface.back));
    found.extend(balls.into_iter().flat_map(Ball::surfaces));
    Ok(found)
}

/// The pairs among these triangles that form a planar convex quadrilateral of one object and material.
fn pairs(scene: &Scene, triangles: &[u32]) -> Vec<Pair> {
    let mut edges: HashMap<Edge, Vec<(u32, usize)>> = HashMap::new();
    for &i in triangles {
        let triangle = &scene.triangles[i as usize];
        let positions = scene.triangle_positions(i as usize).map(|p| (p + 0.0).to_array().map(f32::to_bits));
        for k in 0..3 {
            let mut ends = [positions[k], positions[(k + 1) % 3]];
            ends.sort_unstable();
            edges.entry((triangle.object, triangle.material, ends)).or_default().push((i, k));
        }
    }
    let mut found = Vec::new();
    for of_edge in edges.values() {
        // Of many triangles at an edge only those that follow each other are tried.
        for pair in of_edge.windows(2) {
            if let Some(skew) = skew(scene, pair[0], pair[1]) {
                found.push(Pair { skew, triangles: [pair[0], pair[1]] });
            }
        }
    }
    found
}

/// How far two triangles at a common edge are from a parallelogram; `None`: they form no planar convex quadrilateral.
fn skew(scene: &Scene, (i, k): (u32, usize), (j, m): (u32, usize)) -> Option<u32> {
    if i == j {
        return None;
    }
    let [first, second] = [i, j].map(|t| scene.triangle_positions(t as usize));
    let [c, a, b] = [0, 1, 2].map(|n| first[(k + n) % 3]);
    let [a2, c2, d] = [0, 1, 2].map(|n| second[(m + n) % 3]);
    if a != a2 || c != c2 {
        return None;
    }
    let normal = |x: Vec3, y: Vec3, z: Vec3| (y - x).cross(z - x).normalize_or_zero();
    let (n, other) = (normal(a, b, c), normal(a, c, d));
    if n.dot(other) <= 0.0 || n.cross(other).length() > PLANAR {
        return None;
    }
    let corners = [a, b, c, d];
    let edge = |x: usize| (corners[(x + 1) % 4] - corners[x % 4]).normalize_or_zero();
    if (0..4).any(|x| edge(x).cross(edge(x + 1)).dot(n) < PLANAR) {
        return None;
    }
    let size = (c - a).length().max((d - b).length());
    Some((1000.0 * (a + c - b - d).length() / size).round() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Triangle};

    fn scene(triangles: &[[Vec3; 3]]) -> Scene {
        let mut scene =
            Scene { objects: vec![String::from("o")], materials: vec![Material::default()], ..Scene::default() };
        for corners in triangles {
            let first = scene.positions.len() as u32;
            scene.positions.extend(corners);
            let vertices = [first, first + 1, first + 2];
            scene.triangles.push(Triangle { vertices, material: 0, object: 0, smooth: false });
        }
        scene
    }

    const FRONT: Sides = Sides { front: true, back: false };

    fn quad(corners: [[f32; 2]; 4]) -> [[Vec3; 3]; 2] {
        let [a, b, c, d] = corners.map(|[x, y]| Vec3::new(x, y, 1.0));
        // The second begins with another vertex.
        [[a, b, c], [d, a, c]]
    }

    #[test]
    fn triangles_that_form_a_quadrilateral_are_one_surface() {
        let corners = [[0.0, 0.0], [2.0, 0.0], [3.0, 2.0], [0.0, 1.0]];
        let scene = scene(&quad(corners));
        let found = surfaces(&scene, &[FRONT, Sides { front: true, back: true }]).unwrap();
        assert_eq!(found.len(), 2, "the back of one triangle is lit alone");
        let surface = found.iter().find(|s| s.root.shape == Shape::Quad).unwrap();
        assert!(
            (surface.root.area - 3.5).abs() < 1e-6
                && (surface.root.halves[0] + surface.root.halves[1] - 1.0).abs() < 1e-6
        );
        let place = |at: [f32; 2]| {
            let Texel { triangle, uv: [u, v], back } = surface.texel(at, 10);
            assert!(!back && u >= 0.0 && v >= 0.0 && u + v <= 1.00001);
            let [a, b, c] = scene.triangle_positions(triangle as usize);
            (a + u * (b - a) + v * (c - a)).truncate()
        };
        // Up to a turn by two corners the coordinates are those of the quadrilateral.
        let found = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(place);
        let turn = if found[0].length() < 0.01 { 0 } else { 2 };
        for k in 0..4 {
            assert!((found[k] - Vec2::from_array(corners[(k + turn) % 4])).length() < 1e-3, "{found:?}");
        }
        assert!((place([0.5, 0.5]) - Vec2::new(1.5, 1.0)).length() < 1e-5);
    }

    #[test]
    fn parallelograms_are_preferred_and_bends_and_dents_are_none() {
        // A strip of two squares whose triangles could be paired across the squares too.
        let [a, b] = quad([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        let [c, d] = quad([[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]]);
        let strip = scene(&[a, b, c, d]);
        let found = surfaces(&strip, &[FRONT; 4]).unwrap();
        let faces: Vec<Vec<u32>> = found.iter().map(|s| s.faces.iter().map(|f| f.0).collect()).collect();
        assert_eq!(faces, [[0, 1], [2, 3]]);
        let bent = scene(&[a, [Vec3::new(0.0, 1.0, 1.2), a[0], a[2]]]);
        assert_eq!(surfaces(&bent, &[FRONT; 2]).unwrap().len(), 2);
        let dented = scene(&quad([[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]]));
        assert_eq!(surfaces(&dented, &[FRONT; 2]).unwrap().len(), 2);
        let flat = scene(&[[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X], a]);
        let found = surfaces(&flat, &[FRONT; 2]).unwrap();
        assert_eq!((found.len(), found[0].faces[0].0), (1, 1));
    }

    #[test]
    fn points_of_triangles_stay_inside() {
        let scene = scene(&[[Vec3::ZERO, Vec3::X, Vec3::Y]]);
        let surface = &surfaces(&scene, &[FRONT]).unwrap()[0];
        for at in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [0.25, 0.5]] {
            let Texel { uv: [u, v], .. } = surface.texel(at, 4);
            assert!(u > 0.002 && v > 0.002 && u + v < 0.998, "{at:?}");
            assert!((u - at[0]).abs() < 0.01 && (v - at[1]).abs() < 0.01);
        }
    }
}
