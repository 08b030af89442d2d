//! Spheres among the meshes of a scene: connected smooth triangles of one object and material whose vertices lie on a sphere and whose
//! faces cover it once. They are sampled as six patches and have one texture of latitude and longitude ([`super::sphere`]).
//!
//! The poles are two opposite vertices, those with the most triangles, and an edge of the mesh begins the seam: so the triangles of a
//! sphere made of rings are rectangles on the texture, and no triangle has a pole inside of it. A triangle at a pole has the middle of its
//! other two longitudes there. Triangles that cross the seam go on beyond the right border, where the texture is repeated. Meshes without
//! opposite vertices stay meshes.

use std::collections::HashMap;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DMat4, DVec3, DVec4, Mat3, Vec2, Vec3};

use super::quadtree::Shape;
use super::refine::Root;
use super::sphere::{self, PATCHES};
use super::surfaces::Surface;
use crate::accel::{Bvh, Ray};
use crate::bake::sides::Sides;
use crate::error::Result;
use crate::scene::{Material, Scene, Triangle};
use crate::view::Texel;

/// Greatest distance of a vertex from the sphere, and of an opposite vertex from its place, as a part of the radius.
const TOLERANCE: f64 = 2e-3;
/// Least distance of a face's plane from the centre as a part of the radius: coarser meshes are polyhedra.
const LEAST_DISTANCE: f32 = 0.95;
/// Greatest error of the covered solid angle, as a part of the sphere.
const UNCOVERED: f32 = 1e-2;
/// Fewest triangles with faces as small as that.
const LEAST_TRIANGLES: usize = 64;

/// One side of a sphere.
#[derive(Debug)]
pub struct Ball {
    centre: Vec3,
    /// Radius.
    pub radius: f32,
    /// From the axes of latitude and longitude to those of the scene.
    axes: Mat3,
    triangles: Vec<u32>,
    back: bool,
    /// The tree of the triangles alone.
    bvh: Bvh,
    /// Places of the corners of each triangle: longitude in turns from 0, beyond 1 if it crosses the seam; latitude from 0, the south
    /// pole, to 1.
    places: Vec<[Vec2; 3]>,
}

impl Ball {
    /// The point in a direction from the centre, in the axes of latitude and longitude.
    pub fn texel(&self, direction: Vec3) -> Texel {
        let ray = |d: Vec3| Ray::new(self.centre, self.axes * d);
        // Between two triangles rounding may miss both.
        let beside = direction + 1e-4 * direction.any_orthonormal_vector();
        let hit = self.bvh.closest(&ray(direction)).or_else(|| self.bvh.closest(&ray(beside.normalize())));
        match hit {
            Some(hit) => {
                let triangle = self.triangles[self.bvh.scene_triangle(hit.triangle) as usize];
                let [u, v] = [hit.u, hit.v].map(|w| w.max(0.0));
                Texel { triangle, uv: [u, v].map(|w| w / (u + v).max(1.0)), back: self.back }
            }
            None => Texel { triangle: self.triangles[0], uv: [1.0 / 3.0; 2], back: self.back },
        }
    }

    /// The triangles with the places of their corners.
    pub fn faces(&self) -> impl Iterator<Item = (u32, [Vec2; 3])> {
        self.triangles.iter().copied().zip(self.places.iter().copied())
    }

    /// Whether it is the back of its triangles.
    pub fn back(&self) -> bool {
        self.back
    }

    /// How far triangles reach beyond the seam, in turns.
    pub fn overhang(&self) -> f32 {
        self.places.iter().flatten().map(|place| place.x - 1.0).fold(0.0, f32::max)
    }

    /// Its six patches.
    pub fn surfaces(self) -> [Surface; PATCHES] {
        let area = 4.0 * PI * self.radius * self.radius / PATCHES as f32;
        let back = self.back;
        let ball = Arc::new(self);
        let root = Root { shape: Shape::Quad, area, halves: [0.5; 2] };
        std::array::from_fn(|patch| Surface { root, faces: Vec::new(), back, patch: Some((ball.clone(), patch)) })
    }

    /// A sphere of triangles, if they are one.
    fn of(scene: &Scene, triangles: &[u32], back: bool) -> Result<Option<Ball>> {
        let corners: Vec<[Vec3; 3]> = triangles.iter().map(|&t| scene.triangle_positions(t as usize)).collect();
        let Some((centre, radius)) = fitted(&corners) else { return Ok(None) };
        if !covers(&corners, centre, radius) {
            return Ok(None);
        }
        let Some(axes) = axes(&corners, centre, radius) else { return Ok(None) };
        let local = |p: Vec3| (axes.transpose() * (p - centre)).normalize();
        let places = corners.iter().map(|of| places(of.map(local))).collect();
        let part = Scene {
            positions: corners.iter().flatten().copied().collect(),
            triangles: (0..triangles.len() as u32)
                .map(|i| Triangle { vertices: [3 * i, 3 * i + 1, 3 * i + 2], material: 0, object: 0, smooth: false })
                .collect(),
            materials: vec![Material::default()],
            objects: vec![String::from("ball")],
            ..Scene::default()
        };
        let bvh = Bvh::build(&part)?;
        Ok(Some(Ball { centre, radius, axes, triangles: triangles.to_vec(), back, bvh, places }))
    }
}

/// The lit sides of all spheres, in the order of their first triangles.
pub fn balls(scene: &Scene, sides: &[Sides]) -> Result<Vec<Ball>> {
    let mut found = Vec::new();
    for triangles in components(scene).into_iter().filter(|of| of.len() >= LEAST_TRIANGLES) {
        for back in [false, true] {
            if triangles.iter().any(|&t| sides[t as usize].has(back)) {
                found.extend(Ball::of(scene, &triangles, back)?);
            }
        }
    }
    Ok(found)
}

/// Smooth triangles with area that are connected by their vertices' positions.
fn components(scene: &Scene) -> Vec<Vec<u32>> {
    let smooth = |i: &u32| scene.triangles[*i as usize].smooth && scene.triangle_area(*i as usize) > 0.0;
    let all: Vec<u32> = (0..scene.triangles.len() as u32).filter(smooth).collect();
    // A forest over the triangles; vertices join them.
    let mut above: Vec<u32> = (0..all.len() as u32).collect();
    fn root(above: &mut [u32], mut i: u32) -> u32 {
        while above[i as usize] != i {
            above[i as usize] = above[above[i as usize] as usize];
            i = above[i as usize];
        }
        i
    }
    let mut first: HashMap<(u32, u32, [u32; 3]), u32> = HashMap::new();
    for (k, &i) in (0u32..).zip(&all) {
        let triangle = &scene.triangles[i as usize];
        for p in scene.triangle_positions(i as usize) {
            let place = (p + 0.0).to_array().map(f32::to_bits);
            let other = *first.entry((triangle.object, triangle.material, place)).or_insert(k);
            let (a, b) = (root(&mut above, k), root(&mut above, other));
            above[a.max(b) as usize] = a.min(b);
        }
    }
    // Roots are the first triangles of their parts.
    let mut parts: Vec<Vec<u32>> = Vec::new();
    let mut number: HashMap<u32, usize> = HashMap::new();
    for k in 0..all.len() as u32 {
        let part = *number.entry(root(&mut above, k)).or_insert(parts.len());
        if part == parts.len() {
            parts.push(Vec::new());
        }
        parts[part].push(all[k as usize]);
    }
    parts
}

/// Centre and radius of the sphere through all corners, by least squares of |p|^2 = 2 c . p + k; `None`: they lie on none.
fn fitted(corners: &[[Vec3; 3]]) -> Option<(Vec3, f32)> {
    let all = || corners.iter().flatten().map(|p| p.as_dvec3());
    let count = 3.0 * corners.len() as f64;
    let mean = all().sum::<DVec3>() / count;
    let scale = all().map(|p| (p - mean).length()).fold(0.0, f64::max);
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let (mut matrix, mut right) = (DMat4::ZERO, DVec4::ZERO);
    for p in all().map(|p| (p - mean) / scale) {
        let row = p.extend(1.0);
        matrix += DMat4::from_cols(row * row.x, row * row.y, row * row.z, row * row.w);
        right += row * p.length_squared();
    }
    if matrix.determinant().abs() < 1e-9 * count.powi(4) {
        return None;
    }
    let found = matrix.inverse() * right;
    let centre = found.truncate() * 0.5;
    let radius = (found.w + centre.length_squared()).sqrt();
    let off = all().map(|p| (((p - mean) / scale - centre).length() / radius - 1.0).abs()).fold(0.0, f64::max);
    // False for NaN too.
    (off <= TOLERANCE).then(|| ((mean + scale * centre).as_vec3(), (radius * scale) as f32))
}

/// Whether faces cover a sphere once, all small and facing the same way.
fn covers(corners: &[[Vec3; 3]], centre: Vec3, radius: f32) -> bool {
    let (mut sum, mut facing) = (0.0, [false; 2]);
    for of in corners {
        let [a, b, c] = of.map(|p| p - centre);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        if normal.dot(a).abs() < LEAST_DISTANCE * radius {
            return false;
        }
        // Van Oosterom and Strackee: the tangent of half of the solid angle.
        let [a, b, c] = [a, b, c].map(Vec3::normalize);
        let angle = 2.0 * a.dot(b.cross(c)).atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        facing[usize::from(angle > 0.0)] = true;
        sum += f64::from(angle);
    }
    facing != [true; 2] && (sum.abs() as f32 / (4.0 * PI) - 1.0).abs() < UNCOVERED
}

/// Axes whose second leads through two opposite vertices, those with the most triangles, and whose first begins the seam at an edge.
fn axes(corners: &[[Vec3; 3]], centre: Vec3, radius: f32) -> Option<Mat3> {
    let bits = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
    // Vertices in the order of their first triangles.
    let mut vertices: Vec<(Vec3, u32, Vec3)> = Vec::new();
    let mut number: HashMap<[u32; 3], usize> = HashMap::new();
    for of in corners {
        for k in 0..3 {
            let next = of[(k + 1) % 3];
            let i = *number.entry(bits(of[k])).or_insert(vertices.len());
            if i == vertices.len() {
                vertices.push((of[k], 0, next));
            }
            vertices[i].1 += 1;
        }
    }
    // Opposite vertices are looked for in cells wider than the tolerance.
    let width = 4.0 * TOLERANCE as f32 * radius;
    let cell = |p: Vec3| ((p - centre) / width).floor().as_ivec3();
    let mut cells: HashMap<[i32; 3], Vec<usize>> = HashMap::new();
    for (i, (p, ..)) in vertices.iter().enumerate() {
        cells.entry(cell(*p).to_array()).or_default().push(i);
    }
    let is_opposed = |p: Vec3| {
        let opposite = 2.0 * centre - p;
        let at = cell(opposite);
        let near = (0..27).filter_map(|k| cells.get(&[at.x + k % 3 - 1, at.y + k / 3 % 3 - 1, at.z + k / 9 - 1]));
        near.flatten().any(|&i| (vertices[i].0 - opposite).length() <= 2.0 * TOLERANCE as f32 * radius)
    };
    let mut order: Vec<usize> = (0..vertices.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(vertices[i].1), i));
    let (pole, _, beside) = vertices[order.into_iter().find(|&i| is_opposed(vertices[i].0))?];
    let up = (pole - centre).normalize();
    let first = (beside - centre).reject_from_normalized(up).try_normalize()?;
    Some(Mat3::from_cols(first, up, first.cross(up)))
}

/// Places of a triangle's corners, given in directions of the axes.
fn places(corners: [Vec3; 3]) -> [Vec2; 3] {
    let latitude = corners.map(|d| d.y.clamp(-1.0, 1.0).asin() / PI + 0.5);
    let is_pole = corners.map(|d| d.x.hypot(d.z) < 1e-3);
    let mut turns = corners.map(|d| d.z.atan2(d.x).rem_euclid(TAU) / TAU);
    // All within half a turn of the first that is no pole.
    if let Some(k) = (0..3).find(|&k| !is_pole[k]) {
        let about = turns[k];
        turns = turns.map(|turn| about + (turn - about + 0.5).rem_euclid(1.0) - 0.5);
    }
    let sides: Vec<f32> = (0..3).filter(|&k| !is_pole[k]).map(|k| turns[k]).collect();
    let middle = sides.iter().sum::<f32>() / sides.len().max(1) as f32;
    (0..3).filter(|&k| is_pole[k]).for_each(|k| turns[k] = middle);
    // Rounding at the seam itself makes no turn.
    let low = turns.into_iter().fold(f32::MAX, f32::min);
    let shift = if low < -1e-4 {
        1.0
    } else if low >= 1.0 - 1e-4 {
        -1.0
    } else {
        0.0
    };
    std::array::from_fn(|k| Vec2::new((turns[k] + shift).max(0.0), latitude[k]))
}

/// The direction of a texel's centre in a texture of this size.
pub fn direction([x, y]: [i64; 2], size: [usize; 2]) -> Vec3 {
    let [longitude, latitude] = sphere::angles([x as f32 + 0.5, y as f32 + 0.5], size);
    sphere::towards(longitude, latitude)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::sphere::{LatLong, of_vertices, wrapped};
    use crate::radiosity::texture::Grid;
    use crate::scene::builtin;

    const FRONT: Sides = Sides { front: true, back: false };
    const CENTRE: Vec3 = Vec3::new(3.0, -2.0, 5.0);

    /// A sphere of 2n x n rings about an axis, in a scene of its own.
    fn rings(n: u32, axis: Vec3, radius: f32) -> Scene {
        let turn = glam::Quat::from_rotation_arc(Vec3::Y, axis.normalize());
        let point = |i: u32, j: u32| {
            let (theta, phi) = (PI * i as f32 / n as f32, PI * (j % (2 * n)) as f32 / n as f32);
            let p = if i == 0 {
                Vec3::Y
            } else if i == n {
                -Vec3::Y
            } else {
                Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())
            };
            CENTRE + radius * (turn * p)
        };
        let mut scene =
            Scene { objects: vec![String::from("o")], materials: vec![Material::default()], ..Scene::default() };
        for i in 0..n {
            for j in 0..2 * n {
                let [a, b, c, d] = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
                for of in [(i > 0).then_some([a, b, c]), (i + 1 < n).then_some([a, c, d])].into_iter().flatten() {
                    let first = scene.positions.len() as u32;
                    scene.positions.extend(of);
                    let vertices = [first, first + 1, first + 2];
                    scene.triangles.push(Triangle { vertices, material: 0, object: 0, smooth: true });
                }
            }
        }
        scene
    }

    fn icosphere() -> Scene {
        let mut scene = builtin::sphere_point_lights(1);
        scene.triangles.iter_mut().for_each(|t| t.smooth = true);
        scene.positions.iter_mut().for_each(|p| *p = CENTRE + 40.0 * *p);
        scene
    }

    fn found(scene: &Scene) -> Vec<Ball> {
        balls(scene, &vec![FRONT; scene.triangles.len()]).unwrap()
    }

    #[test]
    fn spheres_are_found_and_nothing_else() {
        for (scene, radius) in
            [(rings(12, Vec3::Y, 1e-3), 1e-3), (rings(16, Vec3::new(1.0, 2.0, -0.7), 70.0), 70.0), (icosphere(), 40.0)]
        {
            let all = found(&scene);
            let [ball] = &all[..] else { panic!("{}", all.len()) };
            assert_eq!(ball.triangles.len(), scene.triangles.len());
            assert!((ball.radius / radius - 1.0).abs() < 1e-3 && !ball.back);
            assert!(balls(&scene, &vec![Sides::default(); scene.triangles.len()]).unwrap().is_empty());
            let both = vec![Sides { front: true, back: true }; scene.triangles.len()];
            assert_eq!(balls(&scene, &both).unwrap().len(), 2, "both sides");
            // Flat, of two materials, with a hole, covered twice, stretched.
            let changed = |change: &dyn Fn(&mut Scene)| {
                let mut scene = scene.clone();
                change(&mut scene);
                found(&scene).len()
            };
            assert_eq!(changed(&|s| s.triangles.iter_mut().for_each(|t| t.smooth = false)), 0);
            assert_eq!(changed(&|s| s.triangles.iter_mut().skip(100).for_each(|t| t.material = 1)), 0);
            assert_eq!(changed(&|s| s.triangles.truncate(s.triangles.len() * 9 / 10)), 0);
            assert_eq!(changed(&|s| s.triangles.extend(s.triangles.clone())), 0);
            assert_eq!(changed(&|s| s.positions.iter_mut().for_each(|p| p.y *= 1.02)), 0);
            assert_eq!(changed(&|s| s.positions.iter_mut().for_each(|p| p.y *= 1.0001)), 1);
        }
        assert!(found(&rings(6, Vec3::Y, 1.0)).is_empty(), "a polyhedron");
        assert!(found(&Scene { triangles: Vec::new(), ..icosphere() }).is_empty());
    }

    #[test]
    fn directions_meet_the_sphere_where_they_point() {
        for scene in [rings(16, Vec3::new(-0.3, 1.0, 0.4), 2.0), icosphere()] {
            let ball = &found(&scene)[0];
            for i in 0..2000 {
                let d = direction([i % 50, i / 50], [50, 40]);
                let Texel { triangle, uv: [u, v], .. } = ball.texel(d);
                let [a, b, c] = scene.triangle_positions(triangle as usize);
                let towards = (a + u * (b - a) + v * (c - a) - ball.centre).normalize();
                assert!((towards - ball.axes * d).length() < 1e-3, "{d}");
            }
        }
    }

    /// Bilinear look-up at a place on a texture that goes on beyond its borders.
    fn look_up(grid: &Grid<f32>, at: Vec2) -> f32 {
        let p = at * Vec2::new(grid.size[0] as f32, grid.size[1] as f32) - 0.5;
        let (low, t) = (p.floor(), p - p.floor());
        let texel = |dx: isize, dy: isize| wrapped(grid, [low.x as isize + dx, low.y as isize + dy]);
        let row = |dy: isize| texel(0, dy) * (1.0 - t.x) + texel(1, dy) * t.x;
        row(0) * (1.0 - t.y) + row(1) * t.y
    }

    #[test]
    fn triangles_show_the_texture_without_steps_at_seam_and_poles() {
        // Changes by 0.2 in the width of a texel.
        let f = |d: Vec3| 2.0 + d.x + (2.0 * d.y + d.z).cos();
        for (scene, bound) in
            [(rings(16, Vec3::Y, 1.0), 0.03), (rings(16, Vec3::new(1.0, 0.2, 3.0), 1.0), 0.03), (icosphere(), 0.06)]
        {
            let ball = &found(&scene)[0];
            let n = 16.0;
            let map =
                LatLong::new(&of_vertices(4, |patch, at| Some(f(sphere::direction(patch, at.map(|c| c as f32 / n))))));
            // Values along each edge, of both triangles at it.
            let mut edges: HashMap<[u32; 3], f32> = HashMap::new();
            let mut compared = 0;
            for (triangle, places) in ball.faces() {
                assert!(places.iter().all(|p| p.x >= 0.0 && p.x < 1.2 && (0.0..=1.0).contains(&p.y)), "{places:?}");
                let corners = scene.triangle_positions(triangle as usize);
                for k in 0..3 {
                    for t in [0.25, 0.5, 0.75, 1.0] {
                        let [a, b] = [k, (k + 1) % 3];
                        let point = corners[a].lerp(corners[b], t);
                        let found = look_up(&map.grid, places[a].lerp(places[b], t));
                        let expected = f((ball.axes.transpose() * (point - ball.centre)).normalize());
                        assert!((found - expected).abs() < bound, "{found} for {expected} at {places:?}");
                        let key = ((point - ball.centre) / ball.radius * 4000.0).round().as_ivec3().to_array();
                        let other = *edges.entry(key.map(|n| n as u32)).or_insert(found);
                        compared += usize::from(other != found);
                        assert!((other - found).abs() < bound, "{other} {found} at {places:?}");
                    }
                }
            }
            assert!(compared > 20, "{compared}");
        }
    }

    #[test]
    fn places_go_on_beyond_the_seam() {
        let at = |turn: f32, latitude: f32| sphere::towards(TAU * turn, latitude);
        let x = |corners: [Vec3; 3]| places(corners).map(|p| (p.x * 1e4).round() / 1e4);
        assert_eq!(x([at(0.95, 0.0), at(0.05, 0.0), at(0.0, 0.3)]), [0.95, 1.05, 1.0]);
        assert_eq!(x([at(0.05, 0.0), at(0.95, 0.0), at(0.0, 0.3)]), [1.05, 0.95, 1.0]);
        assert_eq!(x([at(0.0, 0.0), at(0.1, 0.0), at(0.0, 0.3)]), [0.0, 0.1, 0.0]);
        assert_eq!(x([at(0.9, 0.0), at(0.0, 0.0), Vec3::Y]), [0.9, 1.0, 0.95]);
        assert_eq!(x([-Vec3::Y, at(0.3, -1.0), at(0.5, -1.0)]), [0.4, 0.3, 0.5]);
        assert_eq!(places([Vec3::Y, at(0.1, 0.0), -Vec3::Y]).map(|p| p.y), [1.0, 0.5, 0.0]);
    }
}
