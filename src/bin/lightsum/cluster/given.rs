//! Which rank shades which task of which pass.

use std::collections::{BTreeMap, VecDeque};
use std::time::Instant;

use lightsum::cluster::message::Shade;
use lightsum::cluster::points::{PassPoints, TaskPoints};
use lightsum::view::Task;
use lightsum::{Error, Result};

/// Tasks of a pass for each rank: more balance the load better, and cost more.
pub const TASKS: usize = 2;

/// A task is late after so many times the mean of those before: a rank that has nothing else to do takes it too.
const LATE: f64 = 4.0;

/// A pass whose points are being shaded.
pub struct Pass {
    /// Number of its frame: no two passes share it and the next one.
    frame: u32,
    /// Its number in what the frame accumulates.
    pass: u32,
    pub points: PassPoints,
    /// Tasks that nobody has.
    left: VecDeque<Task>,
    /// Tasks whose points are not here.
    missing: Vec<Task>,
}

/// The tasks that ranks have.
#[derive(Default)]
pub struct Given {
    /// Those of each pass that begins.
    pub tasks: Vec<Task>,
    /// Whether points come in few bytes.
    packed: bool,
    pub passes: VecDeque<Pass>,
    /// Since when.
    of_rank: BTreeMap<usize, (Shade, Instant)>,
    /// Seconds of all tasks so far, and their number.
    taken: (f64, u32),
    /// Class of the last task of each rank.
    class: BTreeMap<usize, Option<u32>>,
}

impl Given {
    /// Without a pass.
    pub fn new(tasks: Vec<Task>, packed: bool) -> Given {
        Given { tasks, packed, ..Given::default() }
    }

    /// Begins a pass.
    pub fn begin(&mut self, frame: u32, pass: u32, points: PassPoints) {
        let (left, missing) = (self.tasks.iter().copied().collect(), self.tasks.clone());
        self.passes.push_back(Pass { frame, pass, points, left, missing });
    }

    /// Whether no rank has a task.
    pub fn is_idle(&self) -> bool {
        self.of_rank.is_empty()
    }

    /// A task for a rank: of the first pass that has some left, and of the class that it had before if there is one; or one of those that are late.
    pub fn next(&mut self, rank: usize) -> Option<Shade> {
        let now = Instant::now();
        let shade = self.next_left(rank).or_else(|| self.late(now))?;
        self.class.insert(rank, shade.task.class);
        self.of_rank.insert(rank, (shade, now));
        Some(shade)
    }

    fn next_left(&mut self, rank: usize) -> Option<Shade> {
        let pass = self.passes.iter_mut().find(|pass| !pass.left.is_empty())?;
        let class = self.class.get(&rank);
        let place = pass.left.iter().position(|task| Some(&task.class) == class).unwrap_or(0);
        let task = pass.left.remove(place)?;
        Some(Shade { frame: pass.frame, pass: pass.pass, task })
    }

    /// The task that a single rank has had for the longest time, if it is late: a slow rank delays no pass.
    fn late(&self, now: Instant) -> Option<Shade> {
        let (seconds, count) = self.taken;
        let most = LATE * seconds / f64::from(count);
        let is_wanted =
            |shade: &Shade| self.passes.iter().any(|pass| pass.is_of(shade) && pass.missing.contains(&shade.task));
        let holders = |shade: &Shade| self.of_rank.values().filter(|(other, _)| other == shade).count();
        let late = self.of_rank.values().filter(|(shade, since)| {
            count > 0 && (now - *since).as_secs_f64() > most && holders(shade) == 1 && is_wanted(shade)
        });
        late.min_by_key(|(_, since)| *since).map(|(shade, _)| *shade)
    }

    fn pass_of(&mut self, shade: &Shade) -> Option<&mut Pass> {
        self.passes.iter_mut().find(|pass| pass.is_of(shade))
    }

    /// Takes what a rank has shaded; points that are here already, or of a pass that is no longer wanted, are left out. Errors: it is not what it was
    /// asked for.
    pub fn take(&mut self, rank: usize, shade: &Shade, load: &[u8]) -> Result<()> {
        let asked = self.of_rank.remove(&rank);
        let Some((_, since)) = asked.filter(|(asked, _)| asked == shade) else {
            let message = format!("rank {rank} shaded {shade:?} and was asked for {asked:?}");
            return Err(Error::Resource { name: String::from("MPI"), message });
        };
        self.taken = (self.taken.0 + since.elapsed().as_secs_f64(), self.taken.1 + 1);
        let packed = self.packed;
        let Some(pass) = self.pass_of(shade).filter(|pass| pass.missing.contains(&shade.task)) else { return Ok(()) };
        pass.missing.retain(|task| *task != shade.task);
        match packed {
            true => pass.points.take_packed(shade.task, load),
            false => pass.points.take(TaskPoints::from_bytes(shade.task, load)?),
        }
    }

    /// Gives out what a lost rank has not shaded again.
    pub fn lost(&mut self, rank: usize) {
        let Some((shade, _)) = self.of_rank.remove(&rank) else { return };
        let has_other = self.of_rank.values().any(|(other, _)| *other == shade);
        if let Some(pass) = self.pass_of(&shade).filter(|pass| !has_other && pass.missing.contains(&shade.task)) {
            pass.left.push_front(shade.task);
        }
    }
}

impl Pass {
    fn is_of(&self, shade: &Shade) -> bool {
        (self.frame, self.pass) == (shade.frame, shade.pass)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use lightsum::cluster::points::Shape;
    use lightsum::settings::Settings;

    use super::*;

    /// Clients of random speeds, as many as there are classes at most, keep to few classes: about two in a frame (Wald et al. 2002, 4.2).
    #[test]
    fn clients_keep_to_few_classes() {
        let settings = Settings { pattern: [3, 3], ..Settings::interactive() };
        let shape = Shape { size: [96, 96], pattern: [3, 3], components: 1, arrays: [11, 0], more: [0; 11] };
        for clients in [1, 2, 4, 8, 16] {
            let tasks = Task::cut(&settings, shape.size, (TASKS * clients) as u32);
            let of_pass = tasks.len();
            let mut given = Given::new(tasks, false);
            let frames = 20;
            let mut classes: BTreeMap<(usize, u32), BTreeSet<Option<u32>>> = BTreeMap::new();
            // Seconds at which each client asks again; one takes up to twice as long as another.
            let mut busy: Vec<(f64, usize)> = (1..=clients).map(|rank| (0.0, rank)).collect();
            let mut begun = 0;
            for task in 0..frames * of_pass {
                if given.passes.iter().all(|pass| pass.left.is_empty()) {
                    given.passes.clear();
                    given.begin(begun, 0, PassPoints::new(shape));
                    begun += 1;
                }
                busy.sort_by(|a, b| a.0.total_cmp(&b.0));
                let (time, rank) = &mut busy[0];
                let shade = given.next(*rank).unwrap();
                *time += 1.0 + (*rank * 7 % clients) as f64 / clients as f64 + (task * 5 % 11) as f64 / 110.0;
                classes.entry((*rank, shade.frame)).or_default().insert(shade.task.class);
            }
            let mean = classes.values().map(BTreeSet::len).sum::<usize>() as f64 / classes.len() as f64;
            println!("{clients} clients, {of_pass} tasks a pass: {mean:.2} classes of a client in a frame");
            // A client alone has all of them; several share them.
            let most = (9.0 / clients as f64).max(2.0) + 0.5;
            assert!(mean <= most, "{clients} clients have {mean} classes each");
        }
    }

    #[test]
    fn tasks_of_a_lost_rank_are_given_out_again() {
        let shape = Shape { size: [24, 24], pattern: [3, 3], components: 1, arrays: [11, 0], more: [0; 11] };
        let tasks = Task::cut(&Settings { pattern: [3, 3], ..Settings::interactive() }, shape.size, 1);
        let mut given = Given::new(tasks.clone(), false);
        given.begin(0, 0, PassPoints::new(shape));
        let first = given.next(1).unwrap();
        given.lost(1);
        let mut all: Vec<Task> = std::iter::from_fn(|| given.next(2)).map(|shade| shade.task).collect();
        assert_eq!((all.len(), all[0]), (tasks.len(), first.task));
        all.sort_by_key(|task| task.class);
        assert_eq!(all, tasks);
        // Points of a pass that is no longer wanted.
        let (shade, _) = given.of_rank[&2];
        given.passes.clear();
        given.take(2, &shade, &[]).unwrap();
        assert!(given.is_idle());
        // An answer to another task than the rank has.
        assert!(given.take(2, &first, &[]).is_err());
    }

    #[test]
    fn a_slow_rank_delays_no_pass() {
        let shape = Shape { size: [24, 24], pattern: [3, 3], components: 1, arrays: [0, 0], more: [0; 11] };
        let tasks = Task::cut(&Settings { pattern: [3, 3], ..Settings::interactive() }, shape.size, 1);
        let count = tasks.len();
        let mut given = Given::new(tasks, false);
        (0..2).for_each(|pass| given.begin(0, pass, PassPoints::new(shape)));
        let nothing = [0; 16];
        let slow = given.next(1).unwrap();
        for _ in 0..2 * count - 1 {
            let shade = given.next(2).unwrap();
            given.take(2, &shade, &nothing).unwrap();
        }
        // Each of the others took next to no time.
        std::thread::sleep(std::time::Duration::from_millis(20));
        assert_eq!(given.next(2), Some(slow));
        assert_eq!(given.next(3), None);
        given.take(2, &slow, &nothing).unwrap();
        assert!(given.passes.iter().all(|pass| pass.points.is_complete()));
        // Late points are left out, also where the rank is lost.
        given.lost(1);
        assert!(given.passes.iter().all(|pass| pass.left.is_empty()));
        assert_eq!(given.next(1), None);
    }
}
