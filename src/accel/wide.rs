//! The hierarchy eight wide, for kernels in which a subgroup walks the tree for a cluster of rays together.
//!
//! It is collapsed from the binary one and shares its triangles: a subtree's triangles lie one after the other, so any subtree of
//! at most [`MAX_LEAF`] triangles can be a leaf. A node is a block of eight children, sixteen vec4:
//!
//! | field               | meaning |
//! |---------------------|---------|
//! | `nodes[16 n + 2 k].xyz`     | lower corner of child k; +huge if there is none |
//! | `nodes[16 n + 2 k].w`       | bits of a `u32`: the child's node, or the first triangle of a leaf |
//! | `nodes[16 n + 2 k + 1].xyz` | upper corner; -huge if there is no child |
//! | `nodes[16 n + 2 k + 1].w`   | bits of a `u32`: 0 for an inner child, else the leaf's number of triangles (1..=8) |
//!
//! Inner children come first, in nodes one after the other; empty children come last. The root is node 0, also where the whole scene is one leaf.
//!
//! Which subtrees become children is chosen by dynamic programming over the binary tree (as Ylitie et al. 2017 do for their compressed
//! nodes), for a cost in which a leaf counts once however many triangles it has: a subgroup tests them together.

use super::Bvh;

/// Greatest number of triangles in a leaf.
pub const MAX_LEAF: u32 = 8;
/// Children of a node.
pub const WIDTH: usize = 8;

/// Cost of a leaf against that of a node, for one visit.
const LEAF_COST: f32 = 1.2;
/// Corner of the box of a child that is not there: no ray meets a box whose lower corner is above its upper one.
const HUGE: f32 = 3.0e38;

/// The eight-wide hierarchy.
#[derive(Clone, Debug, PartialEq)]
pub struct WideBvh {
    /// Sixteen vec4 a node.
    pub nodes: Vec<[f32; 4]>,
    /// Nodes on the longest path from the root.
    pub depth: u32,
}

/// A binary node as the collapse sees it.
struct Subtree {
    first: u32,
    triangles: u32,
    area: f32,
    /// For k in 1..=8: least cost of representing this subtree by at most k children of a wide node above it.
    cost: [f32; WIDTH],
    /// For k in 2..=8: how many of them go to the left child; 0: no more than k - 1 are used. For k = 1: how many of its own
    /// eight children, as a wide node.
    left: [u8; WIDTH],
    /// As a single child: it is a leaf.
    leaf: bool,
}

impl WideBvh {
    /// Collapses the binary hierarchy.
    pub fn build(bvh: &Bvh) -> WideBvh {
        let subtrees = Self::costs(bvh);
        let mut wide = WideBvh { nodes: Vec::new(), depth: 0 };
        // Nodes to be written: binary node, place in `nodes`, depth.
        let mut queue = std::collections::VecDeque::from([(0u32, 0u32, 1u32)]);
        wide.push_empty();
        while let Some((node, place, depth)) = queue.pop_front() {
            wide.depth = wide.depth.max(depth);
            let mut children = Vec::with_capacity(WIDTH);
            if subtrees[node as usize].leaf {
                children.push(node);
            } else {
                Self::distribute(bvh, &subtrees, node, WIDTH, true, &mut children);
            }
            // Stable: otherwise children keep the order of the binary tree.
            children.sort_by_key(|&child| subtrees[child as usize].leaf);
            for (k, &child) in children.iter().enumerate() {
                let s = &subtrees[child as usize];
                let (lower, upper) = (bvh.node_min[child as usize], bvh.node_max[child as usize]);
                let (index, count) = if s.leaf {
                    (s.first, s.triangles)
                } else {
                    let index = (wide.nodes.len() / (2 * WIDTH)) as u32;
                    wide.push_empty();
                    queue.push_back((child, index, depth + 1));
                    (index, 0)
                };
                let at = place as usize * 2 * WIDTH + 2 * k;
                wide.nodes[at] = [lower[0], lower[1], lower[2], f32::from_bits(index)];
                wide.nodes[at + 1] = [upper[0], upper[1], upper[2], f32::from_bits(count)];
            }
        }
        wide
    }

    /// Number of nodes.
    pub fn node_count(&self) -> u32 {
        (self.nodes.len() / (2 * WIDTH)) as u32
    }

    /// Words that a stack needs at most: one for each node on the way from the root that has further children to be visited.
    pub fn stack_bound(&self) -> u32 {
        self.depth.saturating_sub(1)
    }

    fn push_empty(&mut self) {
        for _ in 0..WIDTH {
            self.nodes.push([HUGE, HUGE, HUGE, 0.0]);
            self.nodes.push([-HUGE, -HUGE, -HUGE, 0.0]);
        }
    }

    /// Costs of all subtrees, children before parents.
    fn costs(bvh: &Bvh) -> Vec<Subtree> {
        let count = bvh.node_count() as usize;
        let mut subtrees: Vec<Subtree> = Vec::with_capacity(count);
        for i in 0..count {
            let (a, b) = (bvh.node_min[i], bvh.node_max[i]);
            let [x, y, z] = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
            let leaf = b[3].to_bits();
            subtrees.push(Subtree {
                first: leaf >> 3,
                triangles: leaf & 7,
                // Areas of huge scenes overflow; any order among huge costs will do.
                area: Some(x * y + y * z + z * x).filter(|a| a.is_finite()).unwrap_or(1e30),
                cost: [0.0; WIDTH],
                left: [0; WIDTH],
                leaf: true,
            });
        }
        // Depth-first order: children have larger indices than their parents.
        for i in (0..count).rev() {
            let area = subtrees[i].area;
            if subtrees[i].triangles > 0 {
                subtrees[i].cost = [LEAF_COST * area; WIDTH];
                continue;
            }
            let (l, r) = (i + 1, bvh.node_min[i + 1][3].to_bits() as usize);
            let split = |k: usize, s: &[Subtree]| {
                (1..k)
                    .map(|left| (s[l].cost[left - 1] + s[r].cost[k - left - 1], left as u8))
                    .fold((f32::INFINITY, 0), |best, c| if c.0 < best.0 { c } else { best })
            };
            let triangles = subtrees[l].triangles + subtrees[r].triangles;
            let (inner, left) = split(WIDTH, &subtrees);
            let as_leaf = if triangles <= MAX_LEAF { LEAF_COST * area } else { f32::INFINITY };
            let mut cost = [0.0; WIDTH];
            let mut lefts = [0; WIDTH];
            cost[0] = as_leaf.min(area + inner);
            lefts[0] = left;
            for k in 2..=WIDTH {
                let (c, left) = split(k, &subtrees);
                (cost[k - 1], lefts[k - 1]) = if c < cost[k - 2] { (c, left) } else { (cost[k - 2], 0) };
            }
            let first = subtrees[l].first;
            let s = &mut subtrees[i];
            (s.first, s.triangles, s.cost, s.left) = (first, triangles, cost, lefts);
            s.leaf = triangles <= MAX_LEAF && as_leaf <= area + inner;
        }
        subtrees
    }

    /// The subtrees that stand for `node` as at most `k` children. `open`: the node itself is replaced by its children.
    fn distribute(bvh: &Bvh, subtrees: &[Subtree], node: u32, k: usize, open: bool, children: &mut Vec<u32>) {
        let s = &subtrees[node as usize];
        // Fewer children than allowed may be as good.
        let mut k = k;
        while !open && k > 1 && s.left[k - 1] == 0 {
            k -= 1;
        }
        if k == 1 {
            children.push(node);
            return;
        }
        let left = usize::from(s.left[if open { 0 } else { k - 1 }]);
        let l = node + 1;
        let r = bvh.node_min[l as usize][3].to_bits();
        Self::distribute(bvh, subtrees, l, left, false, children);
        Self::distribute(bvh, subtrees, r, k - left, false, children);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    /// Walks the tree: every triangle in one leaf, in a box that contains it, at no more than the stated depth.
    fn check(wide: &WideBvh, bvh: &Bvh) {
        let mut seen = vec![false; bvh.triangle_count() as usize];
        let mut stack = vec![(0u32, 1u32)];
        let mut visited = 0;
        while let Some((node, depth)) = stack.pop() {
            visited += 1;
            assert!(depth <= wide.depth);
            for k in 0..WIDTH {
                let at = 2 * (WIDTH * node as usize + k);
                let (lower, upper) = (wide.nodes[at], wide.nodes[at + 1]);
                let (index, count) = (lower[3].to_bits(), upper[3].to_bits());
                if lower[0] > upper[0] {
                    assert_eq!((index, count), (0, 0), "an empty child");
                    continue;
                }
                if count == 0 {
                    stack.push((index, depth + 1));
                    continue;
                }
                assert!(count <= MAX_LEAF);
                for t in index..index + count {
                    assert!(!std::mem::replace(&mut seen[t as usize], true), "triangle {t} is in two leaves");
                    let t = t as usize;
                    for axis in 0..3 {
                        let a = bvh.v0[t][axis];
                        for x in [a, a + bvh.e1[t][axis], a + bvh.e2[t][axis]] {
                            assert!(lower[axis] <= x && x <= upper[axis], "triangle {t} leaves its box");
                        }
                    }
                }
            }
        }
        assert_eq!(visited, wide.node_count());
        assert!(seen.iter().all(|&s| s), "a triangle is missing");
    }

    #[test]
    fn holds_every_triangle_once() {
        for scene in [builtin::furnace(0.5, 1.0), builtin::room(200), builtin::room(20_000), builtin::deep_scene(700)] {
            let bvh = Bvh::build(&scene).unwrap();
            let wide = WideBvh::build(&bvh);
            check(&wide, &bvh);
            let leaves = wide.nodes.chunks(2).filter(|c| c[1][3].to_bits() > 0).count();
            let filling = bvh.triangle_count() as f32 / leaves as f32;
            assert!(wide.node_count() == 1 || filling > 2.0, "{filling} triangles a leaf");
        }
    }
}
