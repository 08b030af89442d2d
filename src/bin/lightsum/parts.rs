//! Views of a bake that are rendered one after the other, each with a state of its own.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use lightsum::Result;
use lightsum::output::{Layers, State};
use lightsum::standalone::Renderer;

use crate::args;
use crate::checkpoint::{Checkpoints, earlier, go_on};
use crate::progress::Progress;
use crate::stop::{Clock, Stop, error_is_due, error_of};

/// The image of a view and the number of passes in it.
pub type Image = (Layers, u32);

/// Makes the renderer of a view; that of another view leaves it scene and kernels.
pub type RendererOf<'a> = dyn Fn(usize, Option<Renderer>) -> Result<Renderer> + 'a;

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
    resume: bool,
    /// Time between two checkpoints of a view.
    checkpoint: Option<Duration>,
    progress: &'a mut Progress,
    /// The states of the views that have begun.
    states: Vec<Checkpoints>,
    /// Fraction of all work that was done before.
    before: f64,
    /// The fewest passes of a view, with those before its own.
    pub passes: u32,
    /// The greatest estimated error of a view.
    pub error: Option<f32>,
}

impl<'a> Job<'a> {
    /// Views of the bake that the flags ask for. `before`: fraction of the work that is done already.
    pub fn new(
        args: &args::Bake,
        views: Vec<View>,
        clock: &'a Clock,
        progress: &'a mut Progress,
        before: f64,
    ) -> Job<'a> {
        Job {
            views,
            clock,
            resume: args.stop.resume,
            checkpoint: args.stop.checkpoint.0,
            progress,
            states: Vec::new(),
            before,
            passes: 0,
            error: None,
        }
    }

    /// Renders all views, one after the other, each by a renderer after `first` passes, made from the one before. Returns their images with the numbers of passes
    /// in them, `None` for a view without. An interrupt keeps the states of those that have begun.
    pub fn run(&mut self, first: u32, renderer: &RendererOf) -> Result<Vec<Option<Image>>> {
        let total = self.views.iter().map(|view| view.points).sum::<usize>().max(1) as f64;
        let stop = self.clock.left();
        let (mut images, mut done) = (vec![None; self.views.len()], 0.0);
        let mut last = None;
        for (i, image) in images.iter_mut().enumerate() {
            let share = self.views[i].points as f64 / total;
            let mut renderer = renderer(i, last.take())?;
            let path = self.views[i].state.clone();
            if self.resume
                && let Some(state) = earlier(&path)?
            {
                go_on(&path, &state, &mut renderer)?;
            }
            let mut states = Checkpoints::new(Some(&path), self.checkpoint);
            if let Err(error) = self.view(&mut renderer, &mut states, i, (stop.of_share(share), done, share)) {
                states.rescue(&renderer);
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
                states.rescue(&renderer);
            } else if self.resume || self.views.len() > 1 {
                states.write(&renderer)?;
            }
            self.passes = if self.states.is_empty() { renderer.passes() } else { self.passes.min(renderer.passes()) };
            let error = error_of(&renderer)?;
            log::info!("part {}: {} passes, estimated error {error:?}", i + 1, renderer.passes());
            self.error = error.map(|e| self.error.map_or(e, |other| other.max(e)));
            self.states.push(states);
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
    fn view(
        &mut self,
        renderer: &mut Renderer,
        states: &mut Checkpoints,
        i: usize,
        (stop, done, share): (Stop, f64, f64),
    ) -> Result<()> {
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
            states.after_pass(renderer);
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

    /// Removes the states that this run wrote, unless they are to be kept.
    pub fn remove_states(&self) {
        if !self.resume && !self.clock.is_interrupted() {
            self.states.iter().for_each(Checkpoints::remove);
        }
    }
}

impl Stop {
    /// The conditions for a part of the work: with a part of the time.
    fn of_share(&self, share: f64) -> Stop {
        self.with_time(|time| Duration::from_secs_f64(time.as_secs_f64() * share))
    }
}
