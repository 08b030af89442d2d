//! Bounding volume hierarchy: built by obvhs, flattened to a threaded array that CPU and GPU traverse in the same way.
//!
//! The binary tree is laid out depth first, and each node stores the next node after its subtree (its
//! *skip*), so traversal needs no stack: the state of a ray is a single increasing index, and a ray can be interrupted and
//! resumed. The price is a fixed order of children; the one with the larger surface comes first, because a random
//! ray is more likely to end there. It matters little: compared with the other order, shadow rays visited between 5 % fewer and
//! 6 % more nodes on four scenes, fewer on three of them.
//!
//! Node `i` is `node_min[i]`, `node_max[i]`:
//!
//! | field             | meaning |
//! |-------------------|---------|
//! | `node_min[i].xyz` | lower corner of the box, padded by [`BOX_PADDING`] |
//! | `node_min[i].w`   | bits of a `u32`: skip, the index of the next node when this subtree is missed or done; `i < skip <= node count` |
//! | `node_max[i].xyz` | upper corner of the box, padded likewise |
//! | `node_max[i].w`   | bits of a `u32`: 0 for an inner node (its first child is `i + 1`), else `first << 3 \| count`: a leaf of `count` triangles (1..=4) from triangle `first` |
//!
//! Triangle `k`, in the order of the leaves, is `v0[k]`, `e1[k]`, `e2[k]`:
//!
//! | field       | meaning |
//! |-------------|---------|
//! | `v0[k].xyz` | first vertex |
//! | `v0[k].w`   | bits of a `u32`: index of the material |
//! | `e1[k].xyz` | second vertex minus first |
//! | `e1[k].w`   | bits of a `u32`: index of the triangle in the scene |
//! | `e2[k].xyz` | third vertex minus first |
//! | `e2[k].w`   | 0 |
//!
//! One array for each vec4, because a single storage binding is limited to 128 MiB on the smallest devices.
//!
//! Every expression is plain f32 arithmetic in the order written, without contraction, so that a kernel that writes the
//! same expressions gets the same numbers.

pub mod alpha;
mod build;
pub mod objects;
pub mod wide;

use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::scene::validate::is_degenerate;
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocSearchDistance;

/// Maximum number of triangles in a leaf.
pub const MAX_LEAF: u32 = 4;

/// Tolerance of barycentric coordinates, so that triangles overlap along shared edges and do not crack.
///
/// Of rays aimed exactly at edges 1 in 10 slips through with slack 0, 1 in 2000 with 1e-6, 1 in 250,000 with 1e-5
/// (slim triangles near the poles of a sphere: the rounding grows as they get slimmer).
pub const BARYCENTRIC_SLACK: f32 = 1e-5;

/// Widens the far end of a slab interval by more than the rounding of its three operations (Ize 2013), with a margin for
/// devices whose division has an error of 2.5 ulp.
pub const SLAB_SLACK: f32 = 1.000_001;

/// Padding of boxes on every side as a fraction of the scene's largest coordinate, a few ulp. A ray exactly in the face of a
/// box is then inside it, and triangles stay within their boxes despite the rounding of their own test.
pub const BOX_PADDING: f32 = 1.0 / 4_194_304.0;

/// Maximum padding as a fraction of the box's diagonal, so that one distant vertex does not blow up all boxes; but never
/// less than [`BOX_PADDING`] of the box's own largest coordinate.
const MAX_PADDING: f32 = 1.0 / 16.0;

/// A box padded on every side by `padding`, within the limits of [`MAX_PADDING`].
fn padded(lower: Vec3, upper: Vec3, padding: f32) -> (Vec3, Vec3) {
    let own = lower.abs().max(upper.abs()).max_element() * BOX_PADDING;
    let padding = Vec3::splat(padding.min((upper - lower).length() * MAX_PADDING).max(own));
    (lower - padding, upper + padding)
}

/// Minimum magnitude of a direction's components; smaller ones are replaced by it with their sign. Their inverse then stays
/// finite, and a finite number times the distance to a slab is never NaN, even with the origin in the slab's plane.
pub const TINY_DIRECTION: f32 = 1e-30;

/// A ray segment: the points `origin + t * direction` with `0 < t < t_max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, not part of the segment.
    pub origin: Vec3,
    /// End of the parameter, not part of the segment; infinite for a ray.
    pub t_max: f32,
    /// Direction; need not be of unit length.
    pub direction: Vec3,
}

impl Ray {
    /// The ray from `origin` to infinity.
    pub fn new(origin: Vec3, direction: Vec3) -> Ray {
        Ray { origin, t_max: f32::INFINITY, direction }
    }

    /// The open segment between two points; `t` runs from 0 to 1.
    pub fn between(from: Vec3, to: Vec3) -> Ray {
        Ray { origin: from, t_max: 1.0, direction: to - from }
    }
}

/// Intersection of a ray and a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Parameter along the ray.
    pub t: f32,
    /// Barycentric coordinate of the second vertex.
    pub u: f32,
    /// Barycentric coordinate of the third vertex.
    pub v: f32,
    /// Triangle in the order of the leaves.
    pub triangle: u32,
}

/// Cost of a traversal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Steps {
    /// Nodes whose box was tested.
    pub nodes: u32,
    /// Triangles tested.
    pub triangles: u32,
}

/// The hierarchy; see the module's documentation for the arrays.
#[derive(Clone, Debug, PartialEq)]
pub struct Bvh {
    /// Lower corners and skips.
    pub node_min: Vec<[f32; 4]>,
    /// Upper corners and leaves.
    pub node_max: Vec<[f32; 4]>,
    /// First vertices and materials.
    pub v0: Vec<[f32; 4]>,
    /// First edges and indices of the triangles in the scene.
    pub e1: Vec<[f32; 4]>,
    /// Second edges.
    pub e2: Vec<[f32; 4]>,
    /// Lower corner of the scene.
    pub min: Vec3,
    /// Upper corner of the scene.
    pub max: Vec3,
}

fn xyz(a: &[f32; 4]) -> Vec3 {
    Vec3::new(a[0], a[1], a[2])
}

fn with_bits(a: Vec3, w: u32) -> [f32; 4] {
    [a.x, a.y, a.z, f32::from_bits(w)]
}

/// A triangle of a scene in the form of the three arrays. One that has lost its area has edges of length 0: its determinant is then
/// exactly 0 for any ray, so that none hits it and meets its undefined normal.
fn triangle_record(scene: &Scene, index: u32) -> [[f32; 4]; 3] {
    let triangle = &scene.triangles[index as usize];
    let [a, b, c] = triangle.vertices.map(|v| scene.positions[v as usize]);
    let [b, c] = if is_degenerate([a, b, c]) { [a; 2] } else { [b, c] };
    [with_bits(a, triangle.material), with_bits(b - a, index), with_bits(c - a, 0)]
}

/// The binary tree over some boxes, which hold `count` triangles. It does not depend on the number of threads.
fn binary_tree(boxes: &[Aabb], count: usize) -> Bvh2 {
    // On 415,000 triangles (white-room) the first costs a surface-area heuristic as low as that of twice the search and three
    // times the reinsertions, which take three times as long; with the second it is 1 % higher, and saves half of the time.
    let ratio = if count <= 1 << 20 { 0.15 } else { 0.05 };
    // As a task of the thread pool: a loop that is begun outside of it waits for a thread to wake, and there are dozens.
    rayon::scope(|_| {
        let (mut tree, clustered) = build::tree(boxes, PlocSearchDistance::Medium);
        let mut reinsertion = ReinsertionOptimizer::default();
        if clustered {
            reinsertion.run(&mut tree, ratio, None);
        }
        collapse(&mut tree, MAX_LEAF, 3.0);
        if clustered {
            reinsertion.run(&mut tree, ratio, None);
        }
        tree
    })
}

impl Bvh {
    /// Builds the hierarchy over all triangles of a scene. The same scene gives the same arrays.
    pub fn build(scene: &Scene) -> Result<Bvh> {
        let count = scene.triangles.len();
        if count == 0 {
            return Err(Error::Scene(String::from(
                "there is no triangle to build a hierarchy over; check the model file",
            )));
        }
        // A leaf keeps 29 bits for its first triangle.
        if count > 1 << 28 {
            return Err(Error::Scene(format!("{count} triangles exceed the limit of {}; simplify the model", 1 << 28)));
        }
        let all: Vec<u32> = (0..count as u32).collect();
        Ok(Self::over(scene, &all, |scale| scale * BOX_PADDING))
    }

    /// Builds the hierarchy over some triangles of a scene, at least one and at most 2^28. `padding` of the boxes from the
    /// largest coordinate of these triangles.
    fn over(scene: &Scene, triangles: &[u32], padding: impl Fn(f32) -> f32) -> Bvh {
        let count = triangles.len();
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|&t| scene.triangles[t as usize].vertices)
            .map(|vertices| Aabb::from_points(&vertices.map(|v| Vec3A::from(scene.positions[v as usize]))))
            .collect();
        // The builder takes quadratic time for many equal boxes, so each group of them enters once.
        let (order, starts) = group_equal(&boxes);
        let unique: Vec<Aabb> = starts[..starts.len() - 1].iter().map(|&s| boxes[order[s] as usize]).collect();
        let tree = binary_tree(&unique, count);

        let mut bvh = Bvh {
            node_min: Vec::with_capacity(tree.nodes.len()),
            node_max: Vec::with_capacity(tree.nodes.len()),
            v0: Vec::with_capacity(count),
            e1: Vec::with_capacity(count),
            e2: Vec::with_capacity(count),
            min: tree.nodes[0].aabb().min.into(),
            max: tree.nodes[0].aabb().max.into(),
        };
        let padding = padding(bvh.scale());
        enum Visit {
            Node(u32),
            Triangles(Vec<u32>, Aabb),
            Leave(usize),
        }
        let mut stack = vec![Visit::Node(0)];
        while let Some(visit) = stack.pop() {
            let own = bvh.node_min.len();
            let (bounds, members) = match visit {
                Visit::Leave(index) => {
                    bvh.node_min[index][3] = f32::from_bits(own as u32);
                    continue;
                }
                Visit::Triangles(members, bounds) => (bounds, members),
                Visit::Node(index) => {
                    let node = &tree.nodes[index as usize];
                    let mut members = Vec::new();
                    if node.is_leaf() {
                        let first = node.first_index as usize;
                        for &group in &tree.primitive_indices[first..first + node.prim_count as usize] {
                            let group = group as usize;
                            members.extend_from_slice(&order[starts[group]..starts[group + 1]]);
                        }
                    } else {
                        let (mut first, mut second) = (node.first_index, node.first_index + 1);
                        let area = |n: u32| tree.nodes[n as usize].aabb().half_area();
                        if area(second) > area(first) {
                            std::mem::swap(&mut first, &mut second);
                        }
                        stack.extend([Visit::Leave(own), Visit::Node(second), Visit::Node(first)]);
                    }
                    (*node.aabb(), members)
                }
            };
            let mut leaf = 0;
            if members.len() > MAX_LEAF as usize {
                // Equal boxes: any two halves are equivalent.
                let (a, b) = members.split_at(members.len() / 2);
                let half = |t: &[u32]| Visit::Triangles(t.to_vec(), bounds);
                stack.extend([Visit::Leave(own), half(b), half(a)]);
            } else if !members.is_empty() {
                leaf = (bvh.v0.len() as u32) << 3 | members.len() as u32;
                stack.push(Visit::Leave(own));
            }
            let (lower, upper) = padded(bounds.min.into(), bounds.max.into(), padding);
            bvh.node_min.push(with_bits(lower, 0));
            bvh.node_max.push(with_bits(upper, leaf));
            if leaf != 0 {
                for member in members {
                    let [v0, e1, e2] = triangle_record(scene, triangles[member as usize]);
                    bvh.v0.push(v0);
                    bvh.e1.push(e1);
                    bvh.e2.push(e2);
                }
            }
        }
        // The boxes of inner nodes hold those of their children, which come after them.
        for i in (0..bvh.node_min.len()).rev() {
            if bvh.node_max[i][3].to_bits() != 0 {
                continue;
            }
            let (a, b) = (i + 1, bvh.node_min[i + 1][3].to_bits() as usize);
            let lower = xyz(&bvh.node_min[a]).min(xyz(&bvh.node_min[b]));
            let upper = xyz(&bvh.node_max[a]).max(xyz(&bvh.node_max[b]));
            bvh.node_min[i][..3].copy_from_slice(&lower.to_array());
            bvh.node_max[i][..3].copy_from_slice(&upper.to_array());
        }
        bvh
    }

    /// Number of nodes.
    pub fn node_count(&self) -> u32 {
        self.node_min.len() as u32
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> u32 {
        self.v0.len() as u32
    }

    /// Largest absolute coordinate: the rounding of boxes scales with it.
    pub fn scale(&self) -> f32 {
        self.min.abs().max(self.max.abs()).max_element()
    }

    /// Largest absolute coordinate of the median triangle: the scale of positions that no view shows, for
    /// [`offset_origin`].
    pub fn typical_scale(&self) -> f32 {
        let mut scales: Vec<f32> = self.v0.iter().map(|v0| xyz(v0).abs().max_element()).collect();
        let middle = scales.len() / 2;
        *scales.select_nth_unstable_by(middle, f32::total_cmp).1
    }

    /// Length of the bounding box's diagonal.
    pub fn diagonal(&self) -> f32 {
        (self.max - self.min).length()
    }

    /// Index in the scene of a triangle in the order of the leaves.
    pub fn scene_triangle(&self, triangle: u32) -> u32 {
        self.e1[triangle as usize][3].to_bits()
    }

    /// For each triangle of the scene its number in the order of the leaves.
    pub fn leaf_numbers(&self) -> Vec<u32> {
        let mut numbers = vec![0; self.triangle_count() as usize];
        (0..self.triangle_count()).for_each(|leaf| numbers[self.scene_triangle(leaf) as usize] = leaf);
        numbers
    }

    /// Material of a triangle in the order of the leaves.
    pub fn material(&self, triangle: u32) -> u32 {
        self.v0[triangle as usize][3].to_bits()
    }

    /// Unit normal of the front side of a triangle in the order of the leaves.
    pub fn normal(&self, triangle: u32) -> Vec3 {
        unit_normal(xyz(&self.e1[triangle as usize]), xyz(&self.e2[triangle as usize]))
    }

    /// Point of a hit from its barycentric coordinates: more exact than `origin + t * direction`.
    pub fn position(&self, hit: &Hit) -> Vec3 {
        let k = hit.triangle as usize;
        xyz(&self.v0[k]) + xyz(&self.e1[k]) * hit.u + xyz(&self.e2[k]) * hit.v
    }

    /// The nearest hit; of several at the same distance the first in the order of the leaves.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.closest_counted(ray, &mut Steps::default())
    }

    /// [`Bvh::closest`], adding its cost to `steps`.
    pub fn closest_counted(&self, ray: &Ray, steps: &mut Steps) -> Option<Hit> {
        self.nearest(ray, steps, |_| true)
    }

    /// The nearest hit that is accepted, adding the cost to `steps`.
    fn nearest(&self, ray: &Ray, steps: &mut Steps, mut accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        let mut ray = *ray;
        let mut nearest = None;
        self.traverse(&ray.clone(), steps, |t_max, k| {
            ray.t_max = *t_max;
            if let Some(hit) = self.intersect(&ray, k).filter(&mut accept) {
                *t_max = hit.t;
                nearest = Some(hit);
            }
            false
        });
        nearest
    }

    /// Whether anything lies on the open segment.
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.occluded_counted(ray, &mut Steps::default())
    }

    /// [`Bvh::occluded`], adding its cost to `steps`.
    pub fn occluded_counted(&self, ray: &Ray, steps: &mut Steps) -> bool {
        self.traverse(ray, steps, |_, k| self.intersect(ray, k).is_some())
    }

    /// Visits the triangles of the leaves that a ray meets, until `visit` returns true. `visit` may shorten the ray.
    fn traverse(&self, ray: &Ray, steps: &mut Steps, mut visit: impl FnMut(&mut f32, u32) -> bool) -> bool {
        let inverse = inverse_direction(ray.direction);
        let count = self.node_count();
        let mut t_max = ray.t_max;
        let mut node = 0;
        while node < count {
            steps.nodes += 1;
            let (lower, upper) = (&self.node_min[node as usize], &self.node_max[node as usize]);
            let leaf = upper[3].to_bits();
            if !meets_box(ray.origin, inverse, t_max, xyz(lower), xyz(upper)) {
                node = lower[3].to_bits();
                continue;
            }
            let first = leaf >> 3;
            for k in first..first + (leaf & 7) {
                steps.triangles += 1;
                if visit(&mut t_max, k) {
                    return true;
                }
            }
            // After a leaf its skip is the next node as well, so hit nodes need no distinction.
            node += 1;
        }
        false
    }

    /// Moeller and Trumbore 1997, both sides. A determinant of exactly 0 (ray in the triangle's plane) misses.
    pub fn intersect(&self, ray: &Ray, triangle: u32) -> Option<Hit> {
        let k = triangle as usize;
        let (v0, e1, e2) = (xyz(&self.v0[k]), xyz(&self.e1[k]), xyz(&self.e2[k]));
        let p = ray.direction.cross(e2);
        let determinant = e1.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let s = ray.origin - v0;
        let u = s.dot(p) * inverse;
        let q = s.cross(e1);
        let v = ray.direction.dot(q) * inverse;
        let t = e2.dot(q) * inverse;
        let inside = u >= -BARYCENTRIC_SLACK && v >= -BARYCENTRIC_SLACK && u + v <= 1.0 + BARYCENTRIC_SLACK;
        (inside && t > 0.0 && t < ray.t_max).then_some(Hit { t, u, v, triangle })
    }

    /// Checks the whole structure against the scene: every triangle once, boxes that contain their children and
    /// triangles, skips that close exactly the subtrees.
    pub fn validate(&self, scene: &Scene) -> Result<()> {
        let wrong = |message: String| Err(Error::Scene(format!("hierarchy is inconsistent: {message}")));
        let (nodes, triangles) = (self.node_min.len(), self.v0.len());
        if self.node_max.len() != nodes || self.e1.len() != triangles || self.e2.len() != triangles {
            return wrong(String::from("arrays differ in length"));
        }
        if triangles != scene.triangles.len() {
            return wrong(format!("{triangles} triangles for the scene's {}", scene.triangles.len()));
        }
        let mut seen = vec![false; triangles];
        let mut in_leaf = vec![false; triangles];
        // The inner nodes around the current one, with the number of children visited so far.
        let mut open: Vec<(usize, u32)> = Vec::new();
        for i in 0..nodes {
            let (lower, upper) = (xyz(&self.node_min[i]), xyz(&self.node_max[i]));
            let skip = self.node_min[i][3].to_bits() as usize;
            let leaf = self.node_max[i][3].to_bits();
            while let Some(&(parent, children)) = open.last() {
                if self.node_min[parent][3].to_bits() as usize > i {
                    break;
                }
                if children != 2 || self.node_min[parent][3].to_bits() as usize != i {
                    return wrong(format!("skip of node {parent} does not close its subtree"));
                }
                open.pop();
            }
            if let Some((parent, children)) = open.last_mut() {
                *children += 1;
                let (a, b) = (xyz(&self.node_min[*parent]), xyz(&self.node_max[*parent]));
                if lower.cmplt(a).any() || upper.cmpgt(b).any() {
                    return wrong(format!("node {i} sticks out of its parent {parent}"));
                }
            } else if i != 0 {
                return wrong(format!("node {i} has no parent"));
            }
            if leaf == 0 {
                open.push((i, 0));
                continue;
            }
            let (first, count) = (leaf >> 3, leaf & 7);
            if skip != i + 1 || count == 0 || count > MAX_LEAF {
                return wrong(format!("leaf {i}: skip {skip}, first {first}, count {count}"));
            }
            if (first + count) as usize > triangles {
                return wrong(format!("leaf {i} ends beyond the last triangle"));
            }
            for k in first..first + count {
                if std::mem::replace(&mut in_leaf[k as usize], true) {
                    return wrong(format!("place {k} lies in two leaves"));
                }
                let index = self.scene_triangle(k) as usize;
                if index >= triangles || std::mem::replace(&mut seen[index], true) {
                    return wrong(format!("triangle {index} is out of range or referred to twice"));
                }
                let source = &scene.triangles[index];
                let corners = source.vertices.map(|v| scene.positions[v as usize]);
                if corners.iter().any(|c| c.cmplt(lower).any() || c.cmpgt(upper).any()) {
                    return wrong(format!("triangle {index} sticks out of leaf {i}"));
                }
                let k = k as usize;
                let record = triangle_record(scene, index as u32);
                if [self.v0[k], self.e1[k], self.e2[k]].iter().zip(&record).any(|(own, new)| xyz(own) != xyz(new)) {
                    return wrong(format!("triangle {index} has other vertices"));
                }
                if self.v0[k][3].to_bits() != source.material {
                    return wrong(format!("triangle {index} has another material"));
                }
            }
        }
        let closed = open.iter().all(|&(p, children)| children == 2 && self.node_min[p][3].to_bits() as usize == nodes);
        if !closed || in_leaf.contains(&false) {
            return wrong(String::from("the tree ends early"));
        }
        Ok(())
    }
}

/// Indices of the boxes in an order that keeps equal ones together, and the start of each group in it, followed by the end.
/// Only large numbers of equal boxes form a group; every other box is its own.
fn group_equal(boxes: &[Aabb]) -> (Vec<u32>, Vec<usize>) {
    const MANY: usize = 64;
    let bits = |i: u32| {
        let b = &boxes[i as usize];
        [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z].map(f32::to_bits)
    };
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    order.sort_unstable_by_key(|&i| (bits(i), i));
    let mut starts = Vec::with_capacity(boxes.len() + 1);
    let mut start = 0;
    for equal in order.chunk_by(|&a, &b| bits(a) == bits(b)) {
        let step = if equal.len() > MANY { equal.len() } else { 1 };
        starts.extend((start..start + equal.len()).step_by(step));
        start += equal.len();
    }
    starts.push(start);
    (order, starts)
}

/// Unit normal from two edges. The edges are scaled first, so that neither tiny nor huge triangles lose their normal.
pub fn unit_normal(e1: Vec3, e2: Vec3) -> Vec3 {
    let largest = |e: Vec3| e.abs().max_element();
    (e1 / largest(e1)).cross(e2 / largest(e2)).normalize()
}

/// 1 / direction with components near 0 replaced, see [`TINY_DIRECTION`].
pub fn inverse_direction(d: Vec3) -> Vec3 {
    let safe = |x: f32| if x.abs() < TINY_DIRECTION { TINY_DIRECTION.copysign(x) } else { x };
    Vec3::new(1.0 / safe(d.x), 1.0 / safe(d.y), 1.0 / safe(d.z))
}

/// Conservative slab test of the segment (0, t_max) against a box: may hit a few ulp outside, never misses inside.
pub fn meets_box(origin: Vec3, inverse: Vec3, t_max: f32, lower: Vec3, upper: Vec3) -> bool {
    let a = (lower - origin) * inverse;
    let b = (upper - origin) * inverse;
    let (near, far) = (a.min(b), a.max(b));
    let t_near = near.x.max(near.y).max(near.z).max(0.0);
    let t_far = (far.x.min(far.y).min(far.z) * SLAB_SLACK).min(t_max);
    t_near <= t_far
}

/// Offsets a point on a surface to the side of the unit normal `n`, far enough that a ray from it does not meet the
/// surface again (Waechter and Binder 2019): by 256 ulp of each coordinate, and near 0, where ulps vanish but the
/// rounding of the other coordinates does not, by a fixed fraction of the largest coordinate: that of the point or
/// `scale`, whichever is larger. `scale`: see [`crate::extent::Extent::scale`].
///
/// Differs from the publication in that both constants for small coordinates are multiplied by that coordinate.
pub fn offset_origin(p: Vec3, n: Vec3, scale: f32) -> Vec3 {
    let scale = scale.max(p.abs().max_element());
    let component = |p: f32, n: f32| {
        if p.abs() < scale * (1.0 / 32.0) {
            return p + n * (scale * (1.0 / 65536.0));
        }
        let ulps = (256.0 * n) as i32;
        let bits = p.to_bits() as i32;
        f32::from_bits((bits + if p < 0.0 { -ulps } else { ulps }) as u32)
    };
    Vec3::new(component(p.x, n.x), component(p.y, n.y), component(p.z, n.z))
}

#[cfg(test)]
mod tests;
