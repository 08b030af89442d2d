//! Spheres and polygons as triangles.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec3};

use super::large_polygon;

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

/// Most corners of a polygon that [`triangulate`] takes, at some hundred bytes for each.
pub(super) const MOST_CORNERS: usize = 1 << 25;

/// Concave polygons of more corners are cut by [`large_polygon::cut`].
const MANY_CORNERS: usize = 1000;

/// Greatest number of corners of a polygon that crosses or touches itself: earcut takes up to about a second for it.
const MOST_CROSSING_CORNERS: usize = 20_000;

/// Cuts a planar polygon into triangles of the same orientation, as indices into `points`.
///
/// Convex polygons become a fan from their first corner. earcut cuts others, which may leave out corners on a straight edge;
/// [`large_polygon::cut`] those of more than [`MANY_CORNERS`], where it can. Error: a polygon of more than
/// [`MOST_CROSSING_CORNERS`] crosses or touches itself.
pub(super) fn triangulate(points: &[DVec3]) -> Result<Vec<[u32; 3]>, String> {
    let all = points.len();
    if all <= 3 {
        return Ok(if all == 3 { vec![[0, 1, 2]] } else { Vec::new() });
    }
    // Beside a repeated corner no turn would show that the polygon is concave.
    let mut corners: Vec<u32> = (0..all).filter(|&i| points[i] != points[(i + 1) % all]).map(|i| i as u32).collect();
    if corners.len() < 3 {
        corners = (0..all as u32).collect();
    }
    let n = corners.len();
    let at = |k: usize| points[corners[k % n] as usize];
    let of_corners = |[a, b, c]: [u32; 3]| [a, b, c].map(|k| corners[k as usize]);
    // Newell's normal, also correct for concave polygons.
    let normal: DVec3 = (0..n).map(|i| (at(i) - at(0)).cross(at(i + 1) - at(0))).sum();
    let turns_left = |i: usize| (at(i + 1) - at(i)).cross(at(i + 2) - at(i + 1)).dot(normal) >= 0.0;
    if n == 3 || (0..n).all(turns_left) {
        return Ok((1..n as u32 - 1).map(|i| of_corners([0, i, i + 1])).collect());
    }
    if n > MANY_CORNERS {
        // Seen along an axis: no rounding moves a corner over a near edge.
        let axis = normal.abs().max_position();
        let (mut x, mut y) = ((axis + 1) % 3, (axis + 2) % 3);
        if normal[axis] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let flat: Vec<DVec2> = (0..n).map(|i| DVec2::new(at(i)[x], at(i)[y])).collect();
        if let Some(triangles) = large_polygon::cut(&flat) {
            return Ok(triangles.into_iter().map(of_corners).collect());
        }
        if n > MOST_CROSSING_CORNERS {
            return Err(format!("a face of {all} corners crosses or touches itself; cut it into simple faces"));
        }
    }
    let (u, v) = normal.normalize_or_zero().any_orthonormal_pair();
    // any_orthonormal_pair gives u x v = normal, so the projection keeps the orientation.
    let flat = (0..n).map(|i| [(at(i) - at(0)).dot(u), (at(i) - at(0)).dot(v)]);
    let mut indices: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(flat, &[], &mut indices);
    Ok(indices.as_chunks().0.iter().map(|&triangle| of_corners(triangle)).collect())
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

    /// Twice the signed area of each triangle, seen along `normal`.
    fn areas(points: &[DVec3], normal: DVec3) -> Vec<f64> {
        let corner = |i: u32| points[i as usize];
        let twice = |[a, b, c]: [u32; 3]| (corner(b) - corner(a)).cross(corner(c) - corner(a)).dot(normal);
        triangulate(points).unwrap().into_iter().map(twice).collect()
    }

    #[test]
    fn concave_polygon_keeps_its_area() {
        // An L of area 3, both ways round and in two planes.
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        for start in 0..6 {
            for flip in [false, true] {
                let mut points: Vec<DVec3> = l.iter().map(|p| DVec3::new(p[0], 5.0, p[1])).collect();
                points.rotate_left(start);
                if flip {
                    points.reverse();
                }
                let twice = areas(&points, if flip { DVec3::Y } else { DVec3::NEG_Y });
                assert_eq!(twice.len(), 4);
                assert!(twice.iter().all(|&t| t > 0.0), "{twice:?}");
                assert!((twice.iter().sum::<f64>() - 6.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn large_concave_polygons_keep_their_area() {
        let n = 200_000;
        // A star, a comb and a spiral, in an oblique plane far from the origin.
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
        let star = |i: usize| DVec2::from_angle(angle(i)) * [1.0, 0.5][i % 2];
        let comb =
            |i: usize| if i == n - 1 { DVec2::new(0.5, -1.0) } else { DVec2::new(i as f64 / n as f64, (i % 2) as f64) };
        let spiral = |i: usize| {
            let (k, width) = if i <= n / 2 { (i, 0.0) } else { (n - i, 0.02) };
            DVec2::from_angle(k as f64 * 1e-2) * (1.0 + k as f64 * 1e-4 + width)
        };
        let shapes: [&dyn Fn(usize) -> DVec2; 3] = [&star, &comb, &spiral];
        let normal = DVec3::new(0.6, -0.48, 0.64);
        let (u, v) = normal.any_orthonormal_pair();
        for (which, shape) in shapes.into_iter().enumerate() {
            let flat: Vec<DVec2> = (0..n).map(shape).collect();
            let twice: f64 = (0..n).map(|i| flat[i].perp_dot(flat[(i + 1) % n])).sum();
            let far = DVec3::new(1e3, -2e3, 5e2);
            let points: Vec<DVec3> = flat.iter().map(|p| far + p.x * u + p.y * v).collect();
            let found = areas(&points, normal * twice.signum());
            let ratio = found.iter().sum::<f64>() / twice.abs();
            assert!((ratio - 1.0).abs() < 1e-9, "{which}: {ratio}, {} triangles", found.len());
            assert!(found.iter().all(|&t| t > -1e-9), "{which}");
            assert_eq!(found.len(), n - 2, "{which}");
        }
    }

    #[test]
    fn any_polygon_is_cut() {
        // Crossing itself, with repeated and collinear corners, without area.
        let place = |i: u32, k: u32| f64::from((i * 2_654_435 + k * 40_503 + i * i * 7) % 5);
        for n in 3..60 {
            for k in 0..40 {
                let points: Vec<DVec3> = (0..n).map(|i| DVec3::new(place(i, k), place(i + 31, k + 3), 0.0)).collect();
                assert!(triangulate(&points).unwrap().iter().flatten().all(|&c| c < n));
            }
        }
        assert!(triangulate(&[DVec3::ZERO; 7]).unwrap().len() <= 5);
    }

    #[test]
    fn large_polygons_that_cross_themselves() {
        // Two loops of opposite orientation, of different size.
        let figure = |n: usize| -> Vec<DVec3> {
            let angle = |i: usize| std::f64::consts::TAU * (i as f64 + 0.3) / n as f64;
            (0..n).map(|i| DVec3::new(angle(i).cos(), (2.0 * angle(i)).sin() + 0.2 * angle(i).sin(), 0.0)).collect()
        };
        assert!(triangulate(&figure(2 * MANY_CORNERS)).is_ok_and(|triangles| !triangles.is_empty()));
        let error = triangulate(&figure(2 * MOST_CROSSING_CORNERS)).unwrap_err();
        assert_eq!(error, "a face of 40000 corners crosses or touches itself; cut it into simple faces");
    }

    #[test]
    fn convex_polygon_becomes_a_fan() {
        let quad = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        assert_eq!(triangulate(&quad).unwrap(), vec![[0, 1, 2], [0, 2, 3]]);
        assert!(triangulate(&quad[..2]).unwrap().is_empty());
    }
}
