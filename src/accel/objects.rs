//! A hierarchy for scenes whose objects move: a tree for each object, joined by a small tree over the objects.
//!
//! Both levels lie in one array of nodes, in world space and in the form that [`super`] describes, so kernels traverse it like
//! any other. When an object moves:
//!
//! - its triangles are written again and its own tree is *refitted*: same nodes, new boxes. Refitting lets boxes overlap
//!   more and more; when the cost of the tree by the surface area heuristic (mean number of nodes and triangles visited by a ray
//!   that hits its box) exceeds [`REBUILD_RATIO`] times that at build time, it is rebuilt;
//! - the tree over the objects is rebuilt from their boxes, O(objects log objects). It depends on nothing else, so objects
//!   that return to a position get the same tree again. If its shape changes, the nodes of all objects are copied
//!   to their new positions in the array, else only changed nodes are written;
//! - the eight-wide tree is treated in the same way: the nodes of an object stay in place, apart from its root, which lies among
//!   the nodes over the objects, because inner children of a node must be contiguous.
//!
//! Compared with a single tree over all triangles, rays through overlapping boxes of objects visit more nodes, so
//! static scenes use a single tree. If the joined tree costs more than [`JOIN_RATIO`] times the single one by the surface
//! area heuristic, because objects reach into each other, all objects share one tree: any motion then refits all of it, O(triangles),
//! but rays pay nothing.

use std::ops::Range;
use std::time::Instant;

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocSearchDistance;
use rayon::prelude::*;

use super::wide::{self, WIDTH, WideBvh};
use super::{BOX_PADDING, Bvh, build, padded, triangle_record, with_bits, xyz};
use crate::error::{Error, Result};
use crate::scene::Scene;

/// A refitted tree is rebuilt when its cost exceeds that at build time by this factor.
pub const REBUILD_RATIO: f64 = 1.5;

/// Trees of objects are joined unless that costs more than this factor of one tree for all.
pub const JOIN_RATIO: f64 = 1.5;

/// vec4 of a wide node.
const BLOCK: usize = 2 * WIDTH;

/// The trees of the objects and the tree that joins them.
#[derive(Clone, Debug)]
pub struct ObjectTrees {
    subtrees: Vec<Subtree>,
    /// Subtree of each object of the scene, if it has triangles; all may share one.
    of_object: Vec<Option<usize>>,
    /// The tree over the subtrees, depth first.
    places: Vec<Place>,
    padding: f32,
    /// The eight-wide tree over everything, if requested; its `sources` are empty.
    pub wide: Option<WideBvh>,
}

/// The tree of one object, or of all; node indices are relative to its own root, triangle indices are global.
#[derive(Clone, Debug)]
struct Subtree {
    triangles: Range<usize>,
    lower: Vec3,
    upper: Vec3,
    node_min: Vec<[f32; 4]>,
    node_max: Vec<[f32; 4]>,
    built_cost: f64,
    wide: Option<WideBvh>,
    /// Index of its first wide node after the root.
    wide_at: usize,
}

/// A node of the tree over the objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// Its first child comes next.
    Inner { second: usize },
    /// A subtree.
    Object(usize),
}

/// A [`Place`] with its box and its position in the arrays.
#[derive(Clone, Copy, Default)]
struct Joint {
    lower: Vec3,
    upper: Vec3,
    /// The place after its subtree.
    skip: usize,
    /// Nodes of its subtree, including those of objects.
    nodes: usize,
    /// Its node.
    at: usize,
}

/// Ranges of the arrays written by an update, and its times.
#[derive(Clone, Debug, Default)]
pub struct Changes {
    /// Triangles with other vertices or in another order.
    pub triangles: Vec<Range<usize>>,
    /// Of these, the triangles of rebuilt trees, which have another order.
    pub reordered: Vec<Range<usize>>,
    /// Nodes.
    pub nodes: Vec<Range<usize>>,
    /// vec4 of wide nodes.
    pub wide: Vec<Range<usize>>,
    /// Seconds taken by triangles and trees of objects.
    pub refit_seconds: f64,
    /// Seconds taken by the tree over the objects.
    pub top_seconds: f64,
}

impl ObjectTrees {
    /// Builds the trees of all objects and joins them; with `clusters` also the eight-wide tree.
    ///
    /// Errors: [`Error::Scene`] without triangles, or with more than 2^28.
    pub fn build(scene: &Scene, clusters: bool) -> Result<(ObjectTrees, Bvh)> {
        let count = scene.triangles.len();
        if count == 0 || count > 1 << 28 {
            return Err(Error::Scene(format!("{count} triangles: a hierarchy needs 1 to {}", 1 << 28)));
        }
        let mut members: Vec<Vec<u32>> = vec![Vec::new(); scene.objects.len()];
        for (i, triangle) in (0..).zip(&scene.triangles) {
            members[triangle.object as usize].push(i);
        }
        let (min, max) = scene.bounds();
        let mut bvh = Bvh {
            node_min: Vec::new(),
            node_max: Vec::new(),
            v0: Vec::with_capacity(count),
            e1: Vec::with_capacity(count),
            e2: Vec::with_capacity(count),
            min,
            max,
        };
        let padding = padding(bvh.scale());
        let mut trees = ObjectTrees {
            subtrees: Vec::new(),
            of_object: vec![None; scene.objects.len()],
            places: Vec::new(),
            padding,
            wide: clusters.then(|| WideBvh { nodes: Vec::new(), depth: 0, sources: Vec::new() }),
        };
        let own: Vec<Option<Bvh>> =
            members.par_iter().map(|m| (!m.is_empty()).then(|| Bvh::over(scene, m, |_| padding))).collect();
        for (object, own) in own.into_iter().enumerate() {
            let Some(own) = own else { continue };
            trees.of_object[object] = Some(trees.subtrees.len());
            trees.add(&mut bvh, own, clusters);
        }
        trees.places = trees.top_level();
        trees.assemble(&mut bvh);
        if trees.subtrees.len() > 1 {
            let all: Vec<u32> = (0..count as u32).collect();
            let single = Bvh::over(scene, &all, |_| padding);
            let ratio = cost(&bvh.node_min, &bvh.node_max) / cost(&single.node_min, &single.node_max);
            log::info!("trees of {} objects cost {ratio:.2} times as much as one for all", trees.subtrees.len());
            if ratio > JOIN_RATIO {
                [&mut bvh.v0, &mut bvh.e1, &mut bvh.e2].into_iter().for_each(Vec::clear);
                trees.subtrees.clear();
                trees.of_object.iter_mut().flatten().for_each(|slot| *slot = 0);
                trees.add(&mut bvh, single, clusters);
                trees.places = trees.top_level();
                trees.assemble(&mut bvh);
            }
        }
        trees.assemble_wide();
        Ok((trees, bvh))
    }

    /// Adds a tree whose triangles come after those of all before.
    fn add(&mut self, bvh: &mut Bvh, own: Bvh, clusters: bool) {
        let first = bvh.v0.len();
        bvh.v0.extend_from_slice(&own.v0);
        bvh.e1.extend_from_slice(&own.e1);
        bvh.e2.extend_from_slice(&own.e2);
        self.subtrees.push(Subtree::new(own, first, clusters));
    }

    /// Updates the trees and `bvh`, both from [`ObjectTrees::build`], to the present positions of `scene`; `moved` are the
    /// objects whose positions have changed.
    pub fn update(&mut self, bvh: &mut Bvh, scene: &Scene, moved: &[u32]) -> Changes {
        let start = Instant::now();
        let mut changes = Changes::default();
        let mut moved: Vec<usize> = moved.iter().filter_map(|&object| self.of_object[object as usize]).collect();
        moved.sort_unstable();
        moved.dedup();
        for &slot in &moved {
            self.subtrees[slot].place_triangles(bvh, scene);
            changes.triangles.push(self.subtrees[slot].triangles.clone());
        }
        bvh.min = self.subtrees.iter().fold(Vec3::INFINITY, |low, s| low.min(s.lower));
        bvh.max = self.subtrees.iter().fold(Vec3::NEG_INFINITY, |high, s| high.max(s.upper));
        let wider = padding(bvh.scale());
        let refitted = if wider == self.padding { moved.clone() } else { (0..self.subtrees.len()).collect() };
        self.padding = wider;
        let mut rebuilt = false;
        for &slot in &refitted {
            let subtree = &mut self.subtrees[slot];
            subtree.refit(bvh, scene, wider);
            if subtree.cost() > REBUILD_RATIO * subtree.built_cost {
                subtree.rebuild(bvh, scene, wider);
                changes.reordered.push(subtree.triangles.clone());
                if !moved.contains(&slot) {
                    changes.triangles.push(subtree.triangles.clone());
                }
                rebuilt = true;
            }
        }
        changes.refit_seconds = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let places = self.top_level();
        if rebuilt || places != self.places {
            self.places = places;
            self.assemble(bvh);
            changes.nodes.push(0..bvh.node_min.len());
        } else {
            self.write_changed(bvh, &refitted, &mut changes);
        }
        if rebuilt {
            self.assemble_wide();
            changes.wide.extend(self.wide.iter().map(|wide| 0..wide.nodes.len()));
        } else {
            changes.wide.push(0..self.join_wide());
            changes.wide.extend(refitted.iter().filter_map(|&slot| self.write_wide(slot)));
        }
        changes.top_seconds = start.elapsed().as_secs_f64();
        changes
    }

    /// The tree over the boxes of the objects.
    fn top_level(&self) -> Vec<Place> {
        let boxes: Vec<Aabb> = self.subtrees.iter().map(|s| Aabb::new(s.lower.into(), s.upper.into())).collect();
        // As a task of the thread pool, for the same reason as a scene's tree.
        let tree = rayon::scope(|_| {
            let (mut tree, clustered) = build::tree(&boxes, PlocSearchDistance::High);
            if clustered {
                ReinsertionOptimizer::default().run(&mut tree, 0.5, None);
            }
            tree
        });
        let mut places = Vec::with_capacity(2 * boxes.len());
        // Nodes of `tree` with the place whose second child they are.
        let mut stack = vec![(0u32, None)];
        while let Some((index, parent)) = stack.pop() {
            let own = places.len();
            if let Some(parent) = parent {
                places[parent] = Place::Inner { second: own };
            }
            let node = &tree.nodes[index as usize];
            if node.is_leaf() {
                let first = node.first_index as usize;
                let members = &tree.primitive_indices[first..first + node.prim_count as usize];
                // All members but the last are attached to a chain of inner nodes.
                for (k, &member) in members.iter().enumerate() {
                    if k + 1 < members.len() {
                        places.push(Place::Inner { second: places.len() + 2 });
                    }
                    places.push(Place::Object(member as usize));
                }
            } else {
                let (mut first, mut second) = (node.first_index, node.first_index + 1);
                let area = |n: u32| tree.nodes[n as usize].aabb().half_area();
                if area(second) > area(first) {
                    std::mem::swap(&mut first, &mut second);
                }
                // The second child is not known yet.
                places.push(Place::Inner { second: 0 });
                stack.extend([(second, Some(own)), (first, None)]);
            }
        }
        places
    }

    /// Boxes and positions of the places.
    fn joints(&self) -> Vec<Joint> {
        let mut joints = vec![Joint::default(); self.places.len()];
        // Children come after their parents.
        for (i, place) in self.places.iter().enumerate().rev() {
            joints[i] = match *place {
                Place::Object(slot) => {
                    let Subtree { node_min, node_max, .. } = &self.subtrees[slot];
                    let (lower, upper) = (xyz(&node_min[0]), xyz(&node_max[0]));
                    Joint { lower, upper, skip: i + 1, nodes: node_min.len(), at: 0 }
                }
                Place::Inner { second } => {
                    let (a, b) = (joints[i + 1], joints[second]);
                    let (lower, upper) = (a.lower.min(b.lower), a.upper.max(b.upper));
                    Joint { lower, upper, skip: b.skip, nodes: 1 + a.nodes + b.nodes, at: 0 }
                }
            };
        }
        for (i, place) in self.places.iter().enumerate() {
            if let Place::Inner { second } = *place {
                joints[i + 1].at = joints[i].at + 1;
                joints[second].at = joints[i].at + 1 + joints[i + 1].nodes;
            }
        }
        joints
    }

    /// Writes all nodes.
    fn assemble(&self, bvh: &mut Bvh) {
        let joints = self.joints();
        let count = joints[0].nodes;
        bvh.node_min.resize(count, [0.0; 4]);
        bvh.node_max.resize(count, [0.0; 4]);
        for (place, joint) in self.places.iter().zip(&joints) {
            match *place {
                Place::Inner { .. } => joint.write(bvh),
                Place::Object(slot) => self.subtrees[slot].write(bvh, joint.at),
            }
        }
    }

    /// Writes the nodes of some subtrees, and those above them whose box has changed.
    fn write_changed(&self, bvh: &mut Bvh, slots: &[usize], changes: &mut Changes) {
        let mut changed = vec![false; self.subtrees.len()];
        slots.iter().for_each(|&slot| changed[slot] = true);
        for (place, joint) in self.places.iter().zip(&self.joints()) {
            let range = joint.at..joint.at + joint.nodes;
            match *place {
                Place::Inner { .. } => {
                    if xyz(&bvh.node_min[joint.at]) != joint.lower || xyz(&bvh.node_max[joint.at]) != joint.upper {
                        joint.write(bvh);
                        changes.nodes.push(joint.at..joint.at + 1);
                    }
                }
                Place::Object(slot) if changed[slot] => {
                    self.subtrees[slot].write(bvh, joint.at);
                    changes.nodes.push(range);
                }
                Place::Object(_) => {}
            }
        }
    }

    /// Writes all wide nodes: first room for those over the objects and for their roots, then the rest of each object.
    fn assemble_wide(&mut self) {
        let Some(joined) = &mut self.wide else { return };
        // Every inner node has two children or more.
        let mut end = 2 * self.subtrees.len();
        for subtree in &mut self.subtrees {
            subtree.wide_at = end;
            end += subtree.wide.as_ref().map_or(0, |wide| wide.node_count() as usize - 1);
        }
        joined.nodes.clear();
        joined.nodes.resize(end * BLOCK, [0.0; 4]);
        joined.nodes.chunks_exact_mut(BLOCK).for_each(|node| node.copy_from_slice(&wide::EMPTY));
        self.join_wide();
        for slot in 0..self.subtrees.len() {
            self.write_wide(slot);
        }
    }

    /// Writes the wide nodes of a subtree except its root; returns the range of vec4 written.
    fn write_wide(&mut self, slot: usize) -> Option<Range<usize>> {
        let subtree = &self.subtrees[slot];
        let (joined, own) = (self.wide.as_mut()?, subtree.wide.as_ref()?);
        let at = subtree.wide_at * BLOCK;
        let range = at..at + own.nodes.len() - BLOCK;
        joined.nodes[range.clone()].copy_from_slice(&own.nodes[BLOCK..]);
        joined.nodes[range.clone()].chunks_exact_mut(2).for_each(|child| subtree.link(child));
        Some(range).filter(|range| !range.is_empty())
    }

    /// Writes the wide nodes over the objects and the roots of these; returns the number of vec4.
    fn join_wide(&mut self) -> usize {
        let Some(mut joined) = self.wide.take() else { return 0 };
        let joints = self.joints();
        let node_min: Vec<_> = joints.iter().map(|j| with_bits(j.lower, j.skip as u32)).collect();
        let leaf = |place: &Place| match *place {
            Place::Inner { .. } => 0,
            Place::Object(slot) => (slot as u32) << 3 | 1,
        };
        let node_max: Vec<_> =
            joints.iter().zip(&self.places).map(|(j, place)| with_bits(j.upper, leaf(place))).collect();
        // Its leaves are objects, one each.
        let top = WideBvh::collapse(&node_min, &node_max, 1);
        enum Node {
            Top(usize),
            Root(usize),
        }
        let mut queue = std::collections::VecDeque::from([(Node::Top(0), 0usize, 1u32)]);
        let mut end = 1;
        joined.depth = 0;
        while let Some((node, at, depth)) = queue.pop_front() {
            let place = at * BLOCK..(at + 1) * BLOCK;
            match node {
                Node::Root(slot) => {
                    let subtree = &self.subtrees[slot];
                    if let Some(own) = &subtree.wide {
                        joined.nodes[place.clone()].copy_from_slice(&own.nodes[..BLOCK]);
                        joined.nodes[place].chunks_exact_mut(2).for_each(|child| subtree.link(child));
                        joined.depth = joined.depth.max(depth - 1 + own.depth);
                    }
                }
                Node::Top(index) => {
                    joined.depth = joined.depth.max(depth);
                    joined.nodes[place.clone()].copy_from_slice(&wide::EMPTY);
                    let (mut inner, mut leaves) = (Vec::new(), Vec::new());
                    for child in top.nodes[index * BLOCK..(index + 1) * BLOCK].chunks_exact(2) {
                        let (lower, upper) = (child[0], child[1]);
                        let (index, count) = (lower[3].to_bits() as usize, upper[3].to_bits());
                        if lower[0] > upper[0] {
                            continue;
                        }
                        let single = |slot: usize| self.subtrees[slot].wide.as_ref().and_then(WideBvh::single_leaf);
                        match (count, single) {
                            (0, _) => inner.push((Node::Top(index), lower, upper)),
                            (_, single) => match single(index) {
                                Some((first, count)) => leaves.push(([first, count], lower, upper)),
                                None => inner.push((Node::Root(index), lower, upper)),
                            },
                        }
                    }
                    let first = end;
                    end += inner.len();
                    let links = (first..).map(|at| [at as u32, 0]).zip(&inner).map(|(link, (_, l, u))| (link, *l, *u));
                    let children = links.chain(leaves.iter().copied());
                    for (slot, ([link, count], lower, upper)) in joined.nodes[place].chunks_exact_mut(2).zip(children) {
                        slot[0] = with_bits(xyz(&lower), link);
                        slot[1] = with_bits(xyz(&upper), count);
                    }
                    queue.extend(inner.into_iter().zip(first..).map(|((node, ..), at)| (node, at, depth + 1)));
                }
            }
        }
        self.wide = Some(joined);
        end * BLOCK
    }
}

impl Joint {
    /// Writes it as an inner node.
    fn write(&self, bvh: &mut Bvh) {
        bvh.node_min[self.at] = with_bits(self.lower, (self.at + self.nodes) as u32);
        bvh.node_max[self.at] = with_bits(self.upper, 0);
    }
}

impl Subtree {
    /// Takes over the nodes of a tree whose triangles begin at `first`.
    fn new(own: Bvh, first: usize, clusters: bool) -> Subtree {
        let mut subtree = Subtree {
            triangles: first..first + own.v0.len(),
            lower: own.min,
            upper: own.max,
            node_min: own.node_min,
            node_max: own.node_max,
            built_cost: 0.0,
            wide: None,
            wide_at: 0,
        };
        for node in &mut subtree.node_max {
            let leaf = node[3].to_bits();
            if leaf != 0 {
                node[3] = f32::from_bits(leaf + ((first as u32) << 3));
            }
        }
        subtree.wide = clusters.then(|| WideBvh::collapse(&subtree.node_min, &subtree.node_max, wide::MAX_LEAF));
        subtree.built_cost = subtree.cost();
        subtree
    }

    /// Writes the triangles at their present positions, and their box.
    fn place_triangles(&mut self, bvh: &mut Bvh, scene: &Scene) {
        (self.lower, self.upper) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for k in self.triangles.clone() {
            let index = bvh.e1[k][3].to_bits();
            [bvh.v0[k], bvh.e1[k], bvh.e2[k]] = triangle_record(scene, index);
            for p in scene.triangle_positions(index as usize) {
                self.lower = self.lower.min(p);
                self.upper = self.upper.max(p);
            }
        }
    }

    /// Refits the boxes of the nodes to the present positions of the triangles.
    fn refit(&mut self, bvh: &Bvh, scene: &Scene, padding: f32) {
        // Children come after their parents.
        for i in (0..self.node_min.len()).rev() {
            let leaf = self.node_max[i][3].to_bits();
            let (lower, upper) = if leaf == 0 {
                let (a, b) = (i + 1, self.node_min[i + 1][3].to_bits() as usize);
                let (lower, upper) = (xyz(&self.node_min[a]), xyz(&self.node_max[a]));
                (lower.min(xyz(&self.node_min[b])), upper.max(xyz(&self.node_max[b])))
            } else {
                let corners = (leaf >> 3..(leaf >> 3) + (leaf & 7)).flat_map(|k| {
                    let index = bvh.scene_triangle(k) as usize;
                    scene.triangle_positions(index)
                });
                let (lower, upper) =
                    corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
                padded(lower, upper, padding)
            };
            self.node_min[i][..3].copy_from_slice(&lower.to_array());
            self.node_max[i][..3].copy_from_slice(&upper.to_array());
        }
        if let Some(wide) = &mut self.wide {
            wide.refit(&self.node_min, &self.node_max);
        }
    }

    /// Rebuilds the tree.
    fn rebuild(&mut self, bvh: &mut Bvh, scene: &Scene, padding: f32) {
        let range = self.triangles.clone();
        let mut members: Vec<u32> = bvh.e1[range.clone()].iter().map(|e1| e1[3].to_bits()).collect();
        // In the order of the scene, so that the tree depends on the positions alone.
        members.sort_unstable();
        let own = Bvh::over(scene, &members, |_| padding);
        bvh.v0[range.clone()].copy_from_slice(&own.v0);
        bvh.e1[range.clone()].copy_from_slice(&own.e1);
        bvh.e2[range.clone()].copy_from_slice(&own.e2);
        *self = Subtree::new(own, range.start, self.wide.is_some());
    }

    fn cost(&self) -> f64 {
        cost(&self.node_min, &self.node_max)
    }

    /// Writes the nodes, the root at `at`.
    fn write(&self, bvh: &mut Bvh, at: usize) {
        let range = at..at + self.node_min.len();
        bvh.node_max[range.clone()].copy_from_slice(&self.node_max);
        for (node, own) in bvh.node_min[range].iter_mut().zip(&self.node_min) {
            *node = with_bits(xyz(own), own[3].to_bits() + at as u32);
        }
    }

    /// Converts the index of an inner child from relative to the own root to its position in the array.
    fn link(&self, child: &mut [[f32; 4]]) {
        let there = child[0][0] <= child[1][0];
        if there && child[1][3].to_bits() == 0 {
            child[0][3] = f32::from_bits(child[0][3].to_bits() - 1 + self.wide_at as u32);
        }
    }
}

/// Mean number of nodes and triangles visited by a ray that hits the root's box, by their areas.
fn cost(node_min: &[[f32; 4]], node_max: &[[f32; 4]]) -> f64 {
    let area = |i: usize| {
        let d = (xyz(&node_max[i]) - xyz(&node_min[i])).as_dvec3();
        d.x * d.y + d.y * d.z + d.z * d.x
    };
    let weight = |i: usize| f64::from((node_max[i][3].to_bits() & 7).max(1));
    (0..node_min.len()).map(|i| area(i) * weight(i)).sum::<f64>() / area(0).max(f64::MIN_POSITIVE)
}

/// Padding of boxes for a scene of this largest coordinate: that of the next power of two, so that it rarely changes.
fn padding(scale: f32) -> f32 {
    let exponent = scale.max(f32::MIN_POSITIVE).to_bits() >> 23;
    // The largest exponent is that of infinity.
    f32::from_bits((exponent + 1).min(254) << 23) * BOX_PADDING
}

#[cfg(test)]
mod tests;
