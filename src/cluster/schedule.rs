//! Which rank renders which pass, and when it hands over its film.
//!
//! Each rank asks for a task when it has none, so that a slow one delays nothing else. Passes are given out in ascending order; those of a
//! rank that is lost are given out again. A pass that is left out is replaced by the next number, so that the passes of the film are those
//! that a single process would have rendered, however many ranks there are.

use std::collections::BTreeSet;

use super::Passes;

/// The next task of a rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// Render the pass of this number.
    Pass(u32),
    /// Hand over the film of the passes since the last time, and begin another.
    Deliver,
    /// Wait: the passes of others may be left out or lost.
    Wait,
    /// Nothing is left.
    End,
}

/// The state of a rank.
#[derive(Clone, Debug, Default)]
struct Rank {
    running: Option<u32>,
    /// Rendered and not handed over.
    kept: Passes,
    left_out: Passes,
    delivers: bool,
    lost: bool,
}

impl Rank {
    fn has_film(&self) -> bool {
        !self.kept.is_empty() || !self.left_out.is_empty()
    }
}

/// The passes of a rendering on several ranks.
#[derive(Clone, Debug)]
pub struct Schedule {
    ranks: Vec<Rank>,
    /// Passes that the film shall have; `None`: as many as there is time for.
    asked: Option<u32>,
    /// Passes that were handed over.
    kept: Passes,
    left_out: Passes,
    /// Those of lost ranks.
    again: BTreeSet<u32>,
    next: u32,
    stopped: bool,
}

impl Schedule {
    /// For `ranks` ranks. `asked`: passes that the film shall have, with those that it has, `kept`; `left_out`: those that were rendered
    /// and left out.
    pub fn new(ranks: usize, asked: Option<u32>, kept: Passes, left_out: Passes) -> Schedule {
        let ranks = vec![Rank::default(); ranks];
        Schedule { ranks, asked, kept, left_out, again: BTreeSet::new(), next: 0, stopped: false }
    }

    /// The task of a rank that has none.
    pub fn next(&mut self, rank: usize) -> Task {
        let waits = self.ranks[rank].delivers && self.ranks[rank].has_film();
        if !waits && let Some(number) = self.number() {
            self.ranks[rank].running = Some(number);
            return Task::Pass(number);
        }
        // Passes of other ranks may be lost, or left out.
        let others = self.ranks.iter().any(|rank| rank.running.is_some() || rank.has_film());
        match () {
            () if self.ranks[rank].has_film() => Task::Deliver,
            () if others && !self.stopped => Task::Wait,
            () => Task::End,
        }
    }

    /// The pass that is to be rendered next, if one is missing.
    fn number(&mut self) -> Option<u32> {
        if self.stopped {
            return None;
        }
        if let Some(number) = self.again.pop_first() {
            return Some(number);
        }
        let expected = |rank: &Rank| rank.kept.count() + u64::from(rank.running.is_some());
        let expected = self.kept.count() + self.ranks.iter().map(expected).sum::<u64>();
        if self.asked.is_some_and(|asked| expected >= u64::from(asked)) {
            return None;
        }
        while self.kept.has(self.next) || self.left_out.has(self.next) {
            self.next += 1;
        }
        self.next += 1;
        Some(self.next - 1)
    }

    /// Notes that a rank has rendered its pass, which is in its film, or was left out.
    pub fn rendered(&mut self, rank: usize, kept: bool) {
        let rank = &mut self.ranks[rank];
        if let Some(number) = rank.running.take() {
            if kept { rank.kept.add(number) } else { rank.left_out.add(number) }
        }
    }

    /// Notes that a rank has handed over its film; returns the passes in it and those that were left out.
    pub fn delivered(&mut self, rank: usize) -> (Passes, Passes) {
        let rank = &mut self.ranks[rank];
        let (kept, left_out) = (std::mem::take(&mut rank.kept), std::mem::take(&mut rank.left_out));
        rank.delivers = false;
        self.kept = self.kept.with(&kept);
        self.left_out = self.left_out.with(&left_out);
        (kept, left_out)
    }

    /// Notes that a rank is lost; returns the number of its passes that are rendered again.
    pub fn lost(&mut self, rank: usize) -> u64 {
        let rank = &mut self.ranks[rank];
        let before = self.again.len();
        self.again.extend(rank.running.take());
        self.again.extend(rank.kept.iter());
        // Whether a pass is left out does not depend on who renders it.
        self.left_out = self.left_out.with(&rank.left_out);
        *rank = Rank { lost: true, ..Rank::default() };
        (self.again.len() - before) as u64
    }

    /// Gives out no more passes.
    pub fn stop(&mut self) {
        self.stopped = true;
    }

    /// Has every rank with a film hand it over before its next pass.
    pub fn collect(&mut self) {
        self.ranks.iter_mut().for_each(|rank| rank.delivers = rank.has_film() || rank.running.is_some());
    }

    /// Whether the films that [`Schedule::collect`] asked for are here.
    pub fn is_collected(&self) -> bool {
        self.ranks.iter().all(|rank| !rank.delivers)
    }

    /// Passes that were rendered and not lost, handed over or not.
    pub fn rendered_count(&self) -> u64 {
        self.kept.count() + self.ranks.iter().map(|rank| rank.kept.count()).sum::<u64>()
    }

    /// Whether no rank is left.
    pub fn is_deserted(&self) -> bool {
        self.ranks.iter().all(|rank| rank.lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::{key, random_f32};

    /// Runs ranks of random speeds until nothing is left, and checks that every pass counts once. `is_bad`: whether a pass is left out.
    fn run(seed: u32, ranks: usize, asked: u32, is_bad: &dyn Fn(u32) -> bool) -> (Passes, Passes) {
        let random = |i: u32, n: usize| (random_f32(key(seed, i, 5, 2)) * n as f32) as usize;
        let mut schedule = Schedule::new(ranks, Some(asked), Passes::default(), Passes::default());
        let mut busy: Vec<Option<u32>> = vec![None; ranks];
        let mut alive: Vec<usize> = (0..ranks).collect();
        let (mut kept, mut left_out) = (Passes::default(), Passes::default());
        for step in 0..100_000 {
            let rank = alive[random(2 * step, alive.len())];
            if let Some(number) = busy[rank].take() {
                schedule.rendered(rank, !is_bad(number));
                continue;
            }
            match schedule.next(rank) {
                Task::Pass(number) => busy[rank] = Some(number),
                Task::Deliver => {
                    let (new, bad) = schedule.delivered(rank);
                    assert!(kept.shared_with(&new).is_empty(), "a pass counts twice");
                    (kept, left_out) = (kept.with(&new), left_out.with(&bad));
                }
                Task::Wait => {}
                Task::End => {
                    // All that rest end too, perhaps after they have handed over.
                    alive.retain(|&other| other != rank);
                }
            }
            match random(2 * step + 1, 40) {
                0 if alive.len() > 1 && ranks > 2 => {
                    let lost = alive.remove(0);
                    busy[lost] = None;
                    schedule.lost(lost);
                }
                1 => schedule.collect(),
                _ => {}
            }
            if alive.is_empty() {
                assert!(schedule.is_collected());
                return (kept, left_out);
            }
        }
        panic!("it does not end");
    }

    #[test]
    fn any_number_of_ranks_renders_the_passes_of_one() {
        for seed in 0..80 {
            let ranks = 1 + seed as usize % 6;
            let asked = 1 + seed * 7 % 23;
            // A single process replaces what is left out by the numbers that follow.
            let is_bad = |number: u32| number % 5 == seed % 9;
            let expected: Passes = (0..).filter(|&number| !is_bad(number)).take(asked as usize).collect();
            let (kept, left_out) = run(seed, ranks, asked, &is_bad);
            assert_eq!(kept, expected, "{ranks} ranks, {asked} passes");
            assert!(left_out.iter().all(is_bad));
        }
    }

    /// A rank that takes 50 times as long as the others has one pass in the end, and the others all that there are: the last pass of the slow one is all that is
    /// waited for, and a collection of films keeps nobody from going on.
    #[test]
    fn a_slow_rank_delays_nothing_but_its_own_pass() {
        let (ranks, asked) = (4, 100);
        let mut schedule = Schedule::new(ranks, Some(asked), Passes::default(), Passes::default());
        let mut busy: Vec<(u32, usize)> = (0..ranks).map(|rank| (0, rank)).collect();
        let (mut counts, mut last, mut handed_over) = ([0; 4], 0, 0);
        while schedule.rendered_count() < u64::from(asked) {
            busy.sort_unstable();
            let (time, rank) = &mut busy[0];
            if let Some(number) = schedule.ranks[*rank].running {
                schedule.rendered(*rank, true);
                (counts[*rank], last) = (counts[*rank] + 1, number.max(last));
                if schedule.rendered_count() == 50 {
                    schedule.collect();
                }
            }
            *time += match schedule.next(*rank) {
                Task::Pass(_) if *rank == 0 => 50,
                Task::Pass(_) => 1,
                Task::Deliver => {
                    handed_over += schedule.delivered(*rank).0.count();
                    0
                }
                Task::Wait | Task::End => 1,
            };
        }
        // 99 passes of three ranks take 33 steps.
        assert_eq!((counts[0], counts.iter().sum::<u32>(), last), (1, 100, 99));
        assert!(counts[1..].iter().all(|count| (32..=34).contains(count)), "{counts:?}");
        assert!(handed_over >= 47, "{handed_over} passes were handed over");
    }

    #[test]
    fn it_goes_on_after_what_is_there() {
        let kept: Passes = [0, 1, 4].into_iter().collect();
        let mut schedule = Schedule::new(1, Some(6), kept, Passes::from_iter([2]));
        let mut numbers = Vec::new();
        while let Task::Pass(number) = schedule.next(0) {
            numbers.push(number);
            schedule.rendered(0, true);
        }
        assert_eq!(numbers, [3, 5, 6]);
        assert_eq!(schedule.delivered(0).0, [3, 5, 6].into_iter().collect());
        assert_eq!((schedule.next(0), schedule.rendered_count()), (Task::End, 6));
    }

    #[test]
    fn idle_ranks_end_and_a_stop_keeps_what_is_rendered() {
        let mut schedule = Schedule::new(3, Some(1), Passes::default(), Passes::default());
        assert_eq!(schedule.next(0), Task::Pass(0));
        assert_eq!(schedule.next(1), Task::Wait);
        assert!(!schedule.is_deserted());
        schedule.rendered(0, true);
        assert_eq!(schedule.next(1), Task::Wait);
        assert_eq!(schedule.next(0), Task::Deliver);
        schedule.delivered(0);
        assert_eq!([schedule.next(0), schedule.next(1)], [Task::End; 2]);

        let mut endless = Schedule::new(1, None, Passes::default(), Passes::default());
        assert_eq!(endless.next(0), Task::Pass(0));
        endless.rendered(0, true);
        assert_eq!(endless.next(0), Task::Pass(1));
        endless.stop();
        endless.rendered(0, true);
        assert_eq!(endless.next(0), Task::Deliver);
        assert_eq!(endless.delivered(0).0.count(), 2);
        assert_eq!(endless.next(0), Task::End);
        assert_eq!(endless.lost(0), 0);
        assert!(endless.is_deserted());
    }
}
