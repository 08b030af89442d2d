//! Passes on several ranks: passes are tasks, films are added up.
//!
//! Films are exact sums, so that any number of ranks, in any order, gives the bits of one process.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use lightsum::cluster::{Message, Passes, Schedule, Task};
use lightsum::film::HostFilm;
use lightsum::output::{FilmFile, Provenance};
use lightsum::{Error, Result};

use super::{LOOK, Master};
use crate::progress::Progress;
use crate::render::count;
use crate::say_aside;
use crate::stop::Stop;

/// When passes end, and when their film is written.
pub struct Limits<'a> {
    pub stop: &'a Stop,
    pub interrupted: &'a AtomicBool,
    /// Time between two checkpoints; `None`: there are none.
    pub checkpoint: Option<Duration>,
}

/// Adds passes to a film until it has those that it shall have. Errors: no rank is left; the film so far is then in its file.
pub fn add(master: &Master, sum: &mut Sum, limits: &Limits, progress: &mut Progress) -> Result<()> {
    let Limits { stop, interrupted, checkpoint } = limits;
    let mut ranks = Ranks::new(master, sum, stop.passes());
    let (start, mut last) = (Instant::now(), Instant::now());
    while !ranks.give_out(master) {
        let (passes, elapsed) = (ranks.schedule.rendered_count() as u32, start.elapsed());
        if interrupted.load(Ordering::Relaxed) || passes > 0 && stop.is_late(elapsed) {
            ranks.schedule.stop();
        }
        if checkpoint.is_some_and(|every| last.elapsed() >= every) {
            last = Instant::now();
            if ranks.collecting {
                // A rank is slow: what the others have handed over is written without it. Nobody is asked again before the last film is there: ranks that
                // deliver all the time would never be all done.
                sum.checkpoint();
            } else {
                ranks.schedule.collect();
                ranks.collecting = true;
            }
        }
        if !ranks.hear(master, sum)? {
            std::thread::sleep(LOOK);
            continue;
        }
        if ranks.collecting && ranks.schedule.is_collected() {
            ranks.collecting = false;
            sum.checkpoint();
        }
        if ranks.schedule.is_deserted() {
            sum.checkpoint();
            sum.tell();
            let (rank, why) = ranks.failed.pop().unwrap_or_default();
            return master.refuse(rank, why);
        }
        let rendered = ranks.schedule.rendered_count() as u32;
        let own = rendered.saturating_sub(ranks.before);
        let text = || {
            let rate = f64::from(own) / elapsed.as_secs_f64().max(1e-9);
            format!("{}, {rate:.2} passes/s on {} ranks", count(rendered), ranks.clients.len())
        };
        progress.show(text, stop.fraction(rendered, own, elapsed, None));
    }
    Ok(())
}

/// The work of the ranks.
struct Ranks {
    schedule: Schedule,
    /// Those that are not lost.
    clients: Vec<usize>,
    /// Those without a task.
    free: BTreeSet<usize>,
    failed: Vec<(usize, String)>,
    collecting: bool,
    /// Passes of an earlier run.
    before: u32,
}

impl Ranks {
    fn new(master: &Master, sum: &Sum, asked: Option<u32>) -> Ranks {
        let clients: Vec<usize> = master.clients().collect();
        let schedule = Schedule::new(clients.len(), asked, sum.passes.clone(), sum.left_out.clone());
        let free = clients.iter().copied().collect();
        let before = sum.passes.count() as u32;
        Ranks { schedule, clients, free, failed: Vec::new(), collecting: false, before }
    }

    /// Gives tasks to those that have none; returns whether nothing is left to do.
    fn give_out(&mut self, master: &Master) -> bool {
        let mut ended = 0;
        for rank in self.free.clone() {
            let message = match self.schedule.next(rank - 1) {
                Task::Pass(number) => Message::Pass(number),
                Task::Deliver => Message::Deliver,
                Task::Wait => continue,
                Task::End => {
                    ended += 1;
                    continue;
                }
            };
            master.link.send(rank, &message, &[]);
            self.free.remove(&rank);
        }
        ended == self.clients.len()
    }

    /// Takes a message, if there is one. Errors: a film that does not add up.
    fn hear(&mut self, master: &Master, sum: &mut Sum) -> Result<bool> {
        let Some((rank, message, load)) = master.link.poll()? else { return Ok(false) };
        match message {
            Message::Rendered { kept, .. } => self.schedule.rendered(rank - 1, kept),
            Message::Film => {
                let (kept, left_out) = self.schedule.delivered(rank - 1);
                sum.add(master, rank, &load, (kept, left_out))?;
            }
            Message::Failed(why) => {
                let again = self.schedule.lost(rank - 1);
                self.clients.retain(|&client| client != rank);
                log::warn!(
                    "rank {rank} on {} is lost, {again} of its passes are rendered again: {why}",
                    master.hosts[rank]
                );
                self.failed.push((rank, why));
                return Ok(true);
            }
            other => return master.refuse(rank, format!("unexpected message {other:?}")),
        }
        self.free.insert(rank);
        Ok(true)
    }
}

/// The film of all ranks.
pub struct Sum<'a> {
    /// The film; `None`: there is none yet.
    pub film: Option<FilmFile>,
    /// The passes in it, and those that were left out.
    pub passes: Passes,
    left_out: Passes,
    asked: Option<u32>,
    /// Its file.
    path: Option<&'a Path>,
    /// Whether this run wrote the file.
    written: bool,
    /// Time for adding up, the films that were, and their bytes.
    pub merging: Duration,
    pub films: u32,
    pub bytes: u64,
}

impl<'a> Sum<'a> {
    pub fn new(master: &Master, asked: Option<u32>, path: Option<&'a Path>) -> Result<Sum<'a>> {
        if master.ready.is_empty() {
            let message = String::from("there is no rank to render; start at least two");
            return Err(Error::Setting { name: "mpirun", message });
        }
        Ok(Sum {
            film: None,
            passes: Passes::default(),
            left_out: Passes::default(),
            asked,
            path,
            written: false,
            merging: Duration::ZERO,
            films: 0,
            bytes: 0,
        })
    }

    /// Goes on with the film of an earlier run.
    pub fn go_on(&mut self, master: &Master, path: &Path, earlier: FilmFile) -> Result<()> {
        let ready = &master.ready[0];
        let provenance = Provenance { device: ready.device.clone(), traversal: ready.traversal };
        earlier.check(path, ready.fingerprint, ready.size, &provenance)?;
        self.passes = earlier.about.passes.clone();
        self.left_out = earlier.about.left_out.clone();
        log::info!("{}: going on after {} passes", path.display(), self.passes.count());
        self.film = Some(earlier);
        Ok(())
    }

    /// Adds the film that a rank handed over.
    fn add(&mut self, master: &Master, rank: usize, bytes: &[u8], (kept, left_out): (Passes, Passes)) -> Result<()> {
        let start = Instant::now();
        let ready = &master.ready[rank - 1];
        let film = HostFilm::from_bytes(bytes, ready.size, ready.about.summands)?;
        if u64::from(film.passes()) != kept.count() {
            return master.refuse(rank, format!("its film has {} passes in place of {}", film.passes(), kept.count()));
        }
        let mut about = ready.about.clone();
        (about.passes, about.left_out) = (kept, left_out);
        about.asked = self.asked;
        let part = FilmFile { about, fingerprint: ready.fingerprint, traversal: ready.traversal, film };
        match &mut self.film {
            Some(sum) => sum.add(&part)?,
            None => self.film = Some(part),
        }
        if let Some(sum) = &self.film {
            self.passes = sum.about.passes.clone();
            self.left_out = sum.about.left_out.clone();
        }
        self.merging += start.elapsed();
        self.films += 1;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Writes the film. A failure is told, and the rendering goes on.
    pub fn checkpoint(&mut self) {
        if let (Some(path), Some(film)) = (self.path, &self.film) {
            match film.write(path) {
                Ok(()) => self.written = true,
                Err(error) => log::warn!("no checkpoint after {} passes: {error}", self.passes.count()),
            }
        }
    }

    /// Removes the file if this run wrote it: the rendering is done.
    pub fn remove(&self) {
        if let (true, Some(path)) = (self.written, self.path)
            && let Err(error) = std::fs::remove_file(path)
        {
            log::warn!("removing {}: {error}", path.display());
        }
    }

    /// Tells how to go on from the file, if this run wrote it.
    pub fn tell(&self) {
        if let (true, Some(path)) = (self.written, self.path) {
            let passes = count(self.passes.count() as u32);
            say_aside(&format!(
                "the film of {passes} is in {}; the same command with --resume goes on, on any number of ranks",
                path.display()
            ));
        }
    }
}
