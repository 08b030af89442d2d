//! Quadtree of the points of an image (Bastos 1999, section 6.6.4.1): nodes are split until their points lie in a narrow range of depths.
//!
//! The smallest nodes are tiles of [`TILE`] x [`TILE`] points, the work of one workgroup.

use glam::{DVec3, Vec3};

use super::Pose;

/// Side of the smallest nodes in points.
pub const TILE: u32 = 8;

/// Nodes are not split if their greatest depth is at most this multiple of the least: the sizes of their points then differ by as much.
pub const DEPTH_RANGE: f32 = 1.125;

/// Neighbours belong to one surface if the depth of one is at most this multiple of the other's.
const STEP_RANGE: f32 = 1.25;

/// A node with points.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its first point.
    pub corner: [u32; 2],
    /// Width and height, cut off at the image's end.
    pub size: [u32; 2],
    /// Lower and upper corner of the box around its points.
    pub bounds: (Vec3, Vec3),
    /// Mean of its points.
    pub centroid: Vec3,
    /// Steps from the centroid to the next point in its row and in its column, on the plane of its points.
    pub steps: [Vec3; 2],
    /// Its children, as their places in the tree; none: it is a leaf.
    pub children: Vec<usize>,
}

/// The nodes; the last one is the root. Empty without points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quadtree(pub Vec<Node>);

impl Quadtree {
    /// For the points of an image, row by row.
    pub fn new(pose: &Pose, size: [u32; 2], points: &[[f32; 4]]) -> Quadtree {
        let side = size[0].max(size[1]).next_power_of_two().max(TILE);
        let mut tree = Quadtree::default();
        tree.grow(pose, size, points, [0, 0], side);
        tree
    }

    /// Adds the node of this corner and side after its children; returns its place, `None` without points.
    fn grow(&mut self, pose: &Pose, size: [u32; 2], points: &[[f32; 4]], corner: [u32; 2], side: u32) -> Option<usize> {
        let end = [0, 1].map(|axis| (corner[axis] + side).min(size[axis]));
        if corner[0] >= end[0] || corner[1] >= end[1] {
            return None;
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (mut sum, mut depths, mut count) = (DVec3::ZERO, 0.0, 0.0);
        // Mean slopes of 1 / depth, which is affine in (x, y) on a plane, along both axes.
        let mut slopes = [(0.0, 0.0_f64); 2];
        let depth_of = |x: u32, y: u32| points[(x + y * size[0]) as usize][3].abs();
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0_f32);
        for y in corner[1]..end[1] {
            for x in corner[0]..end[0] {
                let depth = depth_of(x, y);
                if depth > 0.0 {
                    let p = pose.point(x, y, depth);
                    (low, high) = (low.min(p), high.max(p));
                    (nearest, farthest) = (nearest.min(depth), farthest.max(depth));
                    sum += p.as_dvec3();
                    depths += f64::from(depth);
                    count += 1.0;
                    for ((sum, count), [x, y]) in slopes.iter_mut().zip([[x + 1, y], [x, y + 1]]) {
                        let next = if x < end[0] && y < end[1] { depth_of(x, y) } else { 0.0 };
                        if next.max(depth) <= STEP_RANGE * next.min(depth) {
                            *sum += 1.0 / f64::from(next) - 1.0 / f64::from(depth);
                            *count += 1.0;
                        }
                    }
                }
            }
        }
        if count == 0.0 {
            return None;
        }
        let mut children = Vec::new();
        if side > TILE && farthest > DEPTH_RANGE * nearest {
            let half = side / 2;
            for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                children.extend(self.grow(pose, size, points, [corner[0] + dx, corner[1] + dy], half));
            }
        }
        let size = [0, 1].map(|axis| end[axis] - corner[axis]);
        // The derivative of cop + depth ray(x, y).
        let (centroid, depth) = (sum / count, depths / count);
        let from_cop = centroid - pose.cop.as_dvec3();
        let step = |(slope, pairs): (f64, f64), edge: Vec3| {
            (depth * edge.as_dvec3() - depth * slope / pairs.max(1.0) * from_cop).as_vec3()
        };
        let steps = [step(slopes[0], pose.du), step(slopes[1], pose.dv)];
        self.0.push(Node { corner, size, bounds: (low, high), centroid: centroid.as_vec3(), steps, children });
        Some(self.0.len() - 1)
    }

    /// Calls `leaf` for each leaf below nodes that `sees` holds for.
    pub fn visit<'a>(&'a self, sees: impl Fn(&Node) -> bool, mut leaf: impl FnMut(&'a Node)) {
        let mut waiting: Vec<usize> = self.0.len().checked_sub(1).into_iter().collect();
        while let Some(i) = waiting.pop() {
            let node = &self.0[i];
            if !sees(node) {
                continue;
            }
            if node.children.is_empty() {
                leaf(node);
            }
            waiting.extend(node.children.iter().rev());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> Pose {
        Pose { cop: Vec3::ZERO, base: Vec3::new(-1.0, -1.0, 1.0), du: Vec3::X / 20.0, dv: Vec3::Y / 10.0 }
    }

    #[test]
    fn steps_lie_in_the_surface() {
        // A plane that recedes along x; the next points of its rows are farther away.
        let depth = |x: f32| 1.0 / (1.0 - (x + 0.5) / 40.0);
        let points: Vec<[f32; 4]> = (0..64).map(|i| [0.0, 0.0, 0.0, depth((i % 8) as f32)]).collect();
        let tree = Quadtree::new(&pose(), [8, 8], &points);
        let [across, down] = tree.0[0].steps;
        // The middle of the row, in which the steps are those of the mean.
        let ends = [3, 4].map(|x| pose().point(x, 3, depth(x as f32)));
        let exact = ends[1] - ends[0];
        let normal = (pose().point(7, 0, depth(7.0)) - pose().point(0, 0, depth(0.0))).cross(Vec3::Y).normalize();
        assert!(across.dot(normal).abs() < 0.02 * across.length(), "{across} lies in the plane");
        assert!((across.length() / exact.length() - 1.0).abs() < 0.05, "{across} {exact}");
        assert!(down.x.abs() < 1e-5 && down.z.abs() < 1e-5 && down.y > 0.1, "{down}");
        // A lone point has the steps of a plane parallel to the mirror.
        let lone: Vec<[f32; 4]> = (0..64).map(|i| [0.0, 0.0, 0.0, if i == 9 { 2.0 } else { 0.0 }]).collect();
        for (step, edge) in Quadtree::new(&pose(), [8, 8], &lone).0[0].steps.iter().zip([pose().du, pose().dv]) {
            assert!((*step - 2.0 * edge).length() < 1e-6);
        }
    }

    fn leaves(tree: &Quadtree) -> Vec<&Node> {
        let mut found = Vec::new();
        tree.visit(|_| true, |node| found.push(node));
        found
    }

    #[test]
    fn leaves_hold_each_point_once_and_a_narrow_range_of_depths() {
        let size = [37, 21];
        // A step in depth, and a region without points.
        let depth = |x: u32, y: u32| {
            if y > 17 {
                0.0
            } else if x < 10 {
                2.0
            } else {
                -5.0
            }
        };
        let points: Vec<[f32; 4]> =
            (0..size[0] * size[1]).map(|i| [0.0, 0.0, 0.0, depth(i % size[0], i / size[0])]).collect();
        let tree = Quadtree::new(&pose(), size, &points);
        let mut seen = vec![0; points.len()];
        for node in leaves(&tree) {
            let mut range = (f32::INFINITY, 0.0_f32);
            for y in node.corner[1]..node.corner[1] + node.size[1] {
                for x in node.corner[0]..node.corner[0] + node.size[0] {
                    seen[(x + y * size[0]) as usize] += 1;
                    let depth = depth(x, y).abs();
                    if depth > 0.0 {
                        range = (range.0.min(depth), range.1.max(depth));
                        let p = pose().point(x, y, depth);
                        assert!(p.cmpge(node.bounds.0).all() && p.cmple(node.bounds.1).all());
                    }
                }
            }
            assert!(range.1 <= DEPTH_RANGE * range.0 || node.size[0].max(node.size[1]) <= TILE, "{node:?}");
            assert_eq!(node.corner.map(|c| c % TILE), [0, 0]);
        }
        for (i, &seen) in seen.iter().enumerate() {
            let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
            assert!(seen == 1 || (seen == 0 && depth(x, y) == 0.0), "{x} {y}: {seen}");
        }
        // Beyond the step the depths are alike, and larger nodes suffice.
        assert!(leaves(&tree).iter().any(|node| node.size[0] > TILE));
    }

    #[test]
    fn an_image_of_a_plane_is_one_node_and_an_empty_one_has_none() {
        let tree = Quadtree::new(&pose(), [16, 16], &[[1.0, 1.0, 1.0, 3.0]; 256]);
        assert_eq!(tree.0.len(), 1);
        let center = pose().cop + 3.0 * (pose().base + 8.0 * pose().du + 8.0 * pose().dv);
        assert!((tree.0[0].centroid - center).length() < 1e-5);
        for (step, edge) in tree.0[0].steps.iter().zip([pose().du, pose().dv]) {
            assert!((*step - 3.0 * edge).length() < 1e-5, "{step}");
        }
        assert_eq!(Quadtree::new(&pose(), [16, 16], &[[0.0; 4]; 256]), Quadtree::default());
        let mut sees_none = true;
        tree.visit(|_| false, |_| sees_none = false);
        assert!(sees_none);
    }
}
