//! Checkpoints: the state of a rendering in a file that is renewed while it runs, so that a killed run loses little.

use crate::render::count;
use crate::say_aside;
use lightsum::output::State;
use lightsum::radiosity::Growth;
use lightsum::settings::Traversal;
use lightsum::standalone::Renderer;
use lightsum::{Error, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Work that can be kept and gone on with.
pub trait Progressive {
    /// Whether there is anything to keep.
    fn is_begun(&self) -> bool;
    /// The finished work in words.
    fn done(&self) -> String;
    /// The state.
    fn state(&self) -> Result<State>;
}

impl Progressive for Renderer {
    fn is_begun(&self) -> bool {
        self.passes() > 0
    }

    fn done(&self) -> String {
        count(self.passes())
    }

    fn state(&self) -> Result<State> {
        let [width, height] = self.engine().view().size();
        let accumulators = self.save_state()?;
        let (fingerprint, provenance) = (self.fingerprint(), self.provenance());
        Ok(State { fingerprint, provenance, width, height, passes: self.passes(), accumulators })
    }
}

impl Progressive for Growth<'_> {
    fn is_begun(&self) -> bool {
        self.has_light()
    }

    fn done(&self) -> String {
        match self.rounds() {
            0 => String::from("a part of the first round"),
            1 => String::from("1 round"),
            rounds => format!("{rounds} rounds"),
        }
    }

    fn state(&self) -> Result<State> {
        Growth::state(self)
    }
}

/// The state in a file, if there is one.
pub fn earlier(path: &Path) -> Result<Option<State>> {
    path.exists().then(|| State::read(path)).transpose()
}

/// The traversal kernel of the first of these state files that is there.
pub fn earlier_traversal<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<Option<Traversal>> {
    let first = paths.into_iter().find(|path| path.exists());
    Ok(first.map(|path| State::read(path)).transpose()?.map(|state| state.provenance.traversal))
}

/// Goes on after the passes of a state.
pub fn go_on(path: &Path, state: &State, renderer: &mut Renderer) -> Result<()> {
    state.check(path, renderer.fingerprint(), renderer.engine().view().size(), &renderer.provenance())?;
    renderer.load_state(state.passes, &state.accumulators)?;
    log::info!("{}: going on after {} passes", path.display(), state.passes);
    Ok(())
}

/// Checks before the first pass whether the file system of a file has room for `bytes`, as far as it tells: for a user without privileges, and
/// without quotas. Errors: [`Error::File`] with the room that is left.
pub fn check_room(path: &Path, bytes: u64) -> Result<()> {
    #[cfg(unix)]
    {
        let real = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        let folder = real.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // Of some file systems of networks and users nothing is known.
        if let Ok(system) = rustix::fs::statvfs(folder)
            && system.f_blocks > 0
        {
            let free = system.f_bavail.saturating_mul(system.f_frsize);
            if free < bytes {
                let [free, needed] = [free, bytes].map(|bytes| bytes as f64 / f64::from(1 << 20));
                let message = format!(
                    "takes {needed:.1} MiB, and its file system has {free:.1} MiB free; make room, or give another folder"
                );
                return Err(Error::file(path, message));
            }
        }
    }
    Ok(())
}

/// The state file of a rendering.
pub struct Checkpoints {
    path: Option<PathBuf>,
    /// Another place, if its own did not take it.
    instead: Option<PathBuf>,
    /// Time between two checkpoints; `None`: there are none.
    every: Option<Duration>,
    last: Instant,
    /// The work in the file in words, if this run wrote it.
    written: Option<String>,
}

impl Checkpoints {
    /// `path`: the file; `None`: the rendering has no output to write it beside.
    pub fn new(path: Option<&Path>, every: Option<Duration>) -> Checkpoints {
        Checkpoints { path: path.map(Path::to_path_buf), instead: None, every, last: Instant::now(), written: None }
    }

    /// The file.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// Whether this run wrote the state.
    pub fn is_written(&self) -> bool {
        self.written.is_some()
    }

    /// The state in the file, if this run wrote it.
    pub fn latest(&self) -> Result<Option<(&Path, State)>> {
        match (&self.path, &self.written) {
            (Some(path), Some(_)) => Ok(Some((path, State::read(path)?))),
            _ => Ok(None),
        }
    }

    /// Writes the state if the last checkpoint is old enough. A failure is told, and the rendering goes on: the next
    /// checkpoint may succeed.
    pub fn after_pass(&mut self, work: &impl Progressive) {
        if self.every.is_none_or(|every| self.last.elapsed() < every) {
            return;
        }
        if let Err(error) = self.write(work) {
            log::warn!("no checkpoint after {}, rendering goes on: {error}", work.done());
        }
        self.last = Instant::now();
    }

    /// Writes the state; nothing without an output.
    pub fn write(&mut self, work: &impl Progressive) -> Result<()> {
        self.path.clone().map_or(Ok(()), |path| self.write_to(&path, work))
    }

    fn write_to(&mut self, path: &Path, work: &impl Progressive) -> Result<()> {
        work.state()?.write(path)?;
        self.written = Some(work.done());
        Ok(())
    }

    /// Writes the state, in the folder for temporary files where its own place does not take it, and tells how to go on.
    pub fn rescue(&mut self, work: &impl Progressive) {
        if !work.is_begun() {
            return;
        }
        if let Err(error) = self.write(work) {
            log::warn!("{error}");
            let name = self.path.as_ref().and_then(|path| path.file_name());
            let Some(instead) = name.map(|name| std::env::temp_dir().join(name)) else { return };
            match self.write_to(&instead, work) {
                Ok(()) => self.instead = Some(instead),
                Err(error) => log::warn!("{error}"),
            }
        }
        self.tell();
    }

    /// Tells how to go on from the file, if this run wrote it.
    pub fn tell(&self) {
        let (Some(path), Some(done)) = (&self.path, &self.written) else { return };
        let path = path.display();
        match &self.instead {
            None => say_aside(&format!("the state after {done} is in {path}; the same command with --resume goes on")),
            Some(instead) => say_aside(&format!(
                "the state after {done} is in {}; moved to {path}, the same command with --resume goes on",
                instead.display()
            )),
        }
    }

    /// Removes the file if this run wrote it: the rendering is done.
    pub fn remove(&self) {
        if let (Some(path), Some(_)) = (&self.path, &self.written)
            && let Err(error) = std::fs::remove_file(path)
        {
            log::warn!("removing {}: {error}", path.display());
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn room_is_looked_for_in_the_folder() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.state");
        check_room(&path, 1).unwrap();
        let message = check_room(&path, 1 << 62).unwrap_err().to_string();
        assert!(message.contains("a.state") && message.contains("MiB free"), "{message}");
    }
}
