//! `mpirun -n N lightsum ...`: one rendering on several ranks. Rank 0, the master, reads the scene, gives out tasks to those that ask, adds up
//! what they hand over, and writes the files; the others render. Ranks but the master never talk to each other.
//!
//! 1. Every rank says who it is; the master compares ([`Message::Hello`]).
//! 2. The master reads the scene and broadcasts its files ([`Message::Load`]); the others read it from these, open their devices and tell
//!    what they would render ([`Message::Ready`]).
//! 3. Tasks, by the command: [`render`] and [`bake`] ([`passes`]), [`animate`] (frames), [`tiles`] and [`view`](crate::view) (parts of frames).
//! 4. [`Message::End`] to all, and [`Message::Bye`] of all: no message is under way when MPI ends.

mod animate;
mod bake;
mod client;
mod given;
mod link;
mod passes;
mod render;
mod tiles;
#[cfg(feature = "viewer")]
mod view;

use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use cpu_time::ProcessTime;
use lightsum::cluster::message::{Hello, Ready, Work};
use lightsum::cluster::{Message, Passes};
use lightsum::settings::Traversal;
use lightsum::{Error, Result, input, output};
use serde_json::{Value, json};

use crate::args::{Animate, Arguments, ClusterTasks, Command};
use crate::say_aside;
use crate::stop::watch_and_tell;
use link::Link;

/// Time between two looks for messages.
const LOOK: Duration = Duration::from_millis(1);

/// Runs a command on all ranks of the job, of which the launcher has started so many.
pub fn run(arguments: &Arguments, ranks: usize) -> Result<()> {
    let Some(universe) = mpi::initialize() else {
        let message = String::from("MPI was initialised before");
        return Err(Error::Resource { name: String::from("MPI"), message });
    };
    let link = Link::new(&universe);
    if link.ranks() != ranks {
        let message = format!(
            "{ranks} ranks were started, and MPI knows {}: its library is not that of the launcher; use its own mpirun (on Debian of openmpi-bin), or srun --mpi=pmix",
            link.ranks()
        );
        return Err(Error::Setting { name: "mpirun", message });
    }
    let version = String::from(env!("CARGO_PKG_VERSION"));
    let hello = Hello { version, arguments: std::env::args().skip(1).collect(), host: link::host() };
    if link.rank() > 0 {
        return client::run(arguments, &link, hello);
    }
    let mut master = Master { hosts: vec![hello.host.clone()], ready: Vec::new(), link: &link, bye: Vec::new() };
    let result = master.run(arguments, &hello);
    master.end();
    result
}

/// Rank 0.
struct Master<'a> {
    link: &'a Link,
    /// Machines by rank.
    hosts: Vec<String>,
    /// The work of each of the other ranks.
    ready: Vec<Ready>,
    /// The report of each of them, once it has ended.
    bye: Vec<(usize, Work)>,
}

impl Master<'_> {
    fn run(&mut self, arguments: &Arguments, hello: &Hello) -> Result<()> {
        self.meet(hello)?;
        match &arguments.command {
            Some(Command::Render(args)) => render::run(self, args),
            Some(Command::Animate(args)) if args.cluster_tasks != ClusterTasks::Frames => tiles::run(self, args),
            Some(Command::Animate(args)) => animate::run(self, args),
            Some(Command::Bake(args)) => bake::run(self, args),
            #[cfg(feature = "viewer")]
            Some(Command::View(args)) => view::run(self, args),
            _ => Err(Error::Setting {
                name: "mpirun",
                message: String::from(
                    "render, animate, bake and view run on several ranks; start other commands without mpirun",
                ),
            }),
        }
    }

    /// The ranks that render.
    fn clients(&self) -> std::ops::Range<usize> {
        1..self.link.ranks()
    }

    fn refuse<T>(&self, rank: usize, message: impl Into<String>) -> Result<T> {
        Err(Error::Rank { rank, host: self.hosts[rank].clone(), message: message.into() })
    }

    /// Compares all ranks with this one.
    fn meet(&mut self, own: &Hello) -> Result<()> {
        self.hosts.resize(self.link.ranks(), String::new());
        let mut others = Vec::new();
        for _ in self.clients() {
            let (rank, message, _) = self.link.wait()?;
            if let Message::Hello(hello) = message {
                self.hosts[rank] = hello.host.clone();
                others.push((rank, hello));
            }
        }
        others.sort_by_key(|(rank, _)| *rank);
        match others.iter().find_map(|(rank, hello)| Some((*rank, hello.differs(own)?))) {
            Some((rank, why)) => self.refuse(rank, why),
            None => Ok(()),
        }
    }

    /// Has all ranks read the scene, with the files that this one has read unless `local`, and waits until they can render. `traversal`:
    /// the kernel where the flags leave it open.
    fn load(&mut self, local: bool, traversal: Traversal) -> Result<()> {
        let mut files = input::kept();
        let message = Message::Load { files: (!local).then_some(files.len() as u64), traversal };
        self.clients().for_each(|rank| self.link.send(rank, &message, &[]));
        if !local {
            self.link.broadcast(&mut files);
        }
        drop(files);
        self.gather()
    }

    /// Has all ranks go on with a part of a bake.
    fn part(&mut self, part: usize) -> Result<()> {
        self.clients().for_each(|rank| self.link.send(rank, &Message::Part(part as u32), &[]));
        self.gather()
    }

    /// Waits until all ranks tell what they render, and compares.
    fn gather(&mut self) -> Result<()> {
        let (mut ready, mut failed) = (Vec::new(), Vec::new());
        for _ in self.clients() {
            match self.link.wait()? {
                (rank, Message::Ready(own), _) => ready.push((rank, *own)),
                (rank, Message::Failed(why), _) => failed.push((rank, why)),
                (rank, other, _) => return self.refuse(rank, format!("unexpected message {other:?}")),
            }
        }
        failed.sort();
        if let Some((rank, why)) = failed.into_iter().next() {
            return self.refuse(rank, why);
        }
        ready.sort_by_key(|(rank, _)| *rank);
        for (rank, own) in &ready {
            if let Some(why) = own.differs(&ready[0].1) {
                return self.refuse(*rank, format!("{why} (rank {} is as the master)", ready[0].0));
            }
        }
        self.ready = ready.into_iter().map(|(_, ready)| ready).collect();
        let first = &self.ready[0];
        for (rank, own) in self.clients().zip(&self.ready).filter(|(_, own)| own.device != first.device) {
            log::warn!(
                "rank {rank} renders by {}, rank 1 by {}: the image is as good, but its last bits are those of neither",
                own.device,
                first.device
            );
        }
        Ok(())
    }

    /// Errors: the other ranks do not render what this one, which filters their points, does.
    fn compare(&self, fingerprint: u64) -> Result<()> {
        match self.ready.first() {
            Some(ready) if ready.fingerprint != fingerprint => self
                .refuse(1, "its scene is not that of rank 0: with --local-scene all machines must have the same files"),
            _ => Ok(()),
        }
    }

    /// Ends all ranks, and waits until they say that they have.
    fn end(&mut self) {
        let missing: Vec<usize> =
            self.clients().filter(|rank| self.bye.iter().all(|(other, _)| other != rank)).collect();
        missing.iter().for_each(|&rank| self.link.send(rank, &Message::End, &[]));
        let mut left = missing.len();
        while left > 0 {
            // Films and failures come too late.
            match self.link.wait() {
                Ok((rank, Message::Bye(work), _)) => {
                    self.bye.push((rank, work));
                    left -= 1;
                }
                Ok(_) => {}
                Err(error) => return log::warn!("{error}"),
            }
        }
        self.bye.sort_by_key(|(rank, _)| *rank);
    }

    /// The reports of all ranks as JSON, once they have ended.
    fn works(&self) -> Value {
        let of_rank = |(rank, work): &(usize, Work)| {
            let device = self.ready.get(rank - 1).map(|ready| ready.device.clone());
            json!({ "rank": rank, "host": self.hosts[*rank], "device": device, "work": work })
        };
        self.bye.iter().map(of_rank).collect()
    }
}

/// Reason to refuse a flag.
const NOT_HERE: &str = "it is for a rendering by one process; leave it out";

/// Refuses flags that concern a rendering by one process.
fn refuse_flags(flags: &[(bool, &'static str)]) -> Result<()> {
    match flags.iter().find(|(given, _)| *given) {
        Some((_, name)) => Err(Error::Setting { name, message: String::from(NOT_HERE) }),
        None => Ok(()),
    }
}

/// Frames of an animation that are written.
struct Written(Arc<Mutex<Passes>>);

impl Written {
    /// None yet. At an interrupt it tells which frames of a part are missing, at once and whatever the master waits for: where a rank was
    /// killed the launcher ends the others within a second or two, and a message that the rank had begun to send never comes to its end.
    fn watch(args: &Animate, part: Range<usize>) -> (Written, Arc<AtomicBool>) {
        let written = Arc::new(Mutex::new(Passes::default()));
        let of = args
            .play
            .frames
            .as_ref()
            .and_then(|frames| frames.count)
            .map_or(String::new(), |count| format!("/{count}"));
        let kept = written.clone();
        let interrupted = watch_and_tell(move || {
            let done = kept.lock().unwrap_or_else(PoisonError::into_inner).clone();
            let missing: Passes =
                done.missing_below(part.end as u32).iter().filter(|&n| n as usize >= part.start).collect();
            let Some(first) = missing.iter().next() else { return };
            let end = missing.end();
            say_aside(&format!("of the frames {missing} are missing; --frames {first}..{end}{of} renders them"));
        });
        (Written(written), interrupted)
    }

    /// Adds a frame.
    fn add(&self, frame: u32) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).add(frame);
    }
}

/// Checks that outputs can be written, and claims them until the result is dropped.
fn claim(files: &[PathBuf]) -> Result<output::Claim> {
    files.iter().try_for_each(|file| output::check_writable(file))?;
    output::claim(files.iter().map(PathBuf::as_path))
}

/// Processor seconds of this process since a time.
fn processor_since(start: ProcessTime) -> f64 {
    start.elapsed().as_secs_f64()
}
