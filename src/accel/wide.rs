//! The hierarchy eight wide, for kernels in which a subgroup walks the tree for a cluster of rays together.
//!
//! It is collapsed from the binary one and shares its triangles: any subtree of at most [`MAX_LEAF`] contiguous triangles, such
//! as those of one object, can be a leaf. A node is a block of eight children, sixteen vec4:
//!
//! | field               | meaning |
//! |---------------------|---------|
//! | `nodes[16 n + 2 k].xyz`     | lower corner of child k; +huge if there is none |
//! | `nodes[16 n + 2 k].w`       | bits of a `u32`: the child's node, or the first triangle of a leaf |
//! | `nodes[16 n + 2 k + 1].xyz` | upper corner; -huge if there is no child |
//! | `nodes[16 n + 2 k + 1].w`   | bits of a `u32`: 0 for an inner child, else the leaf's number of triangles (1..=8) |
//!
//! Inner children come first, in contiguous nodes; empty children come last. The root is node 0, even if the whole scene is one leaf.
//!
//! Dynamic programming over the binary tree chooses the subtrees that become children (as in Ylitie et al. 2017 for compressed
//! nodes), with a cost that counts a leaf once for any number of triangles, because a subgroup tests them together.

use super::Bvh;

/// Maximum number of triangles in a leaf.
pub const MAX_LEAF: u32 = 8;
/// Children of a node.
pub const WIDTH: usize = 8;

/// Cost of visiting a leaf relative to that of a node.
const LEAF_COST: f32 = 1.2;
/// Corner of the box of an absent child: no ray meets a box whose lower corner is above its upper one.
const HUGE: f32 = 3.0e38;

/// Maximum stack size of a traversal, in words, for a tree of this depth.
pub fn stack_bound(depth: u32) -> u32 {
    depth.saturating_sub(1)
}

/// A node without children.
pub(super) const EMPTY: [[f32; 4]; 2 * WIDTH] = {
    let mut node = [[HUGE, HUGE, HUGE, 0.0]; 2 * WIDTH];
    let mut k = 1;
    while k < 2 * WIDTH {
        node[k] = [-HUGE, -HUGE, -HUGE, 0.0];
        k += 2;
    }
    node
};

/// The eight-wide hierarchy.
#[derive(Clone, Debug, PartialEq)]
pub struct WideBvh {
    /// Sixteen vec4 a node.
    pub nodes: Vec<[f32; 4]>,
    /// Nodes on the longest path from the root.
    pub depth: u32,
    /// Binary node of each child; [`NONE`] if there is no child.
    pub sources: Vec<u32>,
}

/// "No node" in [`WideBvh::sources`].
pub const NONE: u32 = u32::MAX;

/// A binary node during the collapse.
struct Subtree {
    first: u32,
    triangles: u32,
    area: f32,
    /// For k in 1..=8: minimum cost of representing this subtree by at most k children of a wide node above it.
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
        Self::collapse(&bvh.node_min, &bvh.node_max, MAX_LEAF)
    }

    /// Collapses binary nodes into a tree whose leaves have at most `max_leaf` triangles.
    pub(super) fn collapse(node_min: &[[f32; 4]], node_max: &[[f32; 4]], max_leaf: u32) -> WideBvh {
        let subtrees = Self::costs(node_min, node_max, max_leaf);
        let mut wide = WideBvh { nodes: Vec::new(), depth: 0, sources: Vec::new() };
        // Nodes to be written: binary node, index in `nodes`, depth.
        let mut queue = std::collections::VecDeque::from([(0u32, 0u32, 1u32)]);
        wide.push_empty();
        while let Some((node, place, depth)) = queue.pop_front() {
            wide.depth = wide.depth.max(depth);
            let mut children = Vec::with_capacity(WIDTH);
            if subtrees[node as usize].leaf {
                children.push(node);
            } else {
                Self::distribute(node_min, &subtrees, node, WIDTH, true, &mut children);
            }
            // Stable: otherwise children keep the order of the binary tree.
            children.sort_by_key(|&child| subtrees[child as usize].leaf);
            for (k, &child) in children.iter().enumerate() {
                let s = &subtrees[child as usize];
                let (lower, upper) = (node_min[child as usize], node_max[child as usize]);
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
                wide.sources[at / 2] = child;
            }
        }
        wide
    }

    /// Copies the boxes of the binary nodes after a refit.
    pub(super) fn refit(&mut self, node_min: &[[f32; 4]], node_max: &[[f32; 4]]) {
        for (child, &source) in self.nodes.chunks_exact_mut(2).zip(&self.sources).filter(|(_, s)| **s != NONE) {
            child[0][..3].copy_from_slice(&node_min[source as usize][..3]);
            child[1][..3].copy_from_slice(&node_max[source as usize][..3]);
        }
    }

    /// The whole tree as a leaf, first triangle and number, if it is one.
    pub(super) fn single_leaf(&self) -> Option<(u32, u32)> {
        let child = |k: usize| (self.nodes[2 * k][3].to_bits(), self.nodes[2 * k + 1][3].to_bits());
        (self.sources[1] == NONE && child(0).1 > 0).then(|| child(0))
    }

    /// Number of nodes.
    pub fn node_count(&self) -> u32 {
        (self.nodes.len() / (2 * WIDTH)) as u32
    }

    /// Maximum stack size in words: one for each node on the path from the root with unvisited children.
    pub fn stack_bound(&self) -> u32 {
        stack_bound(self.depth)
    }

    fn push_empty(&mut self) {
        self.nodes.extend(EMPTY);
        self.sources.extend([NONE; WIDTH]);
    }

    /// Costs of all subtrees, children before parents.
    fn costs(node_min: &[[f32; 4]], node_max: &[[f32; 4]], max_leaf: u32) -> Vec<Subtree> {
        let count = node_min.len();
        let mut subtrees: Vec<Subtree> = Vec::with_capacity(count);
        for i in 0..count {
            let (a, b) = (node_min[i], node_max[i]);
            let [x, y, z] = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
            let leaf = b[3].to_bits();
            subtrees.push(Subtree {
                first: leaf >> 3,
                triangles: leaf & 7,
                // Areas of huge scenes overflow; any order among huge costs is acceptable.
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
            let (l, r) = (i + 1, node_min[i + 1][3].to_bits() as usize);
            let split = |k: usize, s: &[Subtree]| {
                (1..k)
                    .map(|left| (s[l].cost[left - 1] + s[r].cost[k - left - 1], left as u8))
                    .fold((f32::INFINITY, 0), |best, c| if c.0 < best.0 { c } else { best })
            };
            let triangles = subtrees[l].triangles + subtrees[r].triangles;
            let (inner, left) = split(WIDTH, &subtrees);
            let as_leaf = if triangles <= max_leaf { LEAF_COST * area } else { f32::INFINITY };
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
            s.leaf = triangles <= max_leaf && as_leaf <= area + inner;
        }
        subtrees
    }

    /// The subtrees that represent `node` as at most `k` children. `open`: the node itself is replaced by its children.
    fn distribute(
        node_min: &[[f32; 4]],
        subtrees: &[Subtree],
        node: u32,
        k: usize,
        open: bool,
        children: &mut Vec<u32>,
    ) {
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
        let r = node_min[l as usize][3].to_bits();
        Self::distribute(node_min, subtrees, l, left, false, children);
        Self::distribute(node_min, subtrees, r, k - left, false, children);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::scene::builtin;

    /// Walks the tree: every triangle in one leaf, in a box that contains it, at no more than the stated depth.
    /// Returns the number of nodes visited.
    #[track_caller]
    pub fn check_nodes(wide: &WideBvh, bvh: &Bvh) -> u32 {
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
        assert!(seen.iter().all(|&s| s), "a triangle is missing");
        visited
    }

    #[test]
    fn holds_every_triangle_once() {
        for scene in [builtin::furnace(0.5, 1.0), builtin::room(200), builtin::room(20_000), builtin::deep_scene(700)] {
            let bvh = Bvh::build(&scene).unwrap();
            let wide = WideBvh::build(&bvh);
            assert_eq!(check_nodes(&wide, &bvh), wide.node_count());
            let leaves = wide.nodes.chunks(2).filter(|c| c[1][3].to_bits() > 0).count();
            let filling = bvh.triangle_count() as f32 / leaves as f32;
            assert!(wide.node_count() == 1 || filling > 2.0, "{filling} triangles a leaf");
        }
    }
}
