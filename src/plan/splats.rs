//! The particles of splats, in batches, and the dispatches that look them up.

use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::pass::splat_grid::MAX_BUCKET_BITS;
use crate::pass::splat_start::SplatParameters;
use crate::scene::surfaces::MAX_EDGES;
use crate::settings::{Settings, Splats};
use crate::view::View;

/// Maximum number of particles of a batch: the hits of a batch have 32 bytes for each particle and bounce.
const BATCH: u32 = 32_768;

/// Particles of splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatPlan {
    /// Their settings.
    pub settings: Splats,
    /// Particles of a batch.
    pub batch: u32,
    /// Maximum number of bounces of a particle that is stored.
    pub bounces: u32,
    /// Number of surfaces.
    pub surfaces: u32,
    /// Candidates of a point that one dispatch takes.
    pub chunk: u32,
}

impl SplatPlan {
    /// `None`: nothing asks for splats, or they would show nothing.
    ///
    /// Errors: the scene was not made for them.
    pub fn of(settings: &Settings, scene: &DeviceScene, view: &View) -> Result<Option<SplatPlan>> {
        let Some(splats) = settings.splats else { return Ok(None) };
        if scene.kept_light.is_some() {
            log::info!("no splats: with kept light eye paths follow the lobes of glossy surfaces");
            return Ok(None);
        }
        if scene.lights_are_complete {
            log::info!("no splats: the scene's lights hold all reflected light already");
            return Ok(None);
        }
        let Some(surfaces) = &scene.surfaces else {
            let message = "the engine was made without splats, which need the scene's surfaces; make another one";
            return Err(Error::Setting { name: "--glossy", message: String::from(message) });
        };
        if surfaces.alpha != splats.alpha {
            let message = format!("it is {} since the engine was made; make another one to change it", surfaces.alpha);
            return Err(Error::Setting { name: "--splat-alpha", message });
        }
        let plan = SplatPlan {
            settings: splats,
            batch: splats.particles.min(BATCH),
            // The eye's segment and those of the particle.
            bounces: settings.max_depth.saturating_sub(2),
            surfaces: surfaces.count,
            chunk: SplatPlan::chunk(settings.loop_budget, scene.has_tables()),
        };
        let shows = surfaces.count > 0 && plan.bounces > 0 && view.camera().is_some();
        Ok(shows.then_some(plan))
    }

    /// Slots for the hits of a batch.
    pub fn slots(&self) -> u32 {
        self.batch * self.bounces
    }

    /// First particle of each batch and one past its last.
    pub fn batches(&self) -> impl Iterator<Item = (u32, u32)> {
        let (all, batch) = (self.settings.particles, self.batch);
        (0..all).step_by(batch as usize).map(move |first| (first, all.min(first + batch)))
    }

    /// Bits of a bucket number of the hash table: at least twice as many buckets as hits, as far as keys allow.
    pub fn bucket_bits(&self) -> u32 {
        (self.settings.particles.next_power_of_two().trailing_zeros() + 1).min(MAX_BUCKET_BITS)
    }

    /// Bytes of what is stored, of its grid and of a batch.
    pub fn bytes(&self) -> u64 {
        let (hits, batch) = (u64::from(self.settings.particles), u64::from(self.batch));
        // Stored and sorted, the order, keys twice and their counts; rays with flux, media and two lists.
        hits * (32 + 32 + 4 + 16 + 2) + (8 << self.bucket_bits()) + batch * (56 + 32 + 8) + 32 * u64::from(self.slots())
    }

    /// Candidates of a point that one dispatch may loop over within `budget`: each takes at most 6 iterations (its own, and 4 if it lies
    /// within the kernel, where a subgroup may have lobes of two kinds; the exits of blocks), and 2 more beside `tables`; each edge of the outline
    /// 20; the cells, their ends for eight points of a subgroup, and the exits 330.
    fn chunk(budget: u32, tables: bool) -> u32 {
        let each = if tables { 8 } else { 6 };
        (budget.saturating_sub(330 + 20 * MAX_EDGES) / each).max(1)
    }

    /// The parameters on the device.
    pub fn parameters(&self) -> SplatParameters {
        let capacity = self.settings.particles;
        SplatParameters {
            capacity,
            buckets: (1 << self.bucket_bits()) - 1,
            particles: self.batch,
            slots: self.slots(),
            chunk: self.chunk,
            rounds: capacity.div_ceil(self.chunk),
            width: self.settings.width,
            alpha: self.settings.alpha,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::LOOP_BUDGET;

    #[test]
    fn hits_are_looked_up_within_the_loop_budget() {
        for (tables, each) in [(false, 6), (true, 8)] {
            let chunk = SplatPlan::chunk(LOOP_BUDGET, tables);
            assert!(chunk > 1000 && each * chunk + 20 * MAX_EDGES + 330 <= LOOP_BUDGET, "{chunk}");
        }
    }

    #[test]
    fn batches_hold_each_particle_once() {
        for particles in [1, 100, BATCH - 1, BATCH, BATCH + 1, 3 * BATCH + 7] {
            let settings = Splats { particles, ..Splats::default() };
            let plan = SplatPlan { settings, batch: particles.min(BATCH), bounces: 3, surfaces: 1, chunk: 1 };
            let all: Vec<(u32, u32)> = plan.batches().collect();
            assert_eq!(all.first().map(|b| b.0), Some(0));
            assert_eq!(all.last().map(|b| b.1), Some(particles));
            assert!(all.windows(2).all(|pair| pair[0].1 == pair[1].0) && all.iter().all(|b| b.1 - b.0 <= plan.batch));
        }
    }
}
