//! Checkpoints: the state of a rendering in a file that is renewed while it runs, so that a killed run loses little.

use crate::say_aside;
use lightsum::Result;
use lightsum::output::State;
use lightsum::standalone::Renderer;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The state file of a rendering.
pub struct Checkpoints {
    path: Option<PathBuf>,
    /// Another place, if its own did not take it.
    instead: Option<PathBuf>,
    /// Time between two checkpoints; `None`: there are none.
    every: Option<Duration>,
    last: Instant,
    /// Passes in the file, if this run wrote it.
    written: Option<u32>,
}

impl Checkpoints {
    /// `path`: the file; `None`: the rendering has no output to write it beside.
    pub fn new(path: Option<&Path>, every: Option<Duration>) -> Checkpoints {
        Checkpoints { path: path.map(Path::to_path_buf), instead: None, every, last: Instant::now(), written: None }
    }

    /// Writes the state if the last checkpoint is old enough. A failure is told, and the rendering goes on: the next
    /// checkpoint may succeed.
    pub fn after_pass(&mut self, renderer: &Renderer) {
        if self.every.is_none_or(|every| self.last.elapsed() < every) {
            return;
        }
        if let Err(error) = self.write(renderer) {
            log::warn!("no checkpoint after {} passes, rendering goes on: {error}", renderer.passes());
        }
        self.last = Instant::now();
    }

    /// Writes the state; nothing without an output.
    pub fn write(&mut self, renderer: &Renderer) -> Result<()> {
        self.path.clone().map_or(Ok(()), |path| self.write_to(&path, renderer))
    }

    fn write_to(&mut self, path: &Path, renderer: &Renderer) -> Result<()> {
        let [width, height] = renderer.engine().view().size();
        let (fingerprint, passes) = (renderer.fingerprint(), renderer.passes());
        let accumulators = renderer.save_state()?;
        State { fingerprint, width, height, passes, accumulators }.write(path)?;
        self.written = Some(passes);
        Ok(())
    }

    /// Writes the state, in the folder for temporary files where its own place does not take it, and tells how to go on.
    pub fn rescue(&mut self, renderer: &Renderer) {
        if renderer.passes() == 0 {
            return;
        }
        if let Err(error) = self.write(renderer) {
            log::warn!("{error}");
            let name = self.path.as_ref().and_then(|path| path.file_name());
            let Some(instead) = name.map(|name| std::env::temp_dir().join(name)) else { return };
            match self.write_to(&instead, renderer) {
                Ok(()) => self.instead = Some(instead),
                Err(error) => log::warn!("{error}"),
            }
        }
        self.tell();
    }

    /// Tells how to go on from the file, if this run wrote it.
    pub fn tell(&self) {
        let (Some(path), Some(passes)) = (&self.path, self.written) else { return };
        let path = path.display();
        match &self.instead {
            None => say_aside(&format!(
                "the state after {passes} passes is in {path}; the same command with --resume goes on"
            )),
            Some(instead) => say_aside(&format!(
                "the state after {passes} passes is in {}; moved to {path}, the same command with --resume goes on",
                instead.display()
            )),
        }
    }

    /// Removes the file if this run wrote it: the rendering is done.
    pub fn remove(&self) {
        if let (Some(path), Some(_)) = (&self.path, self.written)
            && let Err(error) = std::fs::remove_file(path)
        {
            log::warn!("removing {}: {error}", path.display());
        }
    }
}
