//! `animate` on several ranks whose tasks are parts of a frame: ranks shade points, rank 0 filters them and writes the images. While it does, the
//! others have tasks of the next pass.

use std::collections::{BTreeSet, VecDeque};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use cpu_time::ProcessTime;
use lightsum::cluster::Message;
use lightsum::cluster::points::PassPoints;
use lightsum::settings::{Exposure, Traversal};
use lightsum::view::Task;
use lightsum::{Error, Result, input, output};
use serde_json::{Value, json};

use super::given::{Given, TASKS};
use super::{LOOK, Master, Written, claim, processor_since, refuse_flags};
use crate::animate::{Player, Script, timings, write_json};
use crate::args::{Animate, ClusterTasks};
use crate::progress::Progress;
use crate::say_aside;

/// Passes whose tasks are given out at a time: one is filtered while the next is shaded.
const AHEAD: usize = 2;

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
    let (written, interrupted) = Written::watch(args, part.clone());
    master.load(args.cluster.local_scene, Traversal::Auto)?;
    let mut player = Player::new(script, scene, Some(Traversal::Auto), &interrupted)?;
    master.compare(player.renderer.fingerprint())?;
    let engine = player.renderer.engine();
    engine.view().check_tasks(&engine.plan().settings)?;
    let tasks = Task::cut(&engine.plan().settings, engine.view().size(), (TASKS * master.clients().len()) as u32);

    let (mut progress, processor) = (Progress::new(), ProcessTime::now());
    let mut order = Order::new(&mut player.script, part.clone());
    let packed = args.cluster_tasks == ClusterTasks::PackedTiles;
    let mut given = Given::new(tasks, packed);
    let mut steps = VecDeque::new();
    let mut begin = |given: &mut Given, steps: &mut VecDeque<Step>, script: &mut Script, points| {
        if let Some(step) = order.next(script) {
            given.begin(step.frame as u32, step.pass, points);
            steps.push_back(step);
        }
    };
    for _ in 0..AHEAD {
        begin(&mut given, &mut steps, &mut player.script, PassPoints::of(engine));
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
            let (Some(mut pass), Some(step)) = (given.passes.pop_front(), steps.pop_front()) else { break };
            let start = Instant::now();
            let done = finish(&mut player, step, &mut pass.points, &mut edit);
            filtering += start.elapsed().as_secs_f64();
            passes += 1;
            match done {
                Ok(Some(frame)) if part.contains(&step.frame) => {
                    written.add(step.frame as u32);
                    frames.push(frame);
                }
                Ok(_) => {}
                Err(error) => failure = Some(error),
            }
            progress
                .show(|| format!("frame {} of {}", frames.len(), part.len()), frames.len() as f64 / part.len() as f64);
            pass.points.clear();
            begin(&mut given, &mut steps, &mut player.script, pass.points);
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
                if free.is_empty() && given.is_idle() {
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
fn finish(player: &mut Player, step: Step, points: &mut PassPoints, edit: &mut f64) -> Result<Option<Value>> {
    let Step { frame: at, pass: number, of_frame } = step;
    if of_frame == 0 {
        *edit = player.place(at)?;
    }
    if number == 0 {
        player.renderer.engine_mut().restart();
    }
    player.renderer.pass_from(number, points)?;
    if of_frame + 1 < player.script.job.settings.moving_passes {
        return Ok(None);
    }
    let own = json!({ "passes": player.renderer.passes(), "edit": *edit });
    let mut frame = player.finish(at, own)?;
    let write = Instant::now();
    if let (Some((layers, metadata)), true) = (&frame.image, player.script.part().contains(&at)) {
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
