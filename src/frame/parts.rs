//! The parts of a frame that every scene has, to be recorded one by one.

use super::Frame;
use crate::error::Result;
use crate::gpu::Recorder;

impl Frame {
    /// Particles leave the lights, and each leaves a point light at every vertex of its path.
    pub fn record_walk(&self, rec: &mut Recorder) -> Result<()> {
        self.record_walk_start(rec)?;
        (1..=self.steps.walk.len()).try_for_each(|j| self.record_walk_reflection(rec, j))
    }

    /// The part of [`Frame::record_walk`] up to the emitters' lights.
    pub fn record_walk_start(&self, rec: &mut Recorder) -> Result<()> {
        self.walk_start.record(rec)
    }

    /// The part of [`Frame::record_walk`] from one vertex to the next: the j-th reflection, j from 1.
    pub fn record_walk_reflection(&self, rec: &mut Recorder, j: usize) -> Result<()> {
        let Some((rounds, reflect)) = j.checked_sub(1).and_then(|i| self.steps.walk.get(i)) else { return Ok(()) };
        self.walk_trace.record(rec, rounds, Some(self.particle_count))?;
        self.walk_reflect.record(rec, *reflect, self.particle_count)
    }

    /// What the eye sees, directly and through mirrors and glass.
    pub fn record_eye(&self, rec: &mut Recorder) -> Result<()> {
        self.record_eye_rays(rec)?;
        (0..self.eye_paths.len()).try_for_each(|step| self.record_eye_step(rec, step))?;
        self.record_eye_receivers(rec)
    }

    /// The part of [`Frame::record_eye`] up to the first hits.
    pub fn record_eye_rays(&self, rec: &mut Recorder) -> Result<()> {
        self.camera_rays.record(rec)?;
        self.eye_trace.record_eye(rec, &self.steps.eye_trace, self.tile_count, self.pixels)
    }

    /// The part of [`Frame::record_eye`] from mirrors and glass to what is seen through them; steps from 0.
    pub fn record_eye_step(&self, rec: &mut Recorder, step: usize) -> Result<()> {
        let (Some(follow), Some(&number)) = (self.eye_paths.get(step), self.steps.eye_paths.get(step)) else {
            return Ok(());
        };
        if step == 0 {
            self.record_tiles(rec)?;
        }
        follow.pass.record(rec, number)?;
        follow.schedule.record(rec, self.steps.list)?;
        follow.trace.record(rec, &self.steps.list_trace, None)
    }

    /// The part of the first [`Frame::record_eye_step`] that finds out where there are mirrors and glass.
    pub fn record_tiles(&self, rec: &mut Recorder) -> Result<()> {
        self.tiles.record(rec)
    }

    /// The part of [`Frame::record_eye`] in which the last hits become receivers.
    pub fn record_eye_receivers(&self, rec: &mut Recorder) -> Result<()> {
        if let Some(clusters) = &self.clusters {
            clusters.record_clear(rec)?;
        }
        self.eye_receivers.record(rec, self.steps.bounces[0].receivers, Some(u64::from(self.tile_count)))?;
        if let Some(second) = &self.second {
            second.receivers.record(rec, self.steps.second, None)?;
        }
        match &self.clusters {
            Some(clusters) => rec.scope("clusters", |rec| clusters.record(rec, self.steps.list)),
            None => self.record_list(rec, 0),
        }
    }

    /// The list of a bounce's receivers is complete: its length becomes dispatches, and neighbours are brought together.
    fn record_list(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        let bounce = &self.bounces[bounce];
        bounce.schedule.record(rec, self.steps.list)?;
        match &bounce.sort {
            Some(sort) => rec.scope("sort", |rec| sort.record(rec, &self.steps.sort)),
            None => Ok(()),
        }
    }

    /// Short rays from the receivers of the bounce before find those of this one.
    pub fn record_gather(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        let Some(arrive) = &self.bounces[bounce].arrive else { return Ok(()) };
        let steps = &self.steps.bounces[bounce];
        arrive.gather.record(rec, steps.gather)?;
        arrive.trace.record(rec, &self.steps.list_trace, None)?;
        arrive.receivers.record(rec, steps.receivers, None)?;
        self.record_list(rec, bounce)
    }

    /// The receivers of this bounce are lit.
    pub fn record_shade(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        match &self.bounces[bounce].shade {
            Some(shade) => shade.record(rec, &self.steps.bounces[bounce].shade),
            None => Ok(()),
        }
    }

    /// Light of this bounce's receivers goes back to the pixels.
    pub fn record_collect(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        match &self.bounces[bounce].arrive {
            Some(arrive) => arrive.collect.record(rec, self.steps.bounces[bounce].receivers),
            None => Ok(()),
        }
    }
}
