//! Binary trees over boxes: locally ordered clustering (Meister and Bittner 2018, by obvhs), which joins two neighbours on a space-filling curve
//! where each is the other's best. In a row of boxes that grow, or that stand evenly, only one pair in a round is, and the
//! rounds take quadratic time. Such boxes get a balanced tree along the curve, in linear time after the sorting.

use glam::DVec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::ploc::morton::morton_encode_u64_unorm;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Boxes that clustering may join in any number of rounds.
const FEW: usize = 4096;

/// Boxes that the rounds before may look at, for each box. Five rooms and objects of 19,000 to 415,000 triangles take 2.3 to 3.1.
const PATIENCE: usize = 32;

/// A tree over boxes, at least one. It does not depend on the number of threads. Also whether it was clustered: a balanced tree gains little by
/// reinsertion, which may take long in it.
pub fn tree(boxes: &[Aabb], distance: PlocSearchDistance) -> (Bvh2, bool) {
    if boxes.len() > FEW {
        let order = along_curve(boxes);
        if !joins_soon(order.iter().map(|&i| boxes[i as usize]).collect()) {
            return (balanced(boxes, order), false);
        }
    }
    let indices = (0..boxes.len() as u32).collect();
    (PlocBuilder::with_capacity(boxes.len()).build(distance, boxes, indices, SortPrecision::U64, 2), true)
}

/// Boxes in the order of their centres along a Morton curve.
fn along_curve(boxes: &[Aabb]) -> Vec<u32> {
    let centre = |b: &Aabb| 0.5 * (b.min.as_dvec3() + b.max.as_dvec3());
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for b in boxes {
        (low, high) = (low.min(centre(b)), high.max(centre(b)));
    }
    let scale = 1.0 / (high - low).max(DVec3::splat(f64::MIN_POSITIVE));
    let code = |b: &Aabb| morton_encode_u64_unorm((centre(b) - low) * scale);
    let mut order: Vec<(u64, u32)> = boxes.iter().map(code).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

/// Whether clustering leaves few of these boxes, in the order of the curve, before it has looked at [`PATIENCE`] times as many.
/// It is tried with neighbours alone, which is where the boxes' order stops it as well.
fn joins_soon(mut boxes: Vec<Aabb>) -> bool {
    let mut left = PATIENCE * boxes.len();
    let mut prefers_next = Vec::with_capacity(boxes.len());
    while boxes.len() > FEW {
        if left < boxes.len() {
            return false;
        }
        left -= boxes.len();
        prefers_next.clear();
        let mut before = f32::INFINITY;
        for pair in boxes.windows(2) {
            let cost = pair[0].union(&pair[1]).half_area();
            prefers_next.push(cost <= before);
            before = cost;
        }
        prefers_next.push(false);
        let (mut from, mut to) = (0, 0);
        while from < boxes.len() {
            let joins = prefers_next[from] && !prefers_next[from + 1];
            boxes[to] = if joins { boxes[from].union(&boxes[from + 1]) } else { boxes[from] };
            from += 1 + usize::from(joins);
            to += 1;
        }
        boxes.truncate(to);
    }
    true
}

/// The tree that halves boxes in this order again and again.
fn balanced(boxes: &[Aabb], order: Vec<u32>) -> Bvh2 {
    let mut tree = Bvh2 { nodes: vec![Bvh2Node::default()], ..Bvh2::zeroed(0) };
    // Nodes and the parts of the order that they hold.
    let mut open = vec![(0, 0..order.len())];
    while let Some((node, part)) = open.pop() {
        tree.nodes[node] = if part.len() == 1 {
            Bvh2Node::new(boxes[order[part.start] as usize], 1, part.start as u32)
        } else {
            let (first, middle) = (tree.nodes.len(), part.start + part.len() / 2);
            tree.nodes.extend([Bvh2Node::default(); 2]);
            open.extend([(first + 1, middle..part.end), (first, part.start..middle)]);
            Bvh2Node::new(Aabb::empty(), 0, first as u32)
        };
    }
    // Children come after their parents.
    for node in (0..tree.nodes.len()).rev() {
        if !tree.nodes[node].is_leaf() {
            let first = tree.nodes[node].first_index as usize;
            let joined = tree.nodes[first].aabb().union(tree.nodes[first + 1].aabb());
            tree.nodes[node].set_aabb(joined);
        }
    }
    tree.primitive_indices = order;
    tree.children_are_ordered_after_parents = true;
    tree
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::{key, random_f32};
    use glam::{Vec3, Vec3A};

    /// Boxes around points.
    fn boxes(count: u32, of: impl Fn(u32) -> (Vec3, f32)) -> Vec<Aabb> {
        let around =
            |(middle, radius): (Vec3, f32)| Aabb::new(Vec3A::from(middle - radius), Vec3A::from(middle + radius));
        (0..count).map(of).map(around).collect()
    }

    fn nested(count: u32) -> Vec<Aabb> {
        boxes(count, |i| (Vec3::ZERO, 1.0 + 1e-3 * i as f32))
    }

    fn row(count: u32) -> Vec<Aabb> {
        boxes(count, |i| (Vec3::new(i as f32, 0.0, 0.0), 0.25))
    }

    fn scattered(count: u32) -> Vec<Aabb> {
        let number = |i, j| random_f32(key(7, i, j, 0));
        boxes(count, |i| (Vec3::from_array([0, 1, 2].map(|axis| 100.0 * number(i, axis))), number(i, 3)))
    }

    #[test]
    fn rows_and_nested_boxes_get_balanced_trees() {
        for count in [2 * FEW as u32, 50_000] {
            for (name, boxes) in [("nested", nested(count)), ("row", row(count))] {
                let (tree, clustered) = tree(&boxes, PlocSearchDistance::Medium);
                assert!(!clustered, "{name}");
                // Each box is in one leaf, at the depth of a balanced tree, and inside of all nodes above.
                let (mut seen, mut stack) = (vec![false; boxes.len()], vec![(0, 0, *tree.nodes[0].aabb())]);
                while let Some((node, depth, around)) = stack.pop() {
                    let node = &tree.nodes[node];
                    assert_eq!(node.aabb().union(&around), around, "{name}");
                    if node.is_leaf() {
                        assert!(depth <= boxes.len().ilog2() + 1, "{name}: {depth}");
                        let own = tree.primitive_indices[node.first_index as usize] as usize;
                        assert_eq!(*node.aabb(), boxes[own]);
                        assert!(!std::mem::replace(&mut seen[own], true), "{name}");
                    } else {
                        let first = node.first_index as usize;
                        stack.extend([first, first + 1].map(|child| (child, depth + 1, *node.aabb())));
                    }
                }
                assert!(seen.into_iter().all(|seen| seen), "{name}");
            }
        }
    }

    #[test]
    fn other_boxes_are_clustered() {
        assert!(tree(&scattered(50_000), PlocSearchDistance::Medium).1);
        // Few boxes are clustered however they lie.
        assert!(tree(&row(1000), PlocSearchDistance::Medium).1);
        assert!(tree(&row(1), PlocSearchDistance::Medium).1);
    }

    #[test]
    fn a_row_among_other_boxes_is_found() {
        let mixed: Vec<Aabb> = scattered(50_000).into_iter().chain(nested(20_000)).collect();
        assert!(!tree(&mixed, PlocSearchDistance::Medium).1);
    }
}
