//! Lists the receivers that photons may light, so that `photon_light` looks at those alone.
//!
//! A receiver is listed if the bit of its look-up is set ([`photon_grid::near_bit`]): there are photons in one of the 8 cells that
//! the look-up visits, or other cells share the bit. The order of the list is not fixed, but nothing depends on it.
//!
//! Cost for each receiver: 24 bytes read and 40 operations.

use std::collections::HashSet;

use glam::Vec3;

use super::layout::Frame;
use super::photon_grid::{self, Grid};
use super::schedule::{LIST_GROUPS, Schedule};
use super::sort::class_of;
use super::{Kernels, List, Receivers};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};

/// The pass.
pub struct PhotonFind {
    kernel: Kernel,
    bindings: Bindings,
    schedule: Schedule,
    work: Buffer,
}

impl PhotonFind {
    /// Appends to `found` from `list`; gaps in it are left out.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        receivers: &Receivers,
        list: &List,
        grid: &Grid,
        found: &List,
        steps: &Buffer,
        status: &Buffer,
    ) -> Result<Self> {
        let kernel = kernels.photon_find.clone();
        let bindings = kernel.bind(&[
            ("frame", frame.into()),
            ("work", (&list.work).into()),
            ("list", (&list.pixels).into()),
            ("receiver_position", (&receivers.position).into()),
            ("near", (&grid.near).into()),
            ("found", (&found.pixels).into()),
            ("found_work", (&found.work).into()),
        ])?;
        let schedule = Schedule::new(kernels, &found.work, steps, status)?;
        Ok(PhotonFind { kernel, bindings, schedule, work: list.work.clone() })
    }

    /// Records the pass; `step` is that of a list that was just filled.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        rec.dispatch_indirect(&self.kernel, &self.bindings, &[], &self.work, LIST_GROUPS)?;
        self.schedule.record(rec, step)
    }
}

/// Oracle: of the receivers at these slots and positions those that are listed, where photons are stored at `photons`.
pub fn reference(frame: &Frame, receivers: &[(u32, Vec3)], photons: &[(u32, Vec3)]) -> Vec<u32> {
    let bits = photons.iter().flat_map(|&(photon, position)| photon_grid::near_bits(frame, photon, position));
    let set: HashSet<u32> = bits.collect();
    let found = receivers.iter().filter(|&&(slot, position)| {
        let first = photon_grid::cell_of(frame, position, 0.5);
        set.contains(&photon_grid::near_bit(frame, first, class_of(frame, slot)))
    });
    found.map(|&(slot, _)| slot).collect()
}
