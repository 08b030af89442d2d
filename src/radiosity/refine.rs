//! Adaptive sampling of light on surfaces (Bastos 1999, 5.3): quadtrees grown in rounds, where light changes.
//!
//! Each round lights the points that the leaves need and have not got, all at once, then splits leaves, the worst first, up to a
//! greatest height and a greatest number of elements. The author gives no threshold; here a leaf is split where light differs from what
//! the leaf says by more than epsilon times the mean light of all surfaces.
//!
//! - **Order one**: light at the corners of leaves. The trial samples of a leaf are the vertices that its split would add, the middles
//!   of its edges and of itself, against their interpolation from its corners; and vertices of smaller neighbours on its edges, so that
//!   neighbours which differ are split.
//! - **Order zero**: light at the centres of leaves. The trial samples are the centres of the four parts, against the leaf's own; and the
//!   centres of neighbours that are not smaller.
//!
//! Samples miss light that changes between them alone. So each surface begins with several elements, in proportion to its area;
//! all surfaces together have [`Options::start`].

use std::collections::{HashMap, HashSet};

use glam::Vec3;
use rayon::prelude::*;

use super::Light;
use super::quadtree::{Element, Shape, Tree};
use crate::error::{Error, Result};

/// Subdivision of the finest cell in which all points have whole coordinates: corners, centres of cells and of halves of them.
const FINE: u32 = 12;

/// The samples that leaves have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Order {
    /// At their centres; constant on an element.
    Zero,
    /// At their corners; bilinear on an element.
    #[default]
    First,
}

/// Options of the refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Greatest difference that is not split, as a part of the mean irradiance of all surfaces. Default 0.05; above 0.
    pub epsilon: f32,
    /// Greatest level of a leaf. Default 6; 1 to [`Options::MAX_HEIGHT`].
    pub height: u8,
    /// Greatest number of leaves of all surfaces. Default 65,536; at least the number of surfaces, at most 2^22.
    pub elements: usize,
    /// Leaves before the first round, unless there are more surfaces. Default 1024.
    pub start: usize,
    /// The samples of leaves. Default order one.
    pub order: Order,
}

impl Options {
    /// Greatest height: 1025 x 1025 vertices.
    pub const MAX_HEIGHT: u8 = 10;
    /// Greatest number of leaves.
    pub const MAX_ELEMENTS: usize = 1 << 22;

    /// Errors: a value out of range.
    pub fn validate(&self) -> Result<()> {
        let setting = |name, message| Err(Error::Setting { name, message });
        if !(self.epsilon.is_finite() && self.epsilon > 0.0) {
            return setting("--adaptive", format!("{} is not a part of the mean light above 0", self.epsilon));
        }
        if !(1..=Options::MAX_HEIGHT).contains(&self.height) {
            return setting("--height", format!("{} is not in 1..={}", self.height, Options::MAX_HEIGHT));
        }
        if !(1..=Options::MAX_ELEMENTS).contains(&self.elements) {
            return setting("--elements", format!("{} is not in 1..={}", self.elements, Options::MAX_ELEMENTS));
        }
        Ok(())
    }
}

impl Default for Options {
    fn default() -> Self {
        Options { epsilon: 0.05, height: 6, elements: 1 << 16, start: 1024, order: Order::First }
    }
}

/// A surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Root {
    /// Its shape.
    pub shape: Shape,
    /// Its area.
    pub area: f32,
    /// Shares of its area where s >= t and where s < t, for a quadrilateral.
    pub halves: [f32; 2],
}

/// A point to be lit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Index of the surface.
    pub root: u32,
    /// Its coordinates (s, t) there.
    pub at: [f32; 2],
}

/// A round, as it was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Round {
    /// Points that were lit.
    pub points: usize,
    /// Leaves that were split then.
    pub splits: usize,
}

/// Samples by their place; `None`: inside of geometry.
pub(super) type Samples = HashMap<[u32; 2], Option<Light>>;

/// Place of a sample: index of the surface, and whole coordinates there.
pub type Place = (u32, [u32; 2]);

/// Lights points of surfaces; `None`: a point inside of geometry.
pub type Lit<'a> = dyn FnMut(&[Point]) -> Result<Vec<Option<Light>>> + 'a;

/// Trees with their samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The tree of each surface.
    pub trees: Vec<Tree>,
    pub(super) samples: Vec<Samples>,
    /// The rounds.
    pub rounds: Vec<Round>,
    /// Mean irradiance of all surfaces, of the mean of the channels.
    pub mean: f32,
    pub(super) options: Options,
}

/// Grows trees. `light` gives the light of points, `None` inside of geometry, and is called once a round.
///
/// Deterministic. Errors: options out of range, more surfaces than elements; those of `light`.
pub fn refine(roots: &[Root], options: &Options, light: &mut Lit) -> Result<Solution> {
    let mut solution = Solution::new(roots, options)?;
    loop {
        let wanted = solution.wanted();
        let found = if wanted.is_empty() { Vec::new() } else { light(&solution.points_of(&wanted))? };
        if solution.round(roots, &wanted, found)? == 0 {
            return Ok(solution);
        }
    }
}

impl Solution {
    /// The trees before the first round. Errors: options out of range, more surfaces than elements.
    pub fn new(roots: &[Root], options: &Options) -> Result<Solution> {
        options.validate()?;
        if roots.len() > options.elements {
            let message = format!("{} is less than the number of surfaces, {}", options.elements, roots.len());
            return Err(Error::Setting { name: "--elements", message });
        }
        let mut solution = Solution {
            trees: roots.iter().map(|root| Tree::new(root.shape)).collect(),
            samples: vec![Samples::new(); roots.len()],
            rounds: Vec::new(),
            mean: 0.0,
            options: *options,
        };
        solution.start(roots);
        Ok(solution)
    }

    /// Splits large surfaces into elements of alike area.
    fn start(&mut self, roots: &[Root]) {
        let total: f32 = roots.iter().map(|root| root.area).sum();
        let mut room = self.options.elements - roots.len();
        for (root, tree) in roots.iter().zip(&mut self.trees) {
            let share = root.area / total.max(f32::MIN_POSITIVE) * self.options.start as f32;
            // The nearest power of four.
            let level = (0.5 * share.max(1.0).log2()).round().min(f32::from(self.options.height)) as u8;
            let more = (1usize << (2 * level)) - 1;
            if more <= room {
                room -= more;
                *tree = Tree::full(root.shape, level);
            }
        }
    }

    /// The samples that leaves lack, by surface and along its tree.
    pub fn wanted(&self) -> Vec<Place> {
        let of_root = |(root, (tree, samples)): (usize, (&Tree, &Samples))| {
            let (mut new, mut places) = (HashSet::new(), Vec::new());
            tree.visit(&mut |_, element| {
                let keys = needed(&self.options, tree.shape(), element);
                let lacking = keys.into_iter().filter(|key| !samples.contains_key(key) && new.insert(*key));
                places.extend(lacking.map(|key| (root as u32, key)));
            });
            places
        };
        let places: Vec<Vec<Place>> = self.trees.par_iter().zip(&self.samples).enumerate().map(of_root).collect();
        places.concat()
    }

    /// The points of places.
    pub fn points_of(&self, places: &[Place]) -> Vec<Point> {
        let scale = 1.0 / (FINE << self.options.height) as f32;
        places.iter().map(|&(root, key)| Point { root, at: key.map(|n| n as f32 * scale) }).collect()
    }

    /// Ends a round: takes the light of the samples that leaves lacked, and splits leaves; returns their number.
    ///
    /// Errors: not the light of each place.
    pub fn round(&mut self, roots: &[Root], places: &[Place], found: Vec<Option<Light>>) -> Result<usize> {
        if found.len() != places.len() {
            let message = format!("light at {} points where {} were asked for", found.len(), places.len());
            return Err(Error::Resource { name: String::from("radiosity"), message });
        }
        self.set(places.iter().copied().zip(found));
        self.mean = self.mean(roots);
        let splits = self.split(roots);
        self.rounds.push(Round { points: places.len(), splits });
        Ok(splits)
    }

    /// Sets the light of samples.
    pub fn set(&mut self, samples: impl IntoIterator<Item = (Place, Option<Light>)>) {
        for ((root, key), light) in samples {
            self.samples[root as usize].insert(key, light);
        }
    }

    /// The samples outside of geometry, surface by surface and near each other.
    pub fn lit(&self) -> Vec<Place> {
        let mut all = Vec::with_capacity(self.points());
        for (root, samples) in (0..).zip(&self.samples) {
            all.extend(samples.iter().filter(|(_, light)| light.is_some()).map(|(&key, _)| (root, key)));
        }
        all.sort_unstable_by_key(|&(root, key)| (root, along_curve(key)));
        all
    }

    /// Light of a sample; black inside of geometry.
    pub fn at(&self, (root, key): Place) -> Light {
        self.sample(root as usize, key)
    }

    /// Light at a place; black inside of geometry.
    fn sample(&self, root: usize, key: [u32; 2]) -> Light {
        self.samples[root].get(&key).copied().flatten().unwrap_or_default()
    }

    /// Light of a leaf: its own sample, or the mean of its corners.
    pub fn leaf(&self, root: usize, element: Element) -> Light {
        let shape = self.trees[root].shape();
        match self.options.order {
            Order::Zero => self.sample(root, centre(shape, element, self.options.height)),
            Order::First => {
                let corners = element.corners(shape, self.options.height);
                let share = 1.0 / corners.len() as f32;
                corners.fold(Light::default(), |sum, at| sum + self.sample(root, at.map(|n| n * FINE)) * share)
            }
        }
    }

    /// Light at a vertex of the grid of 2^height cells a side, if it was sampled; `Some(None)`: inside of geometry.
    pub fn vertex(&self, root: usize, at: [u32; 2], height: u8) -> Option<Option<Light>> {
        let key = at.map(|n| (n << (self.options.height - height)) * FINE);
        self.samples[root].get(&key).copied()
    }

    /// Number of leaves of all trees.
    pub fn elements(&self) -> usize {
        self.trees.iter().map(Tree::leaf_count).sum()
    }

    /// Number of samples of all trees.
    pub fn points(&self) -> usize {
        self.samples.iter().map(Samples::len).sum()
    }

    /// Number of samples inside of geometry.
    pub fn inside(&self) -> usize {
        self.samples.iter().flat_map(Samples::values).filter(|light| light.is_none()).count()
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Mean light of a surface by area.
    pub fn mean_of(&self, root: usize, halves: [f32; 2]) -> Light {
        let tree = &self.trees[root];
        tree.leaves().fold(Light::default(), |sum, (_, e)| sum + self.leaf(root, e) * e.share(tree.shape(), halves))
    }

    fn mean(&self, roots: &[Root]) -> f32 {
        let lights: Vec<Light> = roots.par_iter().enumerate().map(|(i, root)| self.mean_of(i, root.halves)).collect();
        let (mut sum, mut area) = (0.0, 0.0);
        for (root, light) in roots.iter().zip(lights) {
            sum += f64::from(light.total().element_sum() / 3.0) * f64::from(root.area);
            area += f64::from(root.area);
        }
        (sum / area.max(f64::MIN_POSITIVE)) as f32
    }

    /// Splits leaves that do not tell their light; returns their number.
    fn split(&mut self, roots: &[Root]) -> usize {
        let threshold = self.options.epsilon * self.mean;
        let of_root = |(i, (root, tree)): (usize, (&Root, &Tree))| {
            let mut found = Vec::new();
            for (node, element) in tree.leaves().filter(|(_, e)| e.level < self.options.height) {
                let error = self.error(i, node, element);
                if error > threshold {
                    let area = root.area * element.share(root.shape, root.halves);
                    found.push((error * area.sqrt(), i, node));
                }
            }
            found
        };
        let found: Vec<Vec<_>> = roots.par_iter().zip(&self.trees).enumerate().map(of_root).collect();
        let mut found = found.concat();
        let room = (self.options.elements - self.elements()) / 3;
        if found.len() > room {
            found.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
            found.truncate(room);
        }
        found.iter().for_each(|&(_, root, node)| self.trees[root].split(node));
        found.len()
    }

    /// Greatest difference between a leaf and what is known of the light on it.
    fn error(&self, root: usize, node: u32, element: Element) -> f32 {
        let (tree, height) = (&self.trees[root], self.options.height);
        let shape = tree.shape();
        match self.options.order {
            Order::Zero => {
                let own = self.leaf(root, element);
                let parts = element.children(shape).map(|part| self.sample(root, centre(shape, part, height)));
                let of_parts = parts.into_iter().map(|light| (light - own).size()).fold(0.0, f32::max);
                let near = neighbours(tree, node).into_iter().filter(|e| e.level <= element.level);
                near.map(|e| (self.leaf(root, e) - own).size()).fold(of_parts, f32::max)
            }
            Order::First => {
                let corners: Vec<[u32; 2]> = element.corners(shape, height).map(|at| at.map(|n| n * FINE)).collect();
                let values: Vec<Light> = corners.iter().map(|&key| self.sample(root, key)).collect();
                let mut error = 0.0f32;
                for k in 0..corners.len() {
                    let next = (k + 1) % corners.len();
                    for quarter in 1..4 {
                        let key = [0, 1].map(|x| ((4 - quarter) * corners[k][x] + quarter * corners[next][x]) / 4);
                        // Quarters are there where a neighbour is smaller.
                        if let Some(light) = self.samples[root].get(&key) {
                            let t = quarter as f32 / 4.0;
                            let between = values[k] * (1.0 - t) + values[next] * t;
                            error = error.max((light.unwrap_or_default() - between).size());
                        }
                    }
                }
                if shape == Shape::Quad {
                    let between = values.iter().fold(Light::default(), |sum, v| sum + *v * 0.25);
                    error = error.max((self.sample(root, centre(shape, element, height)) - between).size());
                }
                error
            }
        }
    }
}

impl Light {
    /// Greatest difference of a channel, for a difference of two.
    fn size(self) -> f32 {
        self.total().abs().max_element()
    }

    /// Direct and indirect light.
    pub fn total(self) -> Vec3 {
        self.direct + self.indirect
    }
}

/// Place along a curve that visits quarters one after the other (Morton).
fn along_curve([x, y]: [u32; 2]) -> u64 {
    let spread = |n: u32| (0..16).fold(0, |sum, bit| sum | u64::from(n >> bit & 1) << (2 * bit));
    spread(x) | spread(y) << 1
}

/// Place of the centre of an element in a tree of a greatest height.
fn centre(shape: Shape, element: Element, height: u8) -> [u32; 2] {
    let corners = element.corners(shape, height);
    let n = corners.len() as u32;
    corners.fold([0, 0], |sum, at| [0, 1].map(|k| sum[k] + at[k] * FINE)).map(|sum| sum / n)
}

/// Places of the samples of a leaf, and of its trial samples unless it has the greatest level.
fn needed(options: &Options, shape: Shape, element: Element) -> Vec<[u32; 2]> {
    let (height, tried) = (options.height, element.level < options.height);
    match options.order {
        Order::Zero => {
            let parts = element.children(shape).into_iter().filter(|_| tried);
            [element].into_iter().chain(parts).map(|e| centre(shape, e, height)).collect()
        }
        Order::First => {
            let corners: Vec<[u32; 2]> = element.corners(shape, height).map(|at| at.map(|n| n * FINE)).collect();
            let mut all = corners.clone();
            if tried {
                for k in 0..corners.len() {
                    let next = corners[(k + 1) % corners.len()];
                    all.push([0, 1].map(|x| (corners[k][x] + next[x]) / 2));
                }
                if shape == Shape::Quad {
                    all.push(centre(shape, element, height));
                }
            }
            all
        }
    }
}

/// The leaves across the edges of a leaf, at two places of each edge.
fn neighbours(tree: &Tree, node: u32) -> Vec<Element> {
    let element = tree.element(node);
    let scale = (-f32::from(element.level)).exp2();
    let corners: Vec<[f32; 2]> = element.corners(tree.shape(), element.level).map(|at| at.map(|n| n as f32)).collect();
    let middle = [0, 1].map(|k| corners.iter().map(|c| c[k]).sum::<f32>() / corners.len() as f32);
    let mut found = Vec::new();
    for (k, a) in corners.iter().enumerate() {
        let b = corners[(k + 1) % corners.len()];
        for t in [0.25, 0.75] {
            let on_edge = [0, 1].map(|x| a[x] + t * (b[x] - a[x]));
            let at = [0, 1].map(|x| (on_edge[x] + 0.01 * (on_edge[x] - middle[x])) * scale);
            let outside = at.iter().any(|x| !(0.0..=1.0).contains(x));
            if !(outside || tree.shape() == Shape::Triangle && at[0] + at[1] > 1.0) {
                found.push(tree.element(tree.leaf_at(at)));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root(shape: Shape) -> Root {
        Root { shape, area: 1.0, halves: [0.5; 2] }
    }

    fn grown(shape: Shape, options: &Options, f: impl Fn([f32; 2]) -> f32) -> Solution {
        let mut light = |points: &[Point]| {
            Ok(points.iter().map(|p| Some(Light { direct: Vec3::splat(f(p.at)), indirect: Vec3::ZERO })).collect())
        };
        refine(&[root(shape)], options, &mut light).unwrap()
    }

    /// A shadow edge on a gentle slope.
    fn edge(at: [f32; 2]) -> f32 {
        let d = ((at[0] - 0.31).powi(2) + (at[1] - 0.27).powi(2)).sqrt() - 0.2;
        0.5 + 0.2 * at[0] + 0.5 * (d / 0.02).clamp(-1.0, 1.0)
    }

    #[test]
    fn constants_and_what_is_bilinear_are_not_split() {
        for shape in [Shape::Quad, Shape::Triangle] {
            for order in [Order::Zero, Order::First] {
                let options = Options { start: 4, order, ..Options::default() };
                let flat = grown(shape, &options, |_| 2.0);
                assert_eq!((flat.elements(), flat.rounds.len(), flat.mean), (4, 1, 2.0), "{shape:?} {order:?}");
                let sloped = grown(shape, &options, |[s, t]| 1.0 + s + 2.0 * t);
                assert_eq!(sloped.elements() == 4, order == Order::First);
            }
        }
    }

    #[test]
    fn trees_deepen_at_edges_within_their_bounds() {
        for shape in [Shape::Quad, Shape::Triangle] {
            for order in [Order::Zero, Order::First] {
                let options = Options { start: 16, order, height: 7, ..Options::default() };
                let fine = grown(shape, &options, edge);
                assert_eq!(fine.trees[0].height(), 7);
                let corner = fine.trees[0].element(fine.trees[0].leaf_at([0.02, 0.95]));
                assert!(corner.level <= if order == Order::First { 3 } else { 5 }, "{corner:?}");
                assert!(fine.elements() < 1 << 13, "{}", fine.elements());
                assert_eq!(fine.rounds.last().unwrap().splits, 0);
                assert_eq!(fine.rounds.iter().map(|r| r.points).sum::<usize>(), fine.points());
                let few = grown(shape, &Options { elements: 100, ..options }, edge);
                assert!((98..=100).contains(&few.elements()), "{}", few.elements());
                assert_eq!(few, grown(shape, &Options { elements: 100, ..options }, edge), "deterministic");
            }
        }
    }

    #[test]
    fn the_mean_of_leaves_is_that_of_their_parent() {
        // A bilinear field has the mean of its corners, whatever the leaves.
        let f = |[s, t]: [f32; 2]| 2.0 + 0.1 * (s - t);
        let options = Options { start: 4, ..Options::default() };
        let mut solution = grown(Shape::Quad, &options, f);
        for node in [1, 6, 12] {
            solution.trees[0].split(node);
            let wanted = solution.wanted();
            let of = |p: &Point| Some(Light { direct: Vec3::splat(f(p.at)), indirect: Vec3::ZERO });
            let found: Vec<Option<Light>> = solution.points_of(&wanted).iter().map(of).collect();
            solution.set(wanted.into_iter().zip(found));
            let tree = &solution.trees[0];
            for parent in 0..tree.len() as u32 {
                let Some(children) = tree.children(parent) else { continue };
                let own = solution.leaf(0, tree.element(parent)).direct.x;
                let share =
                    |e: Element| e.share(Shape::Quad, [0.5; 2]) / tree.element(parent).share(Shape::Quad, [0.5; 2]);
                let of: f32 =
                    children.iter().map(|&c| share(tree.element(c)) * solution.leaf(0, tree.element(c)).direct.x).sum();
                assert!((own - of).abs() < 1e-6, "{own} {of}");
            }
            assert!((solution.mean_of(0, [0.5; 2]).direct.x - 2.0).abs() < 1e-6);
        }
    }

    #[test]
    fn adaptive_leaves_are_fewer_than_uniform_ones_at_equal_error() {
        let rms = |solution: &Solution| {
            let mut sum = 0.0;
            const N: u32 = 256;
            for i in 0..N * N {
                let at = [i % N, i / N].map(|n| (n as f32 + 0.5) / N as f32);
                let tree = &solution.trees[0];
                let e = tree.element(tree.leaf_at(at));
                let corners: Vec<f32> =
                    e.corners(Shape::Quad, 7).map(|c| solution.vertex(0, c, 7).flatten().unwrap().direct.x).collect();
                let [x, y] = [0, 1].map(|k| at[k] * f32::from(e.level).exp2() - e.cell[k] as f32);
                let [low, high] = [corners[0] * (1.0 - x) + corners[1] * x, corners[3] * (1.0 - x) + corners[2] * x];
                sum += (low * (1.0 - y) + high * y - edge(at)).powi(2);
            }
            (sum / (N * N) as f32).sqrt()
        };
        let options = Options { height: 7, start: 16, epsilon: 0.02, ..Options::default() };
        let adaptive = grown(Shape::Quad, &options, edge);
        // Nothing is worth a split, so all leaves stay at the start.
        let uniform = grown(Shape::Quad, &Options { start: 1 << 14, epsilon: 1e9, ..options }, edge);
        let [a, u] = [rms(&adaptive), rms(&uniform)];
        assert_eq!(uniform.elements(), 1 << 14);
        assert!(a < 1.1 * u && 4 * adaptive.elements() < uniform.elements(), "{a} {u} {}", adaptive.elements());
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let refused = |options: Options| options.validate().unwrap_err().to_string();
        assert!(refused(Options { epsilon: 0.0, ..Options::default() }).contains("--adaptive"));
        assert!(refused(Options { epsilon: f32::NAN, ..Options::default() }).contains("--adaptive"));
        assert!(refused(Options { height: 11, ..Options::default() }).contains("--height"));
        assert!(refused(Options { elements: 0, ..Options::default() }).contains("--elements"));
        let two = [root(Shape::Quad); 2];
        let options = Options { elements: 1, ..Options::default() };
        let error = refine(&two, &options, &mut |_| Ok(Vec::new())).unwrap_err().to_string();
        assert!(error.contains("number of surfaces, 2"), "{error}");
    }
}
