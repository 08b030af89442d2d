//! Spheres and polygons as triangles.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

/// A triangle mesh: points and triangles, counter-clockwise seen from outside.
pub(super) type Mesh = (Vec<Vec3>, Vec<[u32; 3]>);

/// Unit sphere from an icosahedron: 20 * 4^subdivisions triangles, corners on the sphere.
pub(super) fn icosphere(subdivisions: u32) -> Mesh {
    let g = (1.0 + 5.0f32.sqrt()) / 2.0;
    let points = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    let points = points.iter().map(|p| Vec3::from_array(*p).normalize()).collect();
    #[rustfmt::skip]
    let faces = vec![
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11],
        [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
        [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9],
        [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
    ];
    subdivide((points, faces), subdivisions)
}

/// Unit sphere from an octahedron: 8 * 4^subdivisions triangles, each within one octant; the triangles of octant o
/// (bit 0: x < 0, bit 1: y < 0, bit 2: z < 0) are the o-th run of 4^subdivisions.
pub(super) fn octasphere(subdivisions: u32) -> Mesh {
    let points = vec![Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let faces = (0..8u32)
        .map(|octant| {
            let (x, y, z) = (octant & 1, 2 + (octant >> 1 & 1), 4 + (octant >> 2));
            // Each reflection reverses the winding.
            if octant.count_ones() % 2 == 0 { [x, y, z] } else { [x, z, y] }
        })
        .collect();
    subdivide((points, faces), subdivisions)
}

/// Replaces each triangle of a unit sphere by four, `times` times.
fn subdivide((mut points, mut faces): Mesh, times: u32) -> Mesh {
    for _ in 0..times {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    (points, faces)
}

/// Cuts a planar polygon into triangles of the same orientation, as indices into `points`.
///
/// Convex polygons become a fan from their first corner; others lose ears one by one. A polygon that crosses itself
/// still gives `points.len() - 2` triangles.
pub(super) fn triangulate(points: &[Vec3]) -> Vec<[usize; 3]> {
    let n = points.len();
    if n < 3 {
        return Vec::new();
    }
    // Newell's normal, also correct for concave polygons.
    let normal: Vec3 = (0..n).map(|i| (points[i] - points[0]).cross(points[(i + 1) % n] - points[0])).sum();
    let corner = |a: usize, b: usize, c: usize| (points[b] - points[a]).cross(points[c] - points[b]).dot(normal);
    if n == 3 || (0..n).all(|i| corner(i, (i + 1) % n, (i + 2) % n) >= 0.0) {
        return (1..n - 1).map(|i| [0, i, i + 1]).collect();
    }
    let (u, v) = normal.normalize_or_zero().any_orthonormal_pair();
    // any_orthonormal_pair gives u x v = normal, so the projection keeps the orientation.
    let flat: Vec<Vec2> = points.iter().map(|p| Vec2::new((*p - points[0]).dot(u), (*p - points[0]).dot(v))).collect();
    let mut rest: Vec<usize> = (0..n).collect();
    let mut triangles = Vec::with_capacity(n - 2);
    while rest.len() > 3 {
        let m = rest.len();
        let ear = (0..m).find(|&i| {
            let [a, b, c] = [rest[(i + m - 1) % m], rest[i], rest[(i + 1) % m]];
            let inside = |p: usize| p != a && p != b && p != c && contains([flat[a], flat[b], flat[c]], flat[p]);
            (flat[b] - flat[a]).perp_dot(flat[c] - flat[b]) > 0.0 && !rest.iter().any(|&p| inside(p))
        });
        let i = ear.unwrap_or(1);
        triangles.push([rest[(i + m - 1) % m], rest[i], rest[(i + 1) % m]]);
        rest.remove(i);
    }
    triangles.push([rest[0], rest[1], rest[2]]);
    triangles
}

fn contains([a, b, c]: [Vec2; 3], p: Vec2) -> bool {
    let side = |a: Vec2, b: Vec2| (b - a).perp_dot(p - a) >= 0.0;
    side(a, b) && side(b, c) && side(c, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_and_volume((points, faces): &Mesh) -> (f64, f64) {
        let corner = |i: u32| points[i as usize].as_dvec3();
        faces.iter().fold((0.0, 0.0), |(area, volume), &[a, b, c]| {
            let (a, b, c) = (corner(a), corner(b), corner(c));
            (area + 0.5 * (b - a).cross(c - a).length(), volume + a.dot(b.cross(c)) / 6.0)
        })
    }

    #[test]
    fn spheres_are_closed_and_face_outwards() {
        for mesh in [icosphere(3), octasphere(4)] {
            let (area, volume) = area_and_volume(&mesh);
            assert!((area / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{area}");
            // Signed volume: positive only if all faces are counter-clockwise seen from outside.
            assert!((volume / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.015, "{volume}");
        }
        assert_eq!(icosphere(3).1.len(), 1280);
    }

    #[test]
    fn octants_are_runs() {
        let (points, faces) = octasphere(2);
        for (i, face) in faces.iter().enumerate() {
            let centre: Vec3 = face.iter().map(|&v| points[v as usize]).sum();
            let octant =
                usize::from(centre.x < 0.0) | usize::from(centre.y < 0.0) << 1 | usize::from(centre.z < 0.0) << 2;
            assert_eq!(octant, i / 16);
        }
    }

    #[test]
    fn concave_polygon_keeps_its_area() {
        // An L of area 3, both ways round and in two planes.
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        for start in 0..6 {
            for flip in [false, true] {
                let mut points: Vec<Vec3> = l.iter().map(|p| Vec3::new(p[0], 5.0, p[1])).collect();
                points.rotate_left(start);
                if flip {
                    points.reverse();
                }
                let triangles = triangulate(&points);
                assert_eq!(triangles.len(), 4);
                let sign = if flip { 1.0 } else { -1.0 };
                let twice: Vec<f32> =
                    triangles.iter().map(|&[a, b, c]| (points[b] - points[a]).cross(points[c] - points[a]).y).collect();
                assert!(twice.iter().all(|t| t * sign >= 0.0), "{twice:?}");
                assert!((twice.iter().sum::<f32>() * sign - 6.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn convex_polygon_becomes_a_fan() {
        let quad = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        assert_eq!(triangulate(&quad), vec![[0, 1, 2], [0, 2, 3]]);
        assert!(triangulate(&quad[..2]).is_empty());
    }
}
