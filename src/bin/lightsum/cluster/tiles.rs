//! `animate` on several ranks whose tasks are parts of a frame: ranks shade points, rank 0 filters them and writes the images. While it does, the
//! others have tasks of the next pass.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use cpu_time::ProcessTime;
use lightsum::cluster::Message;
use lightsum::cluster::message::Shade;
use lightsum::cluster::points::{PassPoints, Shape, TaskPoints};
use lightsum::settings::{Exposure, Traversal};
use lightsum::view::Task;
use lightsum::{Error, Result, input, output};
use serde_json::{Value, json};

use super::{LOOK, Master, claim, processor_since, refuse_flags};
use crate::animate::{Player, Script, timings, write_json};
use crate::args::{Animate, ClusterTasks};
use crate::progress::Progress;
use crate::say_aside;
use crate::stop::watch_for_interrupt;

/// Passes whose tasks are given out at a time: one is filtered while the next is shaded.
const AHEAD: usize = 2;
/// Tasks of a pass for each rank: more balance the load better, and cost more.
const TASKS: usize = 2;

/// Runs the command.
pub fn run(master: &mut Master, args: &Animate) -> Result<()> {
    input::keep();
    let (script, scene) = Script::new(args)?;
    let kept = args.shown.kept.light_from.is_some();
    refuse_flags(&[
        (script.job.settings.ring.is_some(), "--ring"),
        (args.stats.is_some(), "--stats"),
        (kept, "--light-from"),
    ])?;
    let part = script.part();
    let files: Vec<PathBuf> = script.outputs(part.clone()).into_iter().take(1).chain(args.timings.clone()).collect();
    let _claim = claim(&files)?;
    let interrupted = watch_for_interrupt();
    master.load(args.cluster.local_scene, Traversal::Auto)?;
    let mut player = Player::new(script, scene, Some(Traversal::Auto), &interrupted)?;
    let engine = player.renderer.engine();
    engine.view().check_tasks(&engine.plan().settings)?;
    let tasks = Task::cut(&engine.plan().settings, engine.view().size(), (TASKS * master.clients().len()) as u32);
    let shape = Shape::of(engine);

    let (mut progress, processor) = (Progress::new(), ProcessTime::now());
    let mut order = Order::new(&mut player.script, part.clone());
    let packed = args.cluster_tasks == ClusterTasks::PackedTiles;
    let mut given = Given { tasks, packed, passes: VecDeque::new(), of_rank: BTreeMap::new(), class: BTreeMap::new() };
    for _ in 0..AHEAD {
        given.begin(order.next(&mut player.script), PassPoints::new(shape));
    }
    let mut free: BTreeSet<usize> = master.clients().collect();
    let mut frames: Vec<Value> = Vec::new();
    let (mut failure, mut bytes, mut filtering, mut passes) = (None, 0, 0.0, 0);
    let mut edit = 0.0;
    while !interrupted.load(Ordering::Relaxed) && failure.is_none() {
        for rank in free.clone() {
            let Some(shade) = given.next(rank) else { break };
            free.remove(&rank);
            master.link.send(rank, &Message::Shade(shade), &[]);
        }
        let Some(first) = given.passes.front() else { break };
        if first.points.is_complete() {
            let Some(mut pass) = given.passes.pop_front() else { break };
            let start = Instant::now();
            let done = finish(&mut player, &mut pass, &mut edit);
            filtering += start.elapsed().as_secs_f64();
            passes += 1;
            match done {
                Ok(Some(frame)) if part.contains(&pass.step.frame) => frames.push(frame),
                Ok(_) => {}
                Err(error) => failure = Some(error),
            }
            progress
                .show(|| format!("frame {} of {}", frames.len(), part.len()), frames.len() as f64 / part.len() as f64);
            pass.points.clear();
            given.begin(order.next(&mut player.script), pass.points);
            continue;
        }
        match master.link.poll()? {
            None => std::thread::sleep(LOOK),
            Some((rank, Message::Shaded(shade), load)) => {
                bytes += load.len();
                given.take(rank, &shade, &load)?;
                free.insert(rank);
            }
            Some((rank, Message::Failed(why), _)) => {
                given.lost(rank);
                log::warn!("rank {rank} on {} is lost, others shade its points: {why}", master.hosts[rank]);
                if free.is_empty() && given.of_rank.is_empty() {
                    failure = Some(Error::Rank { rank, host: master.hosts[rank].clone(), message: why });
                }
            }
            Some((rank, other, _)) => return master.refuse(rank, format!("unexpected message {other:?}")),
        }
    }
    progress.finish();
    let (wall, processor) = (progress.elapsed(), processor_since(processor));
    master.end();
    let count = frames.len();
    if count == 0 {
        return Err(failure.unwrap_or(Error::Interrupted));
    }
    if let Some(path) = &args.timings {
        let statistics = player.renderer.statistics();
        let of_device = (statistics.device.as_str(), statistics.driver.as_str(), statistics.triangles);
        let mut value = timings(&player.script.job, of_device, frames);
        value["master"] = json!({
            "wall": wall.as_secs_f64(),
            "processor": processor,
            "bytes": bytes,
            "passes": passes,
            "filtering": filtering,
        });
        value["ranks"] = master.works();
        write_json(path, &value)?;
    }
    if let Some(error) = failure {
        say_aside(&format!("{count} of {} frames were done before the error", part.len()));
        return Err(error);
    }
    if count < part.len() {
        say_aside(&format!("interrupted after {count} of {} frames", part.len()));
    }
    player.script.say_where(count, progress.elapsed());
    Ok(())
}

/// Filters a pass and adds it to its frame; after the last pass of it writes its image and returns its times. `edit`: seconds that it took to
/// place what moves in it.
fn finish(player: &mut Player, pass: &mut Pass, edit: &mut f64) -> Result<Option<Value>> {
    let Step { frame, pass: number, of_frame } = pass.step;
    if of_frame == 0 {
        *edit = player.place(frame)?;
    }
    if number == 0 {
        player.renderer.engine_mut().restart();
    }
    player.renderer.pass_from(number, &mut pass.points)?;
    if of_frame + 1 < player.script.job.settings.moving_passes {
        return Ok(None);
    }
    let own = json!({ "passes": player.renderer.passes(), "edit": *edit });
    let mut frame = player.finish(frame, own)?;
    let write = Instant::now();
    if let (Some((layers, metadata)), true) = (&frame.image, player.script.part().contains(&pass.step.frame)) {
        for path in &player.script.job.outputs {
            let file = output::encode(path, layers, metadata, &player.script.job.encoding)?;
            output::write_file(path, &[&file])?;
        }
    }
    frame.timings["write"] = write.elapsed().as_secs_f64().into();
    Ok(Some(frame.timings))
}

/// A pass of a frame.
#[derive(Clone, Copy)]
struct Step {
    frame: usize,
    /// Its number in what the frame accumulates.
    pass: u32,
    /// Its number within the frame.
    of_frame: u32,
}

/// The passes of all frames, in order. Frames between which nothing moves accumulate.
struct Order {
    frames: VecDeque<usize>,
    before: Option<Step>,
}

impl Order {
    /// For these frames, with those that they need.
    fn new(script: &mut Script, part: Range<usize>) -> Order {
        let first = script.first_of_still(part.start);
        let auto = part.start > 0 && script.job.encoding.exposure == Exposure::Auto && script.is_for_display();
        let exposed = (auto && first > 0).then_some(0);
        Order { frames: exposed.into_iter().chain(first..part.end).collect(), before: None }
    }

    fn next(&mut self, script: &mut Script) -> Option<Step> {
        let next = match self.before {
            Some(step) if step.of_frame + 1 < script.job.settings.moving_passes => {
                Some(Step { pass: step.pass + 1, of_frame: step.of_frame + 1, ..step })
            }
            before => self.frames.pop_front().map(|frame| {
                let goes_on =
                    before.filter(|step| step.frame + 1 == frame && script.end_of_still(step.frame..frame + 1) > frame);
                Step { frame, pass: goes_on.map_or(0, |step| step.pass + 1), of_frame: 0 }
            }),
        };
        self.before = next.or(self.before);
        next
    }
}

/// A pass whose points are being shaded.
struct Pass {
    step: Step,
    points: PassPoints,
    /// Tasks that nobody has.
    left: VecDeque<Task>,
}

/// The tasks that ranks have.
struct Given {
    /// Those of each pass.
    tasks: Vec<Task>,
    /// Whether points come in few bytes.
    packed: bool,
    passes: VecDeque<Pass>,
    of_rank: BTreeMap<usize, Shade>,
    /// Class of the last task of each rank.
    class: BTreeMap<usize, Option<u32>>,
}

impl Given {
    /// Begins a pass, if there is one.
    fn begin(&mut self, step: Option<Step>, points: PassPoints) {
        let left = self.tasks.iter().copied().collect();
        self.passes.extend(step.map(|step| Pass { step, points, left }));
    }

    /// A task for a rank: of the first pass that has some left, and of the class that it had before if there is one.
    fn next(&mut self, rank: usize) -> Option<Shade> {
        let pass = self.passes.iter_mut().find(|pass| !pass.left.is_empty())?;
        let class = self.class.get(&rank);
        let place = pass.left.iter().position(|task| Some(&task.class) == class).unwrap_or(0);
        let task = pass.left.remove(place)?;
        let shade = Shade { frame: pass.step.frame as u32, pass: pass.step.pass, task };
        self.class.insert(rank, task.class);
        self.of_rank.insert(rank, shade);
        Some(shade)
    }

    fn pass_of(&mut self, shade: &Shade) -> Option<&mut Pass> {
        let is_its = |pass: &&mut Pass| (pass.step.frame as u32, pass.step.pass) == (shade.frame, shade.pass);
        self.passes.iter_mut().find(is_its)
    }

    /// Takes what a rank has shaded. Errors: it is not what it was asked for.
    fn take(&mut self, rank: usize, shade: &Shade, load: &[u8]) -> Result<()> {
        let asked = self.of_rank.remove(&rank);
        let packed = self.packed;
        match self.pass_of(shade).filter(|_| asked == Some(*shade)) {
            Some(pass) if packed => pass.points.take_packed(shade.task, load),
            Some(pass) => pass.points.take(TaskPoints::from_bytes(shade.task, load)?),
            None => {
                let message = format!("rank {rank} shaded {shade:?} and was asked for {asked:?}");
                Err(Error::Resource { name: String::from("MPI"), message })
            }
        }
    }

    /// Gives out what a lost rank has not shaded again.
    fn lost(&mut self, rank: usize) {
        if let Some(shade) = self.of_rank.remove(&rank)
            && let Some(pass) = self.pass_of(&shade)
        {
            pass.left.push_front(shade.task);
        }
    }
}

#[cfg(test)]
mod tests {
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
            let mut given = Given {
                tasks,
                packed: false,
                passes: VecDeque::new(),
                of_rank: BTreeMap::new(),
                class: BTreeMap::new(),
            };
            let frames = 20;
            let mut classes: BTreeMap<(usize, u32), BTreeSet<Option<u32>>> = BTreeMap::new();
            // Seconds at which each client asks again; one takes up to twice as long as another.
            let mut busy: Vec<(f64, usize)> = (1..=clients).map(|rank| (0.0, rank)).collect();
            let mut begun = 0;
            for task in 0..frames * of_pass {
                if given.passes.iter().all(|pass| pass.left.is_empty()) {
                    given.passes.clear();
                    given.begin(Some(Step { frame: begun, pass: 0, of_frame: 0 }), PassPoints::new(shape));
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
        let mut given = Given {
            tasks: tasks.clone(),
            packed: false,
            passes: VecDeque::new(),
            of_rank: BTreeMap::new(),
            class: BTreeMap::new(),
        };
        given.begin(Some(Step { frame: 0, pass: 0, of_frame: 0 }), PassPoints::new(shape));
        let first = given.next(1).unwrap();
        given.lost(1);
        let mut all: Vec<Task> = std::iter::from_fn(|| given.next(2)).map(|shade| shade.task).collect();
        assert_eq!((all.len(), all[0]), (tasks.len(), first.task));
        all.sort_by_key(|task| task.class);
        assert_eq!(all, tasks);
        // An answer to another task than the rank has.
        assert!(given.take(2, &first, &[]).is_err());
    }
}
