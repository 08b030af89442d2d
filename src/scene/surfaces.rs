//! The surfaces that splats are spread over: triangles with a specular lobe that share edges, bent by less than 40 degrees. The faces of
//! a box are six, a ball is one.

use std::collections::HashMap;

use glam::Vec3;

use crate::scene::Scene;

/// Least cosine between the normals of neighbours on one surface, 40 degrees.
const MIN_COSINE: f32 = 0.766;

/// Maximum number of edges of an outline. Splats on surfaces with longer ones, and on curved ones, darken towards their rims.
pub const MAX_EDGES: u32 = 64;

/// Triangles at an edge that one is compared with.
const MAX_NEIGHBOURS: usize = 16;

/// Height of a planar surface's corners above its plane, over its extent.
const FLAT: f32 = 1e-4;

/// A surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Its area.
    pub area: f32,
    /// If it is planar, its outline: directed edges, with the surface on the left as seen from the front of its first triangle.
    pub edges: Vec<[Vec3; 2]>,
}

/// The surfaces of a scene.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    /// The surfaces, in the order of their first triangles.
    pub list: Vec<Surface>,
    /// For each triangle of the scene the index of its surface + 1, or 0.
    pub of_triangle: Vec<u32>,
}

/// A corner, by the bits of its position: meshes repeat corners with other normals.
type Corner = [u32; 3];

pub(super) fn corner(p: Vec3) -> Corner {
    // Of the two zeros one.
    (p + 0.0).to_array().map(f32::to_bits)
}

pub(super) fn root(parents: &mut [u32], mut i: u32) -> u32 {
    while parents[i as usize] != i {
        parents[i as usize] = parents[parents[i as usize] as usize];
        i = parents[i as usize];
    }
    i
}

impl Surfaces {
    /// Of the triangles whose material `counts`.
    pub fn of(scene: &Scene, counts: impl Fn(u32) -> bool) -> Surfaces {
        let members: Vec<u32> =
            (0u32..).zip(&scene.triangles).filter(|(_, t)| counts(t.material)).map(|(i, _)| i).collect();
        let corners = |member: u32| scene.triangle_positions(members[member as usize] as usize);
        let normal = |member: u32| {
            let [a, b, c] = corners(member);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let mut parents: Vec<u32> = (0..members.len() as u32).collect();
        let mut of_edge: HashMap<[Corner; 2], Vec<u32>> = HashMap::new();
        for member in 0..members.len() as u32 {
            let [a, b, c] = corners(member);
            for mut edge in [[a, b], [b, c], [c, a]].map(|edge| edge.map(corner)) {
                edge.sort_unstable();
                let neighbours = of_edge.entry(edge).or_default();
                for &other in neighbours.iter().take(MAX_NEIGHBOURS) {
                    // Sheets may be wound either way.
                    if normal(member).dot(normal(other)).abs() >= MIN_COSINE {
                        let [one, another] = [root(&mut parents, member), root(&mut parents, other)];
                        parents[one.max(another) as usize] = one.min(another);
                    }
                }
                neighbours.push(member);
            }
        }

        let mut surfaces = Surfaces { list: Vec::new(), of_triangle: vec![0; scene.triangles.len()] };
        let mut numbers = vec![0; members.len()];
        let mut parts: Vec<Vec<u32>> = Vec::new();
        for member in 0..members.len() as u32 {
            let first = root(&mut parents, member);
            if first == member {
                parts.push(Vec::new());
                numbers[member as usize] = parts.len() as u32;
            }
            let number = numbers[first as usize];
            surfaces.of_triangle[members[member as usize] as usize] = number;
            parts[number as usize - 1].push(member);
        }
        surfaces.list = (parts.iter())
            .map(|part| {
                let faces: Vec<[Vec3; 3]> = part.iter().map(|&member| corners(member)).collect();
                let area = |face: &[Vec3; 3]| f64::from(0.5 * (face[1] - face[0]).cross(face[2] - face[0]).length());
                Surface { area: faces.iter().map(area).sum::<f64>() as f32, edges: outline(&faces) }
            })
            .collect();
        surfaces
    }
}

/// The outline of a planar part; empty: it is not planar, or its outline is too long.
fn outline(faces: &[[Vec3; 3]]) -> Vec<[Vec3; 2]> {
    let normal = |face: &[Vec3; 3]| (face[1] - face[0]).cross(face[2] - face[0]);
    let Some(first) = faces.iter().find(|face| normal(face) != Vec3::ZERO) else { return Vec::new() };
    let (n, origin) = (normal(first).normalize(), first[0]);
    let off = faces.iter().flatten().map(|&p| p - origin);
    let (extent, height) =
        off.fold((0.0f32, 0.0f32), |(extent, height), off| (extent.max(off.length()), height.max(off.dot(n).abs())));
    if height > FLAT * extent {
        return Vec::new();
    }
    // Edges that two faces have in common run both ways and cancel.
    let mut open: HashMap<[Corner; 2], i32> = HashMap::new();
    let mut order: Vec<[Vec3; 2]> = Vec::new();
    for &[a, mut b, mut c] in faces {
        if (b - a).cross(c - a).dot(n) < 0.0 {
            (b, c) = (c, b);
        }
        for edge in [[a, b], [b, c], [c, a]] {
            let [from, to] = edge.map(corner);
            let reverse = open.entry([to, from]).or_insert(0);
            if *reverse > 0 {
                *reverse -= 1;
            } else {
                *open.entry([from, to]).or_insert(0) += 1;
                order.push(edge);
            }
        }
    }
    let mut edges = Vec::new();
    for edge in order {
        if let Some(left) = open.get_mut(&edge.map(corner)).filter(|left| **left > 0) {
            *left -= 1;
            edges.push(edge);
        }
    }
    if edges.len() > MAX_EDGES as usize { Vec::new() } else { edges }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;
    use crate::scene::tessellate::icosphere;

    fn scene() -> (Scene, u32, u32) {
        let mut scene = Scene::default();
        let material = scene.add_material(Material::default());
        let object = scene.add_object("thing");
        (scene, material, object)
    }

    #[test]
    fn faces_of_a_corner_are_surfaces_of_their_own_with_outlines() {
        let (mut scene, material, object) = scene();
        scene.add_quad(Vec3::ZERO, Vec3::X, Vec3::Y * 2.0, material, object);
        scene.add_quad(Vec3::ZERO, Vec3::Y * 2.0, Vec3::Z, material, object);
        let found = Surfaces::of(&scene, |_| true);
        assert_eq!(found.of_triangle, [1, 1, 2, 2]);
        for surface in &found.list {
            assert!((surface.area - 2.0).abs() < 1e-6, "{}", surface.area);
            assert_eq!(surface.edges.len(), 4, "{:?}", surface.edges);
            let length: f32 = surface.edges.iter().map(|[a, b]| a.distance(*b)).sum();
            assert!((length - 6.0).abs() < 1e-5);
        }
        // The surface is on the left of each edge.
        let first = &found.list[0];
        let middle = Vec3::new(0.5, 1.0, 0.0);
        let side = |[a, b]: &[Vec3; 2]| (*b - *a).cross(middle - *a).z;
        assert!(first.edges.iter().all(|edge| side(edge) > 0.0) || first.edges.iter().all(|edge| side(edge) < 0.0));
    }

    #[test]
    fn a_ball_is_one_surface_without_an_outline_and_other_materials_do_not_count() {
        let (mut scene, material, object) = scene();
        let other = scene.add_material(Material::default());
        scene.add_quad(Vec3::ZERO, Vec3::X, Vec3::Y, other, object);
        let (points, faces) = icosphere(3);
        scene.add_mesh(&points, &faces, material, object);
        let found = Surfaces::of(&scene, |m| m == material);
        assert_eq!(found.list.len(), 1);
        assert!(found.list[0].edges.is_empty());
        assert!((found.list[0].area / (4.0 * std::f32::consts::PI) - 1.0).abs() < 0.03, "{}", found.list[0].area);
        assert_eq!(found.of_triangle[..2], [0, 0]);
        assert!(found.of_triangle[2..].iter().all(|&s| s == 1));
    }

    #[test]
    fn sheets_wound_either_way_are_one_surface() {
        let (mut scene, material, object) = scene();
        scene.add_quad(Vec3::ZERO, Vec3::X, Vec3::Y, material, object);
        // Its neighbour faces the other way.
        scene.add_quad(Vec3::X, Vec3::Y, Vec3::X, material, object);
        let found = Surfaces::of(&scene, |_| true);
        assert_eq!(found.of_triangle, [1; 4]);
        assert_eq!(found.list[0].edges.len(), 6, "{:?}", found.list[0].edges);
    }
}
