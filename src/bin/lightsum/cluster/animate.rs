//! `animate` on several ranks: frames are tasks. Frames between which nothing moves accumulate, so that they are one task.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use cpu_time::ProcessTime;
use lightsum::cluster::Message;
use lightsum::settings::Traversal;
use lightsum::{Error, Result, input, output};
use serde_json::{Value, json};

use super::{LOOK, Master, Written, claim, processor_since, refuse_flags};
use crate::animate::{Script, timings, write_json};
use crate::args::Animate;
use crate::progress::Progress;
use crate::say_aside;

/// Runs the command.
pub fn run(master: &mut Master, args: &Animate) -> Result<()> {
    input::keep();
    let (mut script, scene) = Script::new(args)?;
    refuse_flags(&[(script.job.settings.ring.is_some(), "--ring"), (args.stats.is_some(), "--stats")])?;
    drop(scene);
    let part = script.part();
    let files: Vec<PathBuf> = script.outputs(part.clone()).into_iter().take(1).chain(args.timings.clone()).collect();
    let _claim = claim(&files)?;
    let (written, interrupted) = Written::watch(args, script.part());
    master.load(args.cluster.local_scene, Traversal::Auto)?;

    let all = part.len();
    let (mut progress, processor) = (Progress::new(), ProcessTime::now());
    let mut bytes = 0;
    let mut tasks = Tasks { left: part, again: VecDeque::new(), of_rank: BTreeMap::new() };
    let mut free: BTreeSet<usize> = master.clients().collect();
    let mut frames: BTreeMap<u32, Value> = BTreeMap::new();
    let mut failure = None;
    loop {
        let stopped = interrupted.load(Ordering::Relaxed) || failure.is_some();
        for rank in free.clone().into_iter().filter(|_| !stopped) {
            let Some(task) = tasks.next(rank, &mut script) else { break };
            free.remove(&rank);
            master.link.send(rank, &Message::Frames([task.start as u32, task.end as u32]), &[]);
        }
        if tasks.of_rank.is_empty() {
            break;
        }
        let Some((rank, message, load)) = master.link.poll()? else {
            std::thread::sleep(LOOK);
            continue;
        };
        match message {
            Message::Frame { number, timings } => {
                let path = script.output(number as usize);
                match path.map_or(Ok(()), |path| output::write_file(&path, &[&load])) {
                    Ok(()) => written.add(number),
                    Err(error) => failure = failure.or(Some(error)),
                }
                frames.insert(number, timings);
                bytes += load.len();
                if tasks.done(rank, number) {
                    free.insert(rank);
                }
                progress.show(|| format!("frame {} of {all}", frames.len()), frames.len() as f64 / all as f64);
            }
            Message::Failed(why) => {
                tasks.lost(rank);
                log::warn!("rank {rank} on {} is lost, others render its frames: {why}", master.hosts[rank]);
                if free.is_empty() && tasks.of_rank.is_empty() {
                    failure = Some(Error::Rank { rank, host: master.hosts[rank].clone(), message: why });
                }
            }
            other => return master.refuse(rank, format!("unexpected message {other:?}")),
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
        let ready = &master.ready[0];
        let [device, driver] = ready.about.devices.values().next().cloned().unwrap_or_default();
        let frames: Vec<Value> = frames.into_values().collect();
        let mut value = timings(&script.job, (&device, &driver, ready.triangles), frames);
        value["master"] = json!({ "wall": wall.as_secs_f64(), "processor": processor, "bytes": bytes });
        value["ranks"] = master.works();
        write_json(path, &value)?;
    }
    if let Some(error) = failure {
        say_aside(&format!("{count} of {all} frames were done before the error"));
        return Err(error);
    }
    if count < all {
        say_aside(&format!("interrupted after {count} of {all} frames"));
    }
    script.say_where(count, progress.elapsed());
    Ok(())
}

/// Frames to be rendered.
struct Tasks {
    /// Those that nobody has begun.
    left: Range<usize>,
    /// Those of ranks that are lost.
    again: VecDeque<Range<usize>>,
    /// The work of the ranks.
    of_rank: BTreeMap<usize, Range<usize>>,
}

impl Tasks {
    /// The next frames for a rank: one, and those after it in which nothing moves.
    fn next(&mut self, rank: usize, script: &mut Script) -> Option<Range<usize>> {
        let task = match self.again.pop_front() {
            Some(task) => task,
            None if self.left.is_empty() => return None,
            None => {
                let end = script.end_of_still(self.left.clone());
                let task = self.left.start..end;
                self.left.start = end;
                task
            }
        };
        self.of_rank.insert(rank, task.clone());
        Some(task)
    }

    /// Notes that a rank has rendered a frame; returns whether it was the last of its task.
    fn done(&mut self, rank: usize, number: u32) -> bool {
        let Some(task) = self.of_rank.get_mut(&rank) else { return true };
        task.start = number as usize + 1;
        let over = task.start >= task.end;
        if over {
            self.of_rank.remove(&rank);
        }
        over
    }

    /// Gives out what a lost rank has not rendered again.
    fn lost(&mut self, rank: usize) {
        self.again.extend(self.of_rank.remove(&rank));
    }
}
