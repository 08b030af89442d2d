//! Turns counts that the device found into indirect dispatches, so that no count is read back within a frame.
//!
//! After a list is filled: groups for one invocation a shading point, and for clusters the groups more that
//! [`DispatchCounts::list_groups`] has in w, since no cluster mixes classes. After a round of traversal: the same groups again if any ray
//! ran out of steps, else none. Rays left unfinished by the last round are added to `status[0]`.
//! Cost: one invocation. A driver that computes on the processor takes as long as 30 microseconds to start it and to wait for it, so it is itself dispatched
//! indirectly where nothing can have changed without work before it.

use super::layout::{DispatchCounts, Step};
use super::{BoundKernel, Kit, push};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Byte offset of [`DispatchCounts::list_groups`].
pub const LIST_GROUPS: u64 = std::mem::offset_of!(DispatchCounts, list_groups) as u64;
/// Byte offset of [`DispatchCounts::round_groups`].
pub const ROUND_GROUPS: u64 = std::mem::offset_of!(DispatchCounts, round_groups) as u64;

/// Byte offset of [`DispatchCounts::total_groups`].
pub const TOTAL_GROUPS: u64 = std::mem::offset_of!(DispatchCounts, total_groups) as u64;

/// Byte offset of [`DispatchCounts::once_if_live`].
pub const ONCE_IF_LIVE: u64 = std::mem::offset_of!(DispatchCounts, once_if_live) as u64;
/// Byte offset of [`DispatchCounts::once_if_unfinished`].
pub const ONCE_IF_UNFINISHED: u64 = std::mem::offset_of!(DispatchCounts, once_if_unfinished) as u64;

/// The pass over one [`DispatchCounts`].
pub struct Schedule {
    kernel: BoundKernel,
    work: Buffer,
}

impl Schedule {
    /// Reads and writes `work`, and adds to the frame's status.
    pub fn new(kit: &Kit, work: &Buffer, steps: &Resources) -> Result<Self> {
        let kernel = kit.bind(&shaders::SCHEDULE, &[&Resources::of([("work", work)]), steps])?;
        Ok(Schedule { kernel, work: work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        self.kernel.run(rec, &push(step), 1)
    }

    /// Records the pass for a list that kernels over the list with the work `from` fill: it does nothing where that has no shading points, since this one then has
    /// none either. `None`: they take no list.
    pub fn record_filled_from(&self, rec: &mut Recorder, step: u32, from: Option<&Buffer>) -> Result<()> {
        match from {
            None => self.record(rec, step),
            Some(from) => self.kernel.run_listed(rec, &push(step), from, ONCE_IF_LIVE),
        }
    }

    /// Records the pass after round `round` over a list: it does nothing where the round had nothing to do.
    pub fn record_round(&self, rec: &mut Recorder, step: u32, round: usize) -> Result<()> {
        let once = if round == 0 { ONCE_IF_LIVE } else { ONCE_IF_UNFINISHED };
        self.kernel.run_listed(rec, &push(step), &self.work, once)
    }
}

/// Workgroups for `count` invocations, spread over two dimensions as the shader does.
pub fn groups_of(count: u32) -> [u32; 4] {
    let groups = count.div_ceil(64);
    let x = groups.min(32_768);
    [x, if x > 0 { groups.div_ceil(x) } else { 0 }, 1, 0]
}

/// Oracle: the work after the pass, and the number of rays to add to the status.
pub fn reference(work: &DispatchCounts, step: &Step) -> (DispatchCounts, u32) {
    let spread = |count: u32, more: u32| {
        let groups = count.div_ceil(64) + if count > 0 { more } else { 0 };
        let x = groups.min(32_768);
        [x, if x > 0 { groups.div_ceil(x) } else { 0 }, 1, more]
    };
    let list_groups = spread(work.live, work.list_groups[3]);
    let again = if step.indirect != 0 { list_groups } else { groups_of(step.end) };
    let round_groups = if work.unfinished > 0 { again } else { [0, 1, 1, 0] };
    let lost = if step.last == 1 { work.unfinished } else { 0 };
    let total_groups = groups_of(work.total);
    let once = |count: u32| [count.min(1), 1, 1, 0];
    let (once_if_live, once_if_unfinished) = (once(work.live), once(work.unfinished));
    let next = DispatchCounts {
        unfinished: 0,
        list_groups,
        round_groups,
        total_groups,
        once_if_live,
        once_if_unfinished,
        ..*work
    };
    (next, lost)
}
