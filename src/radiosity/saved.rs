//! Trees, their samples and the round under way as bytes, little endian.
//!
//! Words of 32 bits: magic "TREE" and version; of each surface the number of nodes with their links, and the number of samples with
//! place, 1 outside of geometry, and light; the rounds; means; the round under way; then the film of its present batch.

use glam::Vec3;

use super::Light;
use super::quadtree::Tree;
use super::refine::{Round, Samples, Solution};

const MAGIC: u32 = u32::from_le_bytes(*b"TREE");
const VERSION: u32 = 1;

/// A growth without its trees.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Saved {
    /// Mean of the first round.
    pub mean: Option<f32>,
    /// The trees have grown.
    pub done: bool,
    /// Light of the round's batches that are done.
    pub found: Vec<Light>,
    /// Passes of the present batch, and its state.
    pub passes: u32,
    pub film: Vec<u8>,
}

fn words_of(light: Light) -> [u32; 6] {
    let [a, b] = [light.direct, light.indirect];
    [a.x, a.y, a.z, b.x, b.y, b.z].map(f32::to_bits)
}

/// All of it as bytes.
pub(super) fn to_bytes(solution: &Solution, now: &Saved) -> Vec<u8> {
    let mut words = vec![MAGIC, VERSION, solution.trees.len() as u32];
    for (tree, samples) in solution.trees.iter().zip(&solution.samples) {
        words.push(tree.len() as u32);
        words.extend(tree.links());
        words.push(samples.len() as u32);
        let mut sorted: Vec<_> = samples.iter().collect();
        sorted.sort_unstable_by_key(|(key, _)| **key);
        for (key, light) in sorted {
            words.extend(key);
            words.push(u32::from(light.is_some()));
            words.extend(words_of(light.unwrap_or_default()));
        }
    }
    words.push(solution.rounds.len() as u32);
    words.extend(solution.rounds.iter().flat_map(|round| [round.points as u32, round.splits as u32]));
    words.extend([solution.mean.to_bits(), u32::from(now.mean.is_some()), now.mean.unwrap_or_default().to_bits()]);
    words.extend([u32::from(now.done), now.found.len() as u32]);
    words.extend(now.found.iter().flat_map(|&light| words_of(light)));
    words.push(now.passes);
    let mut bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    bytes.extend(&now.film);
    bytes
}

/// Words that are read one after the other.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn word(&mut self) -> Option<u32> {
        let (word, rest) = self.0.split_first_chunk::<4>()?;
        self.0 = rest;
        Some(u32::from_le_bytes(*word))
    }

    fn flag(&mut self) -> Option<bool> {
        match self.word()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    /// A number of items of some words each, which must be there.
    fn count(&mut self, words: usize) -> Option<usize> {
        let count = self.word()? as usize;
        (count <= self.0.len() / (4 * words)).then_some(count)
    }

    fn number(&mut self) -> Option<f32> {
        self.word().map(f32::from_bits)
    }

    fn vector(&mut self) -> Option<Vec3> {
        Some(Vec3::new(self.number()?, self.number()?, self.number()?))
    }

    fn light(&mut self) -> Option<Light> {
        Some(Light { direct: self.vector()?, indirect: self.vector()? })
    }
}

/// Reads trees over the same surfaces with the same options as these; `None`: the bytes are something else.
pub(super) fn from_bytes(bytes: &[u8], of: &Solution) -> Option<(Solution, Saved)> {
    let mut words = Words(bytes);
    if [words.word()?, words.word()?, words.word()?] != [MAGIC, VERSION, of.trees.len() as u32] {
        return None;
    }
    let (mut trees, mut all) = (Vec::new(), Vec::new());
    for tree in &of.trees {
        let links: Vec<u32> = (0..words.count(1)?).map(|_| words.word()).collect::<Option<_>>()?;
        trees.push(Tree::from_links(tree.shape(), &links, of.options.height)?);
        let mut samples = Samples::new();
        for _ in 0..words.count(9)? {
            let key = [words.word()?, words.word()?];
            let (outside, light) = (words.flag()?, words.light()?);
            samples.insert(key, outside.then_some(light));
        }
        all.push(samples);
    }
    let round = |words: &mut Words| Some(Round { points: words.word()? as usize, splits: words.word()? as usize });
    let rounds = (0..words.count(2)?).map(|_| round(&mut words)).collect::<Option<_>>()?;
    let mean = words.number()?;
    let (told, first) = (words.flag()?, words.number()?);
    let done = words.flag()?;
    let found = (0..words.count(6)?).map(|_| words.light()).collect::<Option<_>>()?;
    let passes = words.word()?;
    let solution = Solution { trees, samples: all, rounds, mean, options: of.options };
    Some((solution, Saved { mean: told.then_some(first), done, found, passes, film: words.0.to_vec() }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::quadtree::Shape;
    use crate::radiosity::refine::{Options, Root};

    fn under_way() -> (Vec<Root>, Solution, Saved) {
        let roots = [Shape::Quad, Shape::Triangle].map(|shape| Root { shape, area: 1.0, halves: [0.5; 2] }).to_vec();
        let options = Options { start: 8, epsilon: 0.01, ..Options::default() };
        let mut solution = Solution::new(&roots, &options).unwrap();
        for _ in 0..3 {
            let wanted = solution.wanted();
            let points = solution.points_of(&wanted);
            let light = |k: f32| Light { direct: Vec3::new(k, 1.0, 2.0), indirect: Vec3::splat(-0.0) };
            let found = points.iter().map(|p| (p.at[0] < 0.8).then(|| light(p.at[0] * p.at[1]))).collect();
            assert!(solution.round(&roots, &wanted, found).unwrap() > 0);
        }
        let found = vec![Light { direct: Vec3::X, indirect: Vec3::Y }; 3];
        (roots, solution, Saved { mean: Some(0.3), done: false, found, passes: 7, film: vec![1, 2, 3] })
    }

    #[test]
    fn trees_under_way_come_back() {
        let (roots, solution, now) = under_way();
        let fresh = Solution::new(&roots, solution.options()).unwrap();
        let bytes = to_bytes(&solution, &now);
        assert_eq!(from_bytes(&bytes, &fresh), Some((solution.clone(), now)));
        let early = Saved::default();
        assert_eq!(from_bytes(&to_bytes(&fresh, &early), &fresh), Some((fresh.clone(), early)));
        assert_eq!(bytes, to_bytes(&solution, &under_way().2), "the same bytes");
    }

    #[test]
    fn other_bytes_are_refused() {
        let (roots, solution, now) = under_way();
        let fresh = Solution::new(&roots, solution.options()).unwrap();
        let bytes = to_bytes(&solution, &now);
        for length in (0..bytes.len() - 3).step_by(7) {
            assert!(from_bytes(&bytes[..length], &fresh).is_none(), "{length}");
        }
        for (place, value) in [(0, 0), (4, 9), (8, 3), (12, u32::MAX), (16, 2)] {
            let mut wrong = bytes.clone();
            wrong[place..place + 4].copy_from_slice(&value.to_le_bytes());
            assert!(from_bytes(&wrong, &fresh).is_none(), "{place}");
        }
        let other = Solution::new(&roots[..1], solution.options()).unwrap();
        assert!(from_bytes(&bytes, &other).is_none());
    }
}
