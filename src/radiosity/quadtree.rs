//! Quadtrees over quadrilaterals and triangles: every element has no children or four.
//!
//! Both shapes are split by the midpoints of their edges. A quadrilateral is the unit square in the coordinates (s, t) of its
//! surface, a triangle the half of it with s + t <= 1. An element of level l is a cell (u, v) of the grid of 2^l x 2^l cells; in a
//! triangle it is the half of the cell at its lower left corner, or inverted the half at its upper right corner.

/// Shape of a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Four corners: (0, 0), (1, 0), (1, 1), (0, 1).
    Quad,
    /// Three corners: (0, 0), (1, 0), (0, 1).
    Triangle,
}

/// An element of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Element {
    /// Splits above it.
    pub level: u8,
    /// Cell of the grid of 2^level x 2^level cells.
    pub cell: [u32; 2],
    /// The upper right half of the cell of a triangle.
    pub inverted: bool,
}

impl Element {
    /// The whole surface.
    pub const ROOT: Element = Element { level: 0, cell: [0, 0], inverted: false };

    /// Its four parts: for a quadrilateral (2u, 2v), (2u+1, 2v), (2u+1, 2v+1), (2u, 2v+1), for a triangle one at each corner, then the
    /// middle.
    pub fn children(self, shape: Shape) -> [Element; 4] {
        let [u, v] = self.cell.map(|n| 2 * n);
        let of = |du: u32, dv: u32, inverted: bool| Element { level: self.level + 1, cell: [u + du, v + dv], inverted };
        match (shape, self.inverted) {
            (Shape::Quad, _) => [of(0, 0, false), of(1, 0, false), of(1, 1, false), of(0, 1, false)],
            (Shape::Triangle, false) => [of(0, 0, false), of(1, 0, false), of(0, 1, false), of(0, 0, true)],
            (Shape::Triangle, true) => [of(1, 1, true), of(0, 1, true), of(1, 0, true), of(1, 1, false)],
        }
    }

    /// Its corners in the grid of 2^height cells a side, in order around it. `height` is at least its level.
    pub fn corners(self, shape: Shape, height: u8) -> impl ExactSizeIterator<Item = [u32; 2]> + Clone {
        let around: &'static [[u32; 2]] = match (shape, self.inverted) {
            (Shape::Quad, _) => &[[0, 0], [1, 0], [1, 1], [0, 1]],
            (Shape::Triangle, false) => &[[0, 0], [1, 0], [0, 1]],
            (Shape::Triangle, true) => &[[1, 1], [0, 1], [1, 0]],
        };
        let up = height - self.level;
        around.iter().map(move |[du, dv]| [(self.cell[0] + du) << up, (self.cell[1] + dv) << up])
    }

    /// Its share of the area of its root, where the halves s >= t and s < t of a quadrilateral have these shares; those of a triangle
    /// do not matter.
    pub fn share(self, shape: Shape, halves: [f32; 2]) -> f32 {
        let density = match (shape, self.cell[0].cmp(&self.cell[1])) {
            (Shape::Triangle, _) | (_, std::cmp::Ordering::Equal) => 1.0,
            (Shape::Quad, std::cmp::Ordering::Greater) => 2.0 * halves[0],
            (Shape::Quad, std::cmp::Ordering::Less) => 2.0 * halves[1],
        };
        density * 0.25f32.powi(i32::from(self.level))
    }

    /// The part in which a point lies. `at`: its coordinates.
    fn part_at(self, shape: Shape, at: [f32; 2]) -> usize {
        let scale = (f32::from(self.level) + 1.0).exp2();
        let [x, y] = [0, 1].map(|k| at[k] * scale - (2 * self.cell[k]) as f32);
        match (shape, self.inverted) {
            (Shape::Quad, _) => match (x >= 1.0, y >= 1.0) {
                (false, false) => 0,
                (true, false) => 1,
                (true, true) => 2,
                (false, true) => 3,
            },
            (Shape::Triangle, false) if x >= 1.0 => 1,
            (Shape::Triangle, false) if y >= 1.0 => 2,
            (Shape::Triangle, false) if x + y <= 1.0 => 0,
            (Shape::Triangle, false) => 3,
            (Shape::Triangle, true) if x <= 1.0 => 1,
            (Shape::Triangle, true) if y <= 1.0 => 2,
            (Shape::Triangle, true) if x + y >= 3.0 => 0,
            (Shape::Triangle, true) => 3,
        }
    }
}

/// A node of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    element: Element,
    /// Index of the first of four children; 0: none.
    children: u32,
}

/// A tree over a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    shape: Shape,
    nodes: Vec<Node>,
}

impl Tree {
    /// A surface that is not split.
    pub fn new(shape: Shape) -> Tree {
        Tree { shape, nodes: vec![Node { element: Element::ROOT, children: 0 }] }
    }

    /// All leaves at one level.
    pub fn full(shape: Shape, level: u8) -> Tree {
        let mut tree = Tree::new(shape);
        for _ in 0..level {
            let leaves: Vec<u32> = tree.leaves().map(|(node, _)| node).collect();
            leaves.into_iter().for_each(|node| tree.split(node));
        }
        tree
    }

    /// Shape of the surface.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// False: there is a root.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Element of a node.
    pub fn element(&self, node: u32) -> Element {
        self.nodes[node as usize].element
    }

    /// The four children of a node; `None`: it is a leaf.
    pub fn children(&self, node: u32) -> Option<[u32; 4]> {
        let first = self.nodes[node as usize].children;
        (first != 0).then_some([first, first + 1, first + 2, first + 3])
    }

    /// Gives a leaf four children; a node that has them keeps them.
    pub fn split(&mut self, node: u32) {
        let Node { element, children: 0 } = self.nodes[node as usize] else { return };
        self.nodes[node as usize].children = self.nodes.len() as u32;
        self.nodes.extend(element.children(self.shape).map(|element| Node { element, children: 0 }));
    }

    /// For each node the index of its first child, 0 for leaves: all that tells the tree from others of its shape.
    pub fn links(&self) -> impl Iterator<Item = u32> {
        self.nodes.iter().map(|node| node.children)
    }

    /// The tree with these [`Tree::links`]; `None`: they are those of no tree of levels up to `height`.
    pub fn from_links(shape: Shape, links: &[u32], height: u8) -> Option<Tree> {
        let mut nodes = vec![Node { element: Element::ROOT, children: 0 }; links.len()];
        let mut known = vec![false; links.len()];
        *known.first_mut()? = true;
        for (i, &first) in links.iter().enumerate() {
            if !known[i] {
                return None;
            }
            let first = first as usize;
            if first == 0 {
                continue;
            }
            let element = nodes[i].element;
            let fits = first > i && first % 4 == 1 && first + 4 <= links.len() && !known[first];
            if !fits || element.level >= height {
                return None;
            }
            nodes[i].children = first as u32;
            for (k, element) in element.children(shape).into_iter().enumerate() {
                nodes[first + k].element = element;
                known[first + k] = true;
            }
        }
        Some(Tree { shape, nodes })
    }

    /// The leaves, in the order of the nodes.
    pub fn leaves(&self) -> impl Iterator<Item = (u32, Element)> {
        (0..).zip(&self.nodes).filter(|(_, node)| node.children == 0).map(|(i, node)| (i, node.element))
    }

    /// Number of leaves.
    pub fn leaf_count(&self) -> usize {
        // Each split adds four nodes and makes three leaves more.
        1 + 3 * ((self.nodes.len() - 1) / 4)
    }

    /// Level of the deepest leaf.
    pub fn height(&self) -> u8 {
        self.nodes.iter().map(|node| node.element.level).max().unwrap_or(0)
    }

    /// The leaf at a point of the surface.
    pub fn leaf_at(&self, at: [f32; 2]) -> u32 {
        let mut node = 0;
        while let Some(children) = self.children(node) {
            node = children[self.element(node).part_at(self.shape, at)];
        }
        node
    }

    /// Visits the leaves depth first, with their elements.
    pub fn visit(&self, leaf: &mut impl FnMut(u32, Element)) {
        let mut open = vec![0];
        while let Some(node) = open.pop() {
            match self.children(node) {
                Some(children) => open.extend(children.iter().rev()),
                None => leaf(node, self.element(node)),
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A tree of `splits` random splits, no deeper than `height`.
    pub fn random(shape: Shape, splits: u32, height: u8, seed: u32) -> Tree {
        let mut tree = Tree::new(shape);
        let mut state = seed;
        for _ in 0..splits {
            let leaves: Vec<u32> = tree.leaves().filter(|(_, e)| e.level < height).map(|(node, _)| node).collect();
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if let Some(&node) = leaves.get((state >> 8) as usize % leaves.len().max(1)) {
                tree.split(node);
            }
        }
        tree
    }

    /// Twice the signed area of a polygon of the grid.
    fn area2(corners: &[[u32; 2]]) -> i64 {
        let cross = |a: [u32; 2], b: [u32; 2]| i64::from(a[0]) * i64::from(b[1]) - i64::from(a[1]) * i64::from(b[0]);
        (0..corners.len()).map(|i| cross(corners[i], corners[(i + 1) % corners.len()])).sum()
    }

    #[test]
    fn leaves_tile_their_root() {
        for shape in [Shape::Quad, Shape::Triangle] {
            for seed in 0..20 {
                let tree = random(shape, 40, 5, seed);
                assert_eq!(tree.leaf_count(), tree.leaves().count());
                let mut area = 0;
                for (node, element) in tree.leaves() {
                    let corners: Vec<_> = element.corners(shape, 5).collect();
                    let own = area2(&corners);
                    assert!(own > 0, "counter-clockwise as its root");
                    area += own;
                    let middle =
                        [0, 1].map(|k| corners.iter().map(|c| c[k] as f32).sum::<f32>() / corners.len() as f32 / 32.0);
                    assert_eq!(tree.leaf_at(middle), node);
                    assert_eq!(
                        own as f32 / if shape == Shape::Quad { 2048.0 } else { 1024.0 },
                        element.share(shape, [0.5; 2])
                    );
                }
                assert_eq!(area, if shape == Shape::Quad { 2048 } else { 1024 });
            }
        }
    }

    #[test]
    fn shares_follow_the_halves_of_a_quadrilateral() {
        let tree = random(Shape::Quad, 30, 4, 7);
        let halves = [0.8, 0.2];
        let sum = |wanted: fn(Element) -> bool| -> f32 {
            tree.leaves().filter(|(_, e)| wanted(*e)).map(|(_, e)| e.share(Shape::Quad, halves)).sum()
        };
        assert!((sum(|_| true) - 1.0).abs() < 1e-5);
        let right = Tree::full(Shape::Quad, 1).leaves().nth(1).unwrap().1;
        assert_eq!(right.share(Shape::Quad, halves), 0.25 * 1.6);
    }

    #[test]
    fn trees_come_back_from_their_links_and_nothing_else_does() {
        for shape in [Shape::Quad, Shape::Triangle] {
            for seed in 0..10 {
                let tree = random(shape, 1 + 4 * seed, 5, seed);
                let links: Vec<u32> = tree.links().collect();
                assert_eq!(Tree::from_links(shape, &links, 5).as_ref(), Some(&tree));
                // Nothing else is a tree.
                let height = tree.height();
                assert!(height == 0 || Tree::from_links(shape, &links, height - 1).is_none());
                for i in 0..links.len() {
                    for wrong in [1, 2, links.len() as u32, u32::MAX].into_iter().filter(|&link| link != links[i]) {
                        let mut links = links.clone();
                        links[i] = wrong;
                        assert!(Tree::from_links(shape, &links, 5).is_none(), "{i} {wrong} {links:?}");
                    }
                }
                assert!(links.len() < 2 || Tree::from_links(shape, &links[..links.len() - 1], 5).is_none());
            }
        }
        assert_eq!(Tree::from_links(Shape::Quad, &[], 5), None);
    }

    #[test]
    fn depth_first_is_the_order_of_the_children() {
        let mut tree = Tree::full(Shape::Quad, 1);
        tree.split(2);
        let mut cells = Vec::new();
        tree.visit(&mut |_, e| cells.push((e.level, e.cell)));
        let inner = [[2, 0], [3, 0], [3, 1], [2, 1]].map(|cell| (2, cell));
        assert_eq!(cells, [&[(1, [0, 0])][..], &inner, &[(1, [1, 1]), (1, [0, 1])]].concat());
        assert_eq!((tree.height(), tree.leaf_count(), Tree::full(Shape::Triangle, 3).leaf_count()), (2, 7, 64));
    }
}
