//! Closest hits of a batch of rays against the threaded BVH, in rounds of bounded length.
//!
//! A ray's whole state is its best hit and the index of the next node, so a ray that runs out of steps continues in the
//! next round. Rounds after the first are dispatched indirectly and cost nothing when no ray needs them. Eye rays share
//! their origin, but for those of an orthographic camera, so clusters of 64 of them walk the eight-wide tree together, as shadow rays do in
//! [`shade`](super::shade); the nearest child of a node is visited first. Where surfaces let rays pass, see
//! [`crate::accel::alpha`], rays look up the coverage of each such triangle that they meet.
//!
//! Cost: for each ray and step 32 bytes of node and 20 operations, for each triangle 48 bytes and 50 operations; the
//! number of steps grows roughly with the square root of the triangles that a ray passes. Incoherent, so it suits walks
//! and short gather rays. A cluster takes 256 bytes for each node and 384 for each leaf.

use super::edges::Edges;
use super::layout::Step;
use super::schedule::{LIST_GROUPS, ROUND_GROUPS, Schedule};
use super::{BoundKernel, Kit, List, Rays, TraversalKernels, groups, push};
use crate::accel::alpha::chance;
use crate::accel::{Bvh, Hit, Ray};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::plan::{Plan, RayClusters, StepTable, cluster_steps};
use crate::scene::Scene;

/// Steps of the eye rays.
pub struct EyeSteps {
    /// Step of the round by clusters, if there is one.
    pub clusters: Option<u32>,
    /// Rounds of single rays: from round 0, or from 1 after clusters.
    pub rounds: Vec<u32>,
}

impl EyeSteps {
    /// Adds the steps to the table. `clusters`: they take the rays first.
    pub fn new(table: &mut StepTable, plan: &Plan, pixels: u32, clusters: Option<RayClusters>) -> EyeSteps {
        let single = Step { end: pixels, steps: plan.trace_steps(), ..Step::default() };
        EyeSteps::of(table, plan, single, clusters)
    }

    /// For rays on a list.
    pub fn of_list(table: &mut StepTable, plan: &Plan, clusters: Option<RayClusters>) -> EyeSteps {
        let single = Step { indirect: 1, steps: plan.trace_steps(), ..Step::default() };
        EyeSteps::of(table, plan, single, clusters)
    }

    fn of(table: &mut StepTable, plan: &Plan, single: Step, clusters: Option<RayClusters>) -> EyeSteps {
        let Some(clusters) = clusters else {
            return EyeSteps { clusters: None, rounds: table.add_rounds(plan.trace_rounds(), single) };
        };
        let steps = cluster_steps(1, plan.settings.loop_budget, clusters);
        let clusters = Some(table.add(Step { steps, ..single }));
        let end = plan.trace_rounds();
        let last = |round: u32| u32::from(round == end);
        let rounds = (1..=end).map(|round| table.add(Step { round, last: last(round), ..single })).collect();
        EyeSteps { clusters, rounds }
    }
}

/// The pass over one batch.
pub struct Trace {
    kernel: BoundKernel,
    cluster: Option<BoundKernel>,
    schedule: Schedule,
    work: Buffer,
}

impl Trace {
    /// Reads `rays.origin` and `rays.direction`, writes `rays.hits`; `list` holds the rays for steps that read a list.
    pub fn new(kit: &Kit, rays: &Rays, list: &List, steps: &Resources) -> Result<Self> {
        let sets = [&rays.resources(), &list.resources(), steps];
        let shader = if kit.has_alpha { &shaders::TRACE_ALPHA } else { &shaders::TRACE };
        let kernel = kit.bind(shader, &sets)?;
        Ok(Trace { kernel, cluster: None, schedule: Schedule::new(kit, &list.work, steps)?, work: list.work.clone() })
    }

    /// As [`Trace::new`] for the eye rays, one for each pixel, which share their origin: clusters of 8 x 8 pixels are
    /// traced together if the scene has a tree for `clusters`. Single rays take what these do not finish.
    pub fn of_eye(kit: &Kit, rays: &Rays, list: &List, steps: &Resources, clusters: bool) -> Result<Self> {
        let cluster =
            match TraversalKernels::trace(kit.context, kit.traversal, kit.has_alpha)?.cluster.filter(|_| clusters) {
                Some(kernel) => Some(kit.bind(kernel, &[&rays.resources(), &list.resources(), steps])?),
                None => None,
            };
        Ok(Trace { cluster, ..Trace::new(kit, rays, list, steps)? })
    }

    /// As [`Trace::of_eye`] for the rays at edges that `list` holds, up to 64 for each tile.
    pub fn of_edges(
        kit: &Kit,
        edges: &Edges,
        rays: &Rays,
        list: &List,
        steps: &Resources,
        clusters: bool,
    ) -> Result<Self> {
        let tiles = Resources::of([("marks", &edges.marks)]);
        let cluster = match TraversalKernels::trace_edges(kit.context, kit.traversal, kit.has_alpha)?
            .cluster
            .filter(|_| clusters)
        {
            Some(kernel) => Some(kit.bind(kernel, &[&rays.resources(), &list.resources(), &tiles, steps])?),
            None => None,
        };
        Ok(Trace { cluster, ..Trace::new(kit, rays, list, steps)? })
    }

    /// Records the rounds over the rays at edges of so many tiles. If `steps.clusters`, the first round is by clusters.
    pub fn record_edges(&self, rec: &mut Recorder, steps: &EyeSteps, tiles: u32) -> Result<()> {
        let (Some(kernel), Some(step)) = (&self.cluster, steps.clusters) else {
            return self.record(rec, &steps.rounds, None);
        };
        kernel.run(rec, &push(step), u64::from(tiles))?;
        self.schedule.record_round(rec, step, 0)?;
        steps.rounds.iter().zip(1..).try_for_each(|(&step, round)| self.record_round(rec, step, round))
    }

    /// Records the rounds over the eye rays, `tiles` of 8 x 8. If `steps.clusters`, the first round is by clusters.
    pub fn record_eye(&self, rec: &mut Recorder, steps: &EyeSteps, tiles: u32, pixels: u32) -> Result<()> {
        let (Some(kernel), Some(step)) = (&self.cluster, steps.clusters) else {
            return self.record(rec, &steps.rounds, Some(pixels));
        };
        kernel.run(rec, &push(step), u64::from(tiles))?;
        self.schedule.record(rec, step)?;
        steps.rounds.iter().zip(1..).try_for_each(|(&step, round)| self.record_round(rec, step, round))
    }

    /// Records the rounds over a batch of `count` rays; `None`: the rays of the list.
    pub fn record(&self, rec: &mut Recorder, rounds: &[u32], count: Option<u32>) -> Result<()> {
        for (round, &step) in rounds.iter().enumerate() {
            match count.filter(|_| round == 0) {
                Some(count) => {
                    self.kernel.run(rec, &push(step), groups(count))?;
                    self.schedule.record(rec, step)?;
                }
                None => self.record_round(rec, step, round)?,
            }
        }
        Ok(())
    }

    /// Records a round over the rays of the list; later ones than 0 continue unfinished rays.
    fn record_round(&self, rec: &mut Recorder, step: u32, round: usize) -> Result<()> {
        let groups = if round == 0 { LIST_GROUPS } else { ROUND_GROUPS };
        self.kernel.run_listed(rec, &push(step), &self.work, groups)?;
        self.schedule.record_round(rec, step, round)
    }
}

/// Oracle: the nearest hit; `pass`: key of the pass, [`crate::pass::layout::FrameParameters::keys`], for surfaces that let rays pass.
pub fn reference(scene: &Scene, bvh: &Bvh, ray: &Ray, pass: u32) -> Option<Hit> {
    bvh.closest_stop(scene, ray, |hit| chance(pass, hit.triangle, ray.direction))
}
