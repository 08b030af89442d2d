//! Closest hits of a batch of rays against the threaded BVH, in rounds of bounded length.
//!
//! A ray's whole state is its best hit and the index of the next node, so a ray that runs out of steps is carried on by the
//! next round. Rounds after the first are dispatched indirectly and cost nothing when no ray needs them.
//! Cost: for each ray and step 32 bytes of node and 20 operations, for each triangle 48 bytes and 50 operations; steps grow
//! about with the square root of the triangles that a ray passes. Incoherent, so it suits walks and short gather rays.

use super::schedule::{LIST_GROUPS, ROUND_GROUPS, Schedule};
use super::{Kernels, List, Rays, groups, push};
use crate::accel::{Bvh, Hit, Ray};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};
use crate::scene_buffers::SceneBuffers;

/// The pass over one batch.
pub struct Trace {
    kernel: Kernel,
    bindings: Bindings,
    schedule: Schedule,
    work: Buffer,
}

impl Trace {
    /// Reads `rays.origin` and `rays.direction`, writes `rays.hits`; `list` names the rays when steps say so.
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        scene: &SceneBuffers,
        rays: &Rays,
        list: &List,
        steps: &Buffer,
        status: &Buffer,
    ) -> Result<Self> {
        let kernel = kernels.trace.clone();
        let bindings = kernel.bind(&[
            ("frame", frame.into()),
            ("node_min", (&scene.node_min).into()),
            ("node_max", (&scene.node_max).into()),
            ("triangle_v0", (&scene.v0).into()),
            ("triangle_e1", (&scene.e1).into()),
            ("triangle_e2", (&scene.e2).into()),
            ("ray_origin", (&rays.origin).into()),
            ("ray_direction", (&rays.direction).into()),
            ("hits", (&rays.hits).into()),
            ("progress", (&rays.progress).into()),
            ("work", (&list.work).into()),
            ("list", (&list.pixels).into()),
            ("steps", steps.into()),
        ])?;
        let schedule = Schedule::new(kernels, &list.work, steps, status)?;
        Ok(Trace { kernel, bindings, schedule, work: list.work.clone() })
    }

    /// Records the rounds over a batch of `count` rays; `None`: the rays of the list.
    pub fn record(&self, rec: &mut Recorder, rounds: &[u32], count: Option<u32>) -> Result<()> {
        for (round, &step) in rounds.iter().enumerate() {
            match (round, count) {
                (0, Some(count)) => rec.dispatch(&self.kernel, &self.bindings, &push(step), groups(count))?,
                (0, None) => {
                    rec.dispatch_indirect(&self.kernel, &self.bindings, &push(step), &self.work, LIST_GROUPS)?;
                }
                _ => rec.dispatch_indirect(&self.kernel, &self.bindings, &push(step), &self.work, ROUND_GROUPS)?,
            }
            self.schedule.record(rec, step)?;
        }
        Ok(())
    }
}

/// Oracle: the nearest hit.
pub fn reference(bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    bvh.closest(ray)
}
