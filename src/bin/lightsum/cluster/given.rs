//! Which rank shades which task of which pass.

use std::collections::{BTreeMap, VecDeque};

use lightsum::cluster::message::Shade;
use lightsum::cluster::points::{PassPoints, TaskPoints};
use lightsum::view::Task;
use lightsum::{Error, Result};

/// Tasks of a pass for each rank: more balance the load better, and cost more.
pub const TASKS: usize = 2;

/// A pass whose points are being shaded.
pub struct Pass {
    /// Number of its frame: no two passes share it and the next one.
    frame: u32,
    /// Its number in what the frame accumulates.
    pass: u32,
    pub points: PassPoints,
    /// Tasks that nobody has.
    left: VecDeque<Task>,
}

/// The tasks that ranks have.
#[derive(Default)]
pub struct Given {
    /// Those of each pass that begins.
    pub tasks: Vec<Task>,
    /// Whether points come in few bytes.
    packed: bool,
    pub passes: VecDeque<Pass>,
    of_rank: BTreeMap<usize, Shade>,
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
        let left = self.tasks.iter().copied().collect();
        self.passes.push_back(Pass { frame, pass, points, left });
    }

    /// Whether no rank has a task.
    pub fn is_idle(&self) -> bool {
        self.of_rank.is_empty()
    }

    /// A task for a rank: of the first pass that has some left, and of the class that it had before if there is one.
    pub fn next(&mut self, rank: usize) -> Option<Shade> {
        let pass = self.passes.iter_mut().find(|pass| !pass.left.is_empty())?;
        let class = self.class.get(&rank);
        let place = pass.left.iter().position(|task| Some(&task.class) == class).unwrap_or(0);
        let task = pass.left.remove(place)?;
        let shade = Shade { frame: pass.frame, pass: pass.pass, task };
        self.class.insert(rank, task.class);
        self.of_rank.insert(rank, shade);
        Some(shade)
    }

    fn pass_of(&mut self, shade: &Shade) -> Option<&mut Pass> {
        self.passes.iter_mut().find(|pass| (pass.frame, pass.pass) == (shade.frame, shade.pass))
    }

    /// Takes what a rank has shaded; the points of a pass that is no longer wanted are left out. Errors: it is not what it was asked for.
    pub fn take(&mut self, rank: usize, shade: &Shade, load: &[u8]) -> Result<()> {
        let asked = self.of_rank.remove(&rank);
        if asked != Some(*shade) {
            let message = format!("rank {rank} shaded {shade:?} and was asked for {asked:?}");
            return Err(Error::Resource { name: String::from("MPI"), message });
        }
        let packed = self.packed;
        match self.pass_of(shade) {
            Some(pass) if packed => pass.points.take_packed(shade.task, load),
            Some(pass) => pass.points.take(TaskPoints::from_bytes(shade.task, load)?),
            None => Ok(()),
        }
    }

    /// Gives out what a lost rank has not shaded again.
    pub fn lost(&mut self, rank: usize) {
        if let Some(shade) = self.of_rank.remove(&rank)
            && let Some(pass) = self.pass_of(&shade)
        {
            pass.left.push_front(shade.task);
        }
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
        let shape = Shape { size: [96, 96], pattern: [3, 3], components: 1, arrays: [11, 0] };
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
        let shape = Shape { size: [24, 24], pattern: [3, 3], components: 1, arrays: [11, 0] };
        let tasks = Task::cut(&Settings { pattern: [3, 3], ..Settings::interactive() }, shape.size, 1);
        let mut given = Given::new(tasks.clone(), false);
        given.begin(0, 0, PassPoints::new(shape));
        let first = given.next(1).unwrap();
        given.lost(1);
        let mut all: Vec<Task> = std::iter::from_fn(|| given.next(2)).map(|shade| shade.task).collect();
        assert_eq!((all.len(), all[0]), (tasks.len(), first.task));
        all.sort_by_key(|task| task.class);
        assert_eq!(all, tasks);
        // An answer to another task than the rank has.
        assert!(given.take(2, &first, &[]).is_err());
        // Points of a pass that is no longer wanted.
        let shade = given.of_rank[&2];
        given.passes.clear();
        given.take(2, &shade, &[]).unwrap();
        assert!(given.is_idle());
    }
}
