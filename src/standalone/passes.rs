//! One pass of a renderer: submitted, waited for, and repeated where rays ran out of steps or pixels are no numbers.

use std::time::Instant;

use super::{MAX_ROUNDS, PassTimes, Renderer};
use crate::cluster::points::{PassPoints, PointReader, TaskPoints};
use crate::engine::{Engine, Part};
use crate::error::{Error, Result};
use crate::estimate::History;
use crate::frame::Frame;
use crate::gpu::{Buffer, Context, Memory, Recorder};
use crate::pass::List;
use crate::pass::layout::DispatchCounts;
use crate::plan::{INSTANCES, trace_steps};
use crate::view::Task;

/// Maximum number of passes in a row that are left out because some pixel is no number.
const MAX_LEFT_OUT: u32 = 8;

/// Which passes a rendering has.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Numbers {
    /// One after the other; where one is left out the next takes its place.
    InTurn,
    /// One of a given number alone.
    One,
}

/// The lists whose lengths are read back: shading points of each bounce, eye paths, photons that continue, photons in
/// their grid.
fn counted_lists(frame: &Frame) -> impl Iterator<Item = &List> {
    let of_photons = frame.photons.iter().flat_map(|photons| photons.lists.iter().chain([&photons.grid.list]));
    frame.point_lists().chain(&frame.eye.lists).chain(of_photons)
}

impl Renderer {
    /// Renders one pass and adds it to the image. Rays that run out of steps get more rounds, and the pass is repeated. A pass with a
    /// pixel that is no number is left out and repeated with the next sequence number.
    ///
    /// Errors leave the sums of the passes before: [`Error::NoNumber`] if several passes in a row are left out; those of the device.
    pub fn pass(&mut self) -> Result<()> {
        self.pass_with(None, Numbers::InTurn, &Part::Whole).map(drop)
    }

    /// Renders the pass of a number and adds it to the sums, whatever passes they have: films of disjoint passes merge to that of all.
    /// Returns whether it is in them; a pass with a pixel that is no number is left out. Passes that are not in turn tell nothing of their
    /// error, so that [`Renderer::error_estimate`] is `None` from then on, and [`Renderer::passes`] is one more than the last number.
    ///
    /// Errors: those of the device, which leave the sums of the passes before.
    pub fn pass_of(&mut self, number: u32) -> Result<bool> {
        self.history = None;
        self.skipped = 0;
        self.engine.seek(number, false);
        self.pass_with(None, Numbers::One, &Part::Whole)
    }

    /// Shades the pixels of a task in the pass of a number, for [`Renderer::pass_from`] elsewhere. The film stays as it is.
    ///
    /// Errors: pixels that depend on others of the image ([`View::check_tasks`](crate::view::View::check_tasks), [`Task::check`]); those of the device.
    pub fn points_of(&mut self, number: u32, task: &Task) -> Result<TaskPoints> {
        self.engine.apply_edits()?;
        let plan = self.engine.plan();
        plan.view.check_tasks(&plan.settings)?;
        task.check(&plan.settings, plan.view.size())?;
        loop {
            self.engine.seek(number, false);
            let reader = PointReader::new(&self.context, &self.engine, task)?;
            let (engine, status) = (&mut self.engine, &self.readback);
            let submitted = self.context.submit_and_wait(&format!("in pass {number}"), None, |rec| {
                engine.record_part(rec, &Part::Points(task))?;
                rec.copy_range(&engine.frame().status, 0, status, 0, 16)?;
                reader.record(rec, engine.frame())
            });
            if let Err(error) = submitted {
                self.engine.seek(number, true);
                return Err(error);
            }
            let lost = self.readback.read::<u32>()?[0];
            if lost == 0 {
                self.engine.setup_finished();
                self.check_messages()?;
                return reader.read(&self.engine);
            }
            self.more_rounds(number, lost)?;
        }
    }

    /// Writes points where the device reads them, which [`Renderer::pass_from`] does otherwise. Errors: some are missing.
    pub fn prepare(&mut self, points: &mut PassPoints) -> Result<()> {
        self.engine.apply_edits()?;
        points.prepare(&self.context, self.engine.frame())
    }

    /// [`Renderer::pass_of`] with points that others have shaded.
    pub fn pass_from(&mut self, number: u32, points: &mut PassPoints) -> Result<bool> {
        self.engine.apply_edits()?;
        self.engine.view().check_tasks(&self.engine.plan().settings)?;
        self.history = None;
        self.skipped = 0;
        self.engine.seek(number, false);
        let taken = points.stage(&self.context, self.engine.frame())?;
        self.pass_with(None, Numbers::One, &Part::Rest(&taken))
    }

    /// [`Renderer::pass`], unless `stop` says otherwise: it is asked before the pass and every few dispatches. Returns whether the pass is
    /// in the image; one that was broken off is not, and the next pass takes its number.
    pub fn pass_unless(&mut self, stop: &dyn Fn() -> bool) -> Result<bool> {
        Ok(!stop() && self.pass_with(Some(stop), Numbers::InTurn, &Part::Whole)?)
    }

    fn pass_with(&mut self, stop: Option<&dyn Fn() -> bool>, numbers: Numbers, part: &Part) -> Result<bool> {
        let start = Instant::now();
        self.engine.apply_edits()?;
        if self.readback.bytes() != readback_bytes(&self.engine) {
            // Edits may change the number of lists.
            self.readback = readback(&self.context, &self.engine)?;
        }
        let rays = self.rays;
        if self.engine.passes() == 0 && numbers == Numbers::InTurn {
            // Its first pass, or a restart.
            // Images of a ring come and go, which tells nothing of their error.
            self.history = self.engine.settings().ring.is_none().then(History::default);
            self.skipped = 0;
        }
        let mut left_out = 0;
        let probed = counts_bytes(&self.engine);
        let mut recording = 0.0;
        loop {
            let number = self.engine.passes();
            let (engine, readback) = (&mut self.engine, &self.readback);
            let record = |rec: &mut Recorder| {
                let start = Instant::now();
                engine.record_part(rec, part)?;
                recording += start.elapsed().as_secs_f64();
                let frame = engine.frame();
                rec.copy_range(&frame.status, 0, readback, 0, 16)?;
                for (i, list) in counted_lists(frame).enumerate() {
                    let bytes = size_of::<DispatchCounts>() as u64;
                    rec.copy_range(&list.work, 0, readback, 16 + i as u64 * bytes, bytes)?;
                }
                let output = &frame.output;
                output.record_probe(rec, number % INSTANCES)?;
                rec.copy_range(output.probed(), 0, readback, probed, output.probed().bytes())
            };
            let (what, timers) = (format!("in pass {number}"), Some(&self.timers));
            let submitted = match stop {
                None => self.context.submit_and_wait(&what, timers, record).map(|()| true),
                Some(stop) => self.context.submit_unless(&what, timers, stop, record),
            };
            if !matches!(submitted, Ok(true)) {
                // The film does not have a pass that failed or was broken off.
                self.take_back(number, numbers);
                return submitted;
            }
            let words = self.readback.read::<u32>()?;
            let (counts, sums) = words.split_at(probed as usize / 4);
            let [lost, no_numbers, last] = [counts[0], counts[1], counts[2]];
            if lost == 0 && no_numbers > 0 {
                left_out += 1;
                self.skipped += 1;
                self.left_out += 1;
                let width = self.engine.view().size()[0];
                let at = [last.saturating_sub(1) % width, last.saturating_sub(1) / width];
                let instead = if numbers == Numbers::One { "" } else { "; another takes its place" };
                log::warn!(
                    "pass {number} is left out: {no_numbers} of its pixels are no numbers, such as {},{}{instead}",
                    at[0],
                    at[1]
                );
                if numbers == Numbers::One {
                    return Ok(false);
                }
                if left_out == MAX_LEFT_OUT {
                    return Err(Error::NoNumber { passes: left_out, pixels: no_numbers, at });
                }
                continue;
            }
            if lost == 0 {
                if matches!(part, Part::Whole) {
                    self.count_rays(&counts[4..]);
                }
                if let Some(history) = &mut self.history {
                    history.add(number % INSTANCES, bytemuck::cast_slice(sums));
                }
                break;
            }
            self.take_back(number, numbers);
            self.more_rounds(number, lost)?;
        }
        self.engine.setup_finished();
        self.check_messages()?;
        let gpu_passes = self.timers.read()?;
        for (name, seconds) in &gpu_passes {
            match self.gpu_passes.iter_mut().find(|(n, _)| n == name) {
                Some((_, sum)) => *sum += seconds,
                None => self.gpu_passes.push((name.clone(), *seconds)),
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        self.last_pass = PassTimes { seconds, record: recording, gpu_passes, rays: self.rays - rays };
        self.add_stage("render", start);
        self.rendered += 1;
        Ok(true)
    }

    /// Gives rays more rounds after `lost` of them ran out of steps.
    fn more_rounds(&mut self, number: u32, lost: u32) -> Result<()> {
        let rounds = self.engine.settings().rounds;
        if rounds >= MAX_ROUNDS {
            let steps = u64::from(rounds) * u64::from(trace_steps(self.engine.settings().loop_budget));
            return Err(Error::Unfinished { pass: "shade or trace", rays: lost, steps });
        }
        log::info!("{lost} rays ran out of steps in pass {number}; going on with {} rounds", 4 * rounds);
        self.engine.set_rounds((4 * rounds).min(MAX_ROUNDS))
    }

    /// Messages of the validation layer are errors.
    fn check_messages(&self) -> Result<()> {
        match self.context.take_messages().first() {
            None => Ok(()),
            Some(message) => {
                let name = format!("pass {}", self.engine.passes() - 1);
                Err(Error::Resource { name, message: format!("validation: {message}") })
            }
        }
    }

    /// Makes a pass the next one again that is not in the film.
    fn take_back(&mut self, number: u32, numbers: Numbers) {
        match numbers {
            Numbers::InTurn => self.engine.set_passes(number),
            Numbers::One => self.engine.seek(number, true),
        }
    }

    /// Adds the rays of a pass: eye rays, particles, shadow and gather rays of the shading points of each bounce, and
    /// continuations at mirrors and glass, of photons too. Also counts the stored photons.
    fn count_rays(&mut self, work: &[u32]) {
        let [width, height] = self.engine.view().size();
        // Clusters choose the lights of their points from those that are left.
        let (plan, chosen) = (&self.engine.plan().lights, &self.engine.plan().lists);
        let classes = u64::from(self.engine.plan().settings.classes());
        let mut rays = u64::from(width) * u64::from(height)
            + plan.survivors.iter().skip(1).map(|&n| u64::from(n) * classes).sum::<u64>();
        let frame = self.engine.frame();
        let bounces = frame.point_lists().count();
        let grid = frame.photons.as_ref().map(|photons| {
            rays += u64::from(photons.count);
            bounces + frame.eye.lists.len() + photons.lists.len()
        });
        for (b, work) in work.chunks(size_of::<DispatchCounts>() / 4).enumerate() {
            let live = u64::from(work[0]);
            if Some(b) == grid {
                self.photons += live;
                continue;
            }
            if b >= bounces {
                rays += live;
                continue;
            }
            self.culled += u64::from(work[3]);
            let reflections = plan.survivors.len().saturating_sub(b);
            rays += live * u64::from(chosen.first_slot(reflections)) + if b + 1 < bounces { live } else { 0 };
        }
        self.rays += rays;
    }

    pub(super) fn add_stage(&mut self, name: &str, start: Instant) {
        let seconds = start.elapsed().as_secs_f64();
        match self.stages.iter_mut().find(|(n, _)| n == name) {
            Some((_, sum)) => *sum += seconds,
            None => self.stages.push((name.to_owned(), seconds)),
        }
    }
}

/// Bytes of the status and of the work of all lists.
fn counts_bytes(engine: &Engine) -> u64 {
    16 + (counted_lists(engine.frame()).count() * size_of::<DispatchCounts>()) as u64
}

/// Bytes read back after each pass: counts, then the probed sums.
fn readback_bytes(engine: &Engine) -> u64 {
    counts_bytes(engine) + engine.frame().output.probed().bytes()
}

pub(super) fn readback(context: &Context, engine: &Engine) -> Result<Buffer> {
    Buffer::new(context, "counts and sums read back", readback_bytes(engine), Memory::Readback)
}
