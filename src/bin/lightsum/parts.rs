//! Views of a bake that are rendered one after the other, each with a state of its own.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use lightsum::output::{Layers, State};
use lightsum::standalone::Renderer;
use lightsum::{Error, Result};

use crate::args;
use crate::checkpoint::{Checkpoints, Progressive, earlier, go_on};
use crate::progress::Progress;
use crate::stop::{Clock, Stop, error_is_due, error_of};

/// The image of a view and the number of passes in it.
pub type Image = (Layers, u32);

/// Makes the renderer of a view; that of another view leaves it scene and kernels.
pub type RendererOf<'a> = dyn Fn(usize, Option<Renderer>) -> Result<Renderer> + 'a;

/// The states of a bake, which outlast the loss of a device.
pub struct States {
    all: Vec<Checkpoints>,
    resume: bool,
    /// Time between two checkpoints of a state.
    every: Option<Duration>,
}

impl States {
    /// None yet, of the bake that the flags ask for.
    pub fn new(args: &args::Bake) -> States {
        States { all: Vec::new(), resume: args.stop.resume, every: args.stop.checkpoint.0 }
    }

    /// The state of this file.
    pub fn of(&mut self, path: &Path) -> &mut Checkpoints {
        let at = self.all.iter().position(|states| states.path() == Some(path)).unwrap_or_else(|| {
            self.all.push(Checkpoints::new(Some(path), self.every));
            self.all.len() - 1
        });
        &mut self.all[at]
    }

    /// The state that rendering goes on from: the one that this run wrote before its device was lost, or with --resume that of an earlier run.
    pub fn earlier(&mut self, path: &Path) -> Result<Option<State>> {
        if let Some((_, state)) = self.of(path).latest()? {
            return Ok(Some(state));
        }
        if self.resume { earlier(path) } else { Ok(None) }
    }

    /// Writes the state, if a later run may need it.
    pub fn keep(&mut self, path: &Path, work: &impl Progressive) -> Result<()> {
        if self.resume { self.of(path).write(work) } else { Ok(()) }
    }

    /// After an error or an interrupt: writes the state in whatever place takes it, and tells how to go on. A lost device gives none.
    pub fn rescue(&mut self, path: &Path, work: &impl Progressive, error: Option<&Error>) {
        if !matches!(error, Some(Error::DeviceLost { .. })) {
            self.of(path).rescue(work);
        }
    }

    /// Tells how to go on from the file that was written last.
    pub fn tell(&self) {
        self.all.iter().rev().find(|states| states.is_written()).into_iter().for_each(Checkpoints::tell);
    }

    /// Removes the files that this run wrote, unless a later one shall go on from them.
    pub fn remove(&self) {
        if !self.resume {
            self.all.iter().for_each(Checkpoints::remove);
        }
    }
}

/// A view to be rendered.
pub struct View {
    /// Points in it.
    pub points: usize,
    /// Its state.
    pub state: PathBuf,
}

/// Path of the state of part `i` of an output: `OUTPUT.0.state` and so on.
pub fn part_path(output: &Path, i: usize) -> PathBuf {
    let mut name = OsString::from(output);
    name.push(format!(".{i}"));
    State::path_for(Path::new(&name))
}

/// The views of a bake being rendered.
pub struct Job<'a> {
    views: Vec<View>,
    clock: &'a Clock<'a>,
    progress: &'a mut Progress,
    states: &'a mut States,
    /// Fraction of all work that was done before.
    before: f64,
    /// The fewest passes of a view, with those before its own.
    pub passes: u32,
    /// The greatest estimated error of a view.
    pub error: Option<f32>,
}

impl<'a> Job<'a> {
    /// Views of a bake. `before`: fraction of the work that is done already.
    pub fn new(
        views: Vec<View>,
        clock: &'a Clock,
        states: &'a mut States,
        progress: &'a mut Progress,
        before: f64,
    ) -> Job<'a> {
        Job { views, clock, states, progress, before, passes: 0, error: None }
    }

    /// Renders all views, one after the other, each by a renderer after `first` passes, made from the one before. Returns their images with the numbers of passes
    /// in them, `None` for a view without. An interrupt keeps the states of those that have begun.
    pub fn run(&mut self, first: u32, renderer: &RendererOf) -> Result<Vec<Option<Image>>> {
        let total = self.views.iter().map(|view| view.points).sum::<usize>().max(1) as f64;
        let stop = self.clock.left();
        let (mut images, mut done) = (vec![None; self.views.len()], 0.0);
        let (mut last, mut begun) = (None, false);
        for (i, image) in images.iter_mut().enumerate() {
            let share = self.views[i].points as f64 / total;
            let mut renderer = renderer(i, last.take())?;
            let path = self.views[i].state.clone();
            if let Some(state) = self.states.earlier(&path)? {
                go_on(&path, &state, &mut renderer)?;
            }
            if let Err(error) = self.view(&mut renderer, i, (stop.of_share(share), done, share)) {
                self.states.rescue(&path, &renderer, Some(&error));
                return Err(error);
            }
            let broken_off = self.clock.is_interrupted();
            if renderer.passes() == first {
                if broken_off {
                    break;
                }
                // There was no time.
                last = Some(renderer);
                continue;
            }
            if broken_off {
                self.states.rescue(&path, &renderer, None);
            } else if self.views.len() > 1 {
                self.states.of(&path).write(&renderer)?;
            } else {
                self.states.keep(&path, &renderer)?;
            }
            self.passes = if begun { self.passes.min(renderer.passes()) } else { renderer.passes() };
            begun = true;
            let error = error_of(&renderer)?;
            log::info!("part {}: {} passes, estimated error {error:?}", i + 1, renderer.passes());
            self.error = error.map(|e| self.error.map_or(e, |other| other.max(e)));
            *image = Some((renderer.layers()?, renderer.passes() - first));
            if broken_off {
                break;
            }
            done += share;
            last = Some(renderer);
        }
        self.progress.finish();
        Ok(images)
    }

    /// Runs the passes of view `i`, which has `share` of the points; `done`: the share of those before.
    fn view(&mut self, renderer: &mut Renderer, i: usize, (stop, done, share): (Stop, f64, f64)) -> Result<()> {
        let (start, before) = (Instant::now(), renderer.passes());
        let mut error = error_of(renderer)?;
        loop {
            let (passes, elapsed) = (renderer.passes(), start.elapsed());
            if self.clock.is_interrupted() || passes > 0 && stop.reached(passes, elapsed, error) {
                return Ok(());
            }
            // A pass that is broken off does not count.
            let late = || self.clock.is_interrupted() || passes > 0 && stop.is_late(start.elapsed());
            if !renderer.pass_unless(&late)? {
                return Ok(());
            }
            self.states.of(&self.views[i].state).after_pass(renderer);
            let passes = renderer.passes();
            if error_is_due(passes) {
                error = error_of(renderer)?;
            }
            let text = || {
                let rate = f64::from(passes - before) / start.elapsed().as_secs_f64().max(1e-9);
                let error = error.map(|e| format!(", error {e:.4}")).unwrap_or_default();
                let part = match self.views.len() {
                    1 => String::new(),
                    n => format!("part {} of {n}, ", i + 1),
                };
                format!("{part}{passes} passes, {rate:.2} passes/s{error}")
            };
            let fraction = done + share * stop.fraction(passes, passes - before, start.elapsed(), error);
            self.progress.show(text, self.before + (1.0 - self.before) * fraction);
        }
    }
}

impl Stop {
    /// The conditions for a part of the work: with a part of the time.
    fn of_share(&self, share: f64) -> Stop {
        self.with_time(|time| Duration::from_secs_f64(time.as_secs_f64() * share))
    }
}
