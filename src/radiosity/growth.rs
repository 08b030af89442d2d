//! Trees under way: rounds of passes that can be broken off, kept and gone on with; then more passes over all samples.
//!
//! A few passes suffice to tell where light changes, because all points share their lights. So rounds have up to [`ROUND_PASSES`], and
//! the samples of the grown trees get the passes that are left together: [`Growth::pass`] until the trees have grown, then the passes of
//! [`Radiosity::parts`], whose light [`Part::add`] adds to the samples.

use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;

use super::Light;
use super::batches::{Batches, light, view};
use super::compute::{Progress, Radiosity, Times};
use super::refine::{Options, Place, Root, Solution};
use super::saved::{self, Saved};
use crate::error::{Error, Result};
use crate::film::HostFilm;
use crate::fingerprint::fingerprint;
use crate::output::{Layers, State};
use crate::standalone::Renderer;
use crate::view::{Atlas, Texel};

/// Points with less than this part of the mean light are tested for being inside geometry.
const DARK: f32 = 1e-3;

/// Most passes of a round of a bake; an even number, so that both instances have as many.
pub const ROUND_PASSES: u32 = 16;

/// Trees under way.
pub struct Growth<'a> {
    of: &'a Radiosity,
    roots: Vec<Root>,
    solution: Solution,
    /// Passes of a round.
    passes: u32,
    /// The samples of the round.
    places: Vec<Place>,
    batches: Batches,
    /// Mean over the points of the first round of the sum of the channels.
    mean: Option<f32>,
    /// The last round split nothing.
    done: bool,
    leaves: Vec<u32>,
    times: Times,
    start: Instant,
}

impl<'a> Growth<'a> {
    /// Trees before their first round; each round has `passes` passes.
    ///
    /// Errors: options out of range; more surfaces than elements.
    pub fn new(of: &'a Radiosity, options: &Options, passes: u32) -> Result<Growth<'a>> {
        let roots: Vec<Root> = of.surfaces().iter().map(|surface| surface.root).collect();
        let solution = Solution::new(&roots, options)?;
        let mut growth = Growth {
            of,
            roots,
            solution,
            passes,
            places: Vec::new(),
            batches: Batches::new(Vec::new(), passes),
            mean: None,
            done: false,
            leaves: of.leaves(),
            times: Times::default(),
            start: Instant::now(),
        };
        growth.begin_round();
        Ok(growth)
    }

    fn begin_round(&mut self) {
        self.places = self.solution.wanted();
        self.batches.restart(self.of.texels(&self.solution, &self.places));
    }

    /// Whether the trees have grown.
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// Whether [`Growth::solution`] has light already.
    pub fn has_light(&self) -> bool {
        !self.solution.rounds.is_empty() || self.batches.have_light()
    }

    /// Rounds that are done.
    pub fn rounds(&self) -> usize {
        self.solution.rounds.len()
    }

    /// The round under way.
    pub fn progress(&self) -> Progress {
        Progress { round: self.rounds(), points: self.places.len(), done: self.batches.share() }
    }

    /// Seconds so far.
    pub fn times(&self) -> Times {
        let Times { prepare, passes, .. } = self.times;
        Times { host: self.start.elapsed().as_secs_f64() - prepare - passes, ..self.times }
    }

    /// Renders a pass, and ends the round if that was its last one. False: `stop`, which is asked every few dispatches, broke it off,
    /// or the trees have grown.
    pub fn pass(&mut self, stop: &dyn Fn() -> bool) -> Result<bool> {
        if self.done {
            return Ok(false);
        }
        let start = Instant::now();
        self.batches.prepare(self.of)?;
        let prepared = Instant::now();
        self.times.prepare += (prepared - start).as_secs_f64();
        let passed = self.batches.pass(self.of, stop);
        self.times.passes += prepared.elapsed().as_secs_f64();
        let passed = passed?;
        if !self.batches.are_done() {
            return Ok(passed);
        }
        let found = self.batches.light()?.unwrap_or_default();
        let (seen, mean) = self.seen(found);
        self.mean = Some(mean);
        let places = std::mem::take(&mut self.places);
        self.done = self.solution.round(&self.roots, &places, seen)? == 0;
        if !self.done {
            self.begin_round();
        }
        Ok(true)
    }

    /// Light of the round's points, `None` inside of geometry, and the mean of the first round.
    fn seen(&self, found: Vec<Light>) -> (Vec<Option<Light>>, f32) {
        // The points of the first round lie everywhere.
        let mean = self.mean.unwrap_or_else(|| {
            let sum: f64 = found.iter().map(|light| f64::from(light.total().element_sum())).sum();
            (sum / found.len().max(1) as f64) as f32
        });
        let of_point = |(texel, light): (&Texel, Light)| {
            let dark = light.total().element_sum() < DARK * mean;
            let inside = dark && self.of.is_inside(&self.leaves, texel);
            (!inside).then_some(light)
        };
        (self.batches.points().par_iter().zip(found).map(of_point).collect(), mean)
    }

    /// The trees as they are. A round under way does not count, unless it is the first and all its points have a pass.
    ///
    /// Errors: [`Error::Interrupted`] if there is no light yet.
    pub fn solution(&self) -> Result<Solution> {
        let mut solution = self.solution.clone();
        if solution.rounds.is_empty() {
            let found = self.batches.light()?.ok_or(Error::Interrupted)?;
            solution.round(&self.roots, &self.places, self.seen(found).0)?;
        }
        Ok(solution)
    }

    /// Hash of all that the trees depend on.
    pub fn fingerprint(&self) -> u64 {
        let (scene, settings) = self.of.scene_and_settings();
        fingerprint(scene, &(self.solution.options(), self.passes), settings)
    }

    /// The state of the finished work, for [`Growth::go_on`].
    pub fn state(&self) -> Result<State> {
        let (found, passes, film) = self.batches.state()?;
        let now = Saved { mean: self.mean, done: self.done, found: found.to_vec(), passes, film };
        let accumulators = saved::to_bytes(&self.solution, &now);
        let rounds = self.rounds() as u32;
        let (fingerprint, provenance) = (self.fingerprint(), self.of.provenance());
        Ok(State { fingerprint, provenance, width: 0, height: 0, passes: rounds, accumulators })
    }

    /// Goes on from a state of the same scene, settings and options, which has been checked by its fingerprint.
    ///
    /// Errors: bytes that are no such state.
    pub fn go_on(&mut self, state: &State) -> Result<()> {
        let other = || Error::Scene(String::from("the saved state is not that of these trees; start without --resume"));
        let (solution, now) = saved::from_bytes(&state.accumulators, &self.solution).ok_or_else(other)?;
        self.solution = solution;
        (self.mean, self.done) = (now.mean, now.done);
        if self.done {
            self.places.clear();
            self.batches.restart(Vec::new());
            return Ok(());
        }
        self.begin_round();
        if !self.batches.go_on(self.of, now.found, now.passes, &now.film)? {
            return Err(other());
        }
        Ok(())
    }
}

/// Samples of grown trees that are rendered together.
pub struct Part {
    atlas: Arc<Atlas>,
    slots: Vec<usize>,
    places: Vec<Place>,
}

impl Part {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Adds the mean of `more` passes to samples that have the mean of `passes`.
    pub fn add(&self, solution: &mut Solution, passes: u32, layers: &Layers, more: u32) {
        let share = more as f32 / (passes + more) as f32;
        let mixed = self.places.iter().zip(light(&self.slots, layers)).map(|(&place, new)| {
            let old = solution.at(place);
            (place, Some(old + (new - old) * share))
        });
        let mixed: Vec<_> = mixed.collect();
        solution.set(mixed);
    }
}

impl Radiosity {
    /// The samples outside of geometry, in parts that fit the device.
    pub fn parts(&self, solution: &Solution) -> Vec<Part> {
        let of_part = |places: &[Place]| {
            let (atlas, slots) = view(&self.texels(solution, places));
            Part { atlas: Arc::new(atlas), slots, places: places.to_vec() }
        };
        solution.lit().chunks(self.batch_points()).map(of_part).collect()
    }

    /// A renderer of a part, whose first pass has the number `passes`: those before are in the samples. `last`: that of another part, which
    /// leaves it scene and kernels.
    pub fn renderer(&self, part: &Part, passes: u32, last: Option<Renderer>) -> Result<Renderer> {
        let mut renderer = match last {
            Some(mut renderer) => renderer.set_atlas(part.atlas.clone()).map(|()| renderer)?,
            None => self.renderer_of(part.atlas.clone())?,
        };
        let empty = vec![0; HostFilm::byte_count(part.atlas.size, false)];
        renderer.load_film(passes, &HostFilm::from_bytes(&empty, part.atlas.size, false)?)?;
        Ok(renderer)
    }
}
