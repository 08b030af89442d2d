//! Sets of passes by their numbers.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Numbers of passes, from 0, as runs `[first, end)` in ascending order that do not touch.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Vec<[u32; 2]>")]
pub struct Passes(Vec<[u32; 2]>);

impl From<Vec<[u32; 2]>> for Passes {
    fn from(mut runs: Vec<[u32; 2]>) -> Passes {
        runs.retain(|[first, end]| first < end);
        runs.sort_unstable();
        let mut joined: Vec<[u32; 2]> = Vec::with_capacity(runs.len());
        for [first, end] in runs {
            match joined.last_mut() {
                Some(last) if first <= last[1] => last[1] = last[1].max(end),
                _ => joined.push([first, end]),
            }
        }
        Passes(joined)
    }
}

impl FromIterator<u32> for Passes {
    fn from_iter<I: IntoIterator<Item = u32>>(numbers: I) -> Passes {
        let runs: Vec<[u32; 2]> = numbers.into_iter().map(|number| [number, number.saturating_add(1)]).collect();
        runs.into()
    }
}

impl Passes {
    /// How many there are.
    pub fn count(&self) -> u64 {
        self.0.iter().map(|[first, end]| u64::from(end - first)).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// One more than the greatest of them; 0 if there are none.
    pub fn end(&self) -> u32 {
        self.0.last().map_or(0, |[_, end]| *end)
    }

    /// Whether a number is among them.
    pub fn has(&self, number: u32) -> bool {
        let after = self.0.partition_point(|[first, _]| *first <= number);
        after > 0 && number < self.0[after - 1][1]
    }

    /// Adds a number.
    pub fn add(&mut self, number: u32) {
        *self = self.with(&Passes::from_iter([number]));
    }

    /// These and others.
    pub fn with(&self, other: &Passes) -> Passes {
        [self.0.as_slice(), &other.0].concat().into()
    }

    /// Those that are also among others.
    pub fn shared_with(&self, other: &Passes) -> Passes {
        let (mut shared, mut i, mut j) = (Vec::new(), 0, 0);
        while let (Some(&[a, end_a]), Some(&[b, end_b])) = (self.0.get(i), other.0.get(j)) {
            shared.push([a.max(b), end_a.min(end_b)]);
            if end_a < end_b { i += 1 } else { j += 1 }
        }
        shared.into()
    }

    /// The numbers below `end` that are not among them.
    pub fn missing_below(&self, end: u32) -> Passes {
        let starts = [0].into_iter().chain(self.0.iter().map(|[_, end]| *end));
        let ends = self.0.iter().map(|[first, _]| (*first).min(end)).chain([end]);
        starts.zip(ends).map(|(start, end)| [start, end]).collect::<Vec<_>>().into()
    }

    /// All of them in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = u32> {
        self.0.iter().flat_map(|[first, end]| *first..*end)
    }
}

impl fmt::Display for Passes {
    /// As in "0 to 7, 9 and 12"; the middle of a long list is left out.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        const SHOWN: usize = 8;
        let word = |[first, end]: &[u32; 2]| match end - first {
            1 => first.to_string(),
            _ => format!("{first} to {}", end - 1),
        };
        let mut words: Vec<String> = self.0.iter().map(word).collect();
        if words.len() > SHOWN {
            words.splice(SHOWN - 2..words.len() - 1, [String::from("...")]);
        }
        let last = words.pop().unwrap_or_else(|| String::from("none"));
        match words.is_empty() {
            true => write!(f, "{last}"),
            false => write!(f, "{} and {last}", words.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    use crate::sampling::random::{hash, key};

    fn set(seed: u32) -> BTreeSet<u32> {
        let chosen = |i: &u32| hash(key(seed, *i, 0, 0)).is_multiple_of(1 + seed % 4);
        (0..40).filter(chosen).collect()
    }

    #[test]
    fn they_behave_as_sets() {
        for seed in 0..60 {
            let (a, b) = (set(seed), set(seed + 1));
            let [x, y] = [&a, &b].map(|numbers| numbers.iter().rev().copied().collect::<Passes>());
            let of = |numbers: BTreeSet<u32>| numbers.into_iter().collect::<Passes>();
            assert_eq!(x.iter().collect::<BTreeSet<_>>(), a);
            assert_eq!(x.count(), a.len() as u64);
            assert_eq!(x.with(&y), of(&a | &b));
            assert_eq!(x.shared_with(&y), of(&a & &b));
            assert_eq!(x.missing_below(30), of(&(0..30).collect::<BTreeSet<u32>>() - &a));
            assert_eq!(x.end(), a.last().map_or(0, |last| last + 1));
            assert!((0..50).all(|n| x.has(n) == a.contains(&n)));
            let mut added = x.clone();
            b.iter().for_each(|&n| added.add(n));
            assert_eq!(added, x.with(&y));
        }
    }

    #[test]
    fn files_may_hold_runs_in_any_form() {
        let read = |text: &str| serde_json::from_str::<Passes>(text).unwrap();
        assert_eq!(read("[[4,6],[0,2],[2,3],[9,9],[5,5]]"), read("[[0,3],[4,6]]"));
        assert_eq!(serde_json::to_string(&read("[[0,3],[4,6]]")).unwrap(), "[[0,3],[4,6]]");
        assert_eq!(read("[[7,2]]").count(), 0);
    }

    #[test]
    fn they_read_well() {
        let text = |numbers: &[u32]| numbers.iter().copied().collect::<Passes>().to_string();
        assert_eq!(text(&[]), "none");
        assert_eq!(text(&[3]), "3");
        assert_eq!(text(&[0, 1, 2, 5]), "0 to 2 and 5");
        let odd: Vec<u32> = (0..40).filter(|n| n % 2 == 1).collect();
        assert_eq!(text(&odd), "1, 3, 5, 7, 9, 11, ... and 39");
    }
}
