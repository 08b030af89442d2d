//! Looks whether the image of a pass is made of numbers, adds it to the film or to a ring, turns the film's mean into an image, and copies sums for the error estimate.

use super::Seen;
use crate::error::Result;
use crate::film::Film;
use crate::gpu::{Buffer, Image, Recorder};
use crate::pass::accumulate::Accumulate;
use crate::pass::finite::Finite;
use crate::pass::layout::FrameParameters;
use crate::pass::probe::Probe;
use crate::pass::resolve::Resolve;
use crate::pass::ring::Ring;
use crate::pass::{Kit, Lighting};

/// How a pass enters the film.
enum Sum {
    /// It is added.
    Film(Accumulate),
    /// It replaces the oldest.
    Ring(Ring),
}

/// The stage.
pub struct Output {
    /// Running sums.
    pub film: Film,
    /// The image for the host.
    pub image: Image,
    finite: Finite,
    sum: Sum,
    resolve: Resolve,
    probe: Probe,
}

impl Output {
    /// Adds what is seen, lit by `lighting`, to `film`. `summands`: light of second components that
    /// is summed apart.
    pub fn new(
        kit: &Kit,
        Seen { points, paths, .. }: Seen,
        lighting: &Lighting,
        summands: Option<&Buffer>,
        (film, image): (Film, Image),
    ) -> Result<Output> {
        Ok(Output {
            finite: Finite::new(kit, points, paths, lighting, summands, film.pixels())?,
            sum: match &film.ring {
                Some(images) => Sum::Ring(Ring::new(kit, (points, paths, lighting), &film, images)?),
                None => Sum::Film(Accumulate::new(kit, points, paths, lighting, &film)?),
            },
            resolve: Resolve::new(kit.context, &film, &image)?,
            probe: Probe::new(kit, &film)?,
            film,
            image,
        })
    }

    /// Records the clearing of the sums.
    pub fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        self.film.buffers().try_for_each(|buffer| rec.fill(buffer, 0))
    }

    /// Records the count of pixels whose values are no numbers, before anything is added to sums.
    pub fn record_check(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope("finite", |rec| self.finite.record(rec))
    }

    /// Records the addition of a pass to the sums of its instance, or to the ring.
    pub fn record_accumulate(&self, rec: &mut Recorder, parameters: &FrameParameters) -> Result<()> {
        match &self.sum {
            Sum::Film(accumulate) => rec.scope("accumulate", |rec| accumulate.record(rec, parameters.instance())),
            Sum::Ring(ring) => rec.scope("ring", |rec| ring.record(rec, parameters.size[3])),
        }
    }

    /// Records the mean of all passes into the image.
    pub fn record_resolve(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope("resolve", |rec| self.resolve.record(rec))
    }

    /// Records the copy of an instance's sums at a few pixels into [`Output::probed`].
    pub fn record_probe(&self, rec: &mut Recorder, instance: u32) -> Result<()> {
        rec.scope("probe", |rec| self.probe.record(rec, instance))
    }

    /// Sums at a few pixels, see [`crate::pass::probe`].
    pub fn probed(&self) -> &Buffer {
        &self.probe.out
    }
}
