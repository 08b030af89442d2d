//! Lists the shading points that photons may light, so that `photon_light` visits only those.
//!
//! A point is listed if the bit of its look-up is set ([`photon_grid::near_bit`]): one of the 8 cells that the look-up
//! visits holds photons, or another look-up shares the bit. The order of the list varies, but nothing depends on it.
//!
//! Cost for each point: 24 bytes read and 40 operations.

use std::collections::HashSet;

use glam::Vec3;

use super::layout::FrameParameters;
use super::photon_grid::{self, Grid};
use super::schedule::{LIST_GROUPS, Schedule};
use super::sort::class_of;
use super::{BoundKernel, Kit, List, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// The pass.
pub struct PhotonFind {
    kernel: BoundKernel,
    schedule: Schedule,
    work: Buffer,
}

impl PhotonFind {
    /// Appends to `found` from `list`, skipping gaps.
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        list: &List,
        grid: &Grid,
        found: &List,
        steps: &Resources,
    ) -> Result<Self> {
        let own = Resources::of([("near", &grid.near), ("found", &found.entries), ("found_work", &found.work)]);
        let kernel = kit.bind(&shaders::PHOTON_FIND, &[&points.resources(), &list.resources(), &own])?;
        Ok(PhotonFind { kernel, schedule: Schedule::new(kit, &found.work, steps)?, work: list.work.clone() })
    }

    /// Records the pass; `step` is that of a newly filled list.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.work, LIST_GROUPS)?;
        self.schedule.record_filled_from(rec, step, Some(&self.work))
    }
}

/// Oracle: the listed ones among the points at these slots and positions; photons are stored at `photons`.
pub fn reference(frame: &FrameParameters, receivers: &[(u32, Vec3)], photons: &[(u32, Vec3)]) -> Vec<u32> {
    let bits = photons.iter().flat_map(|&(photon, position)| photon_grid::near_bits(frame, photon, position));
    let set: HashSet<u32> = bits.collect();
    let found = receivers.iter().filter(|&&(slot, position)| {
        let first = photon_grid::cell_of(frame, position, 0.5);
        set.contains(&photon_grid::near_bit(frame, first, photon_grid::grid_class(frame, class_of(frame, slot))))
    });
    found.map(|&(slot, _)| slot).collect()
}
