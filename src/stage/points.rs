//! The order of shading points on their list.

use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Resources};
use crate::pass::layout::PointStep;
use crate::pass::schedule::Schedule;
use crate::pass::shade::Chunk;
use crate::pass::sort::{Sort, SortBuffers, SortSteps};
use crate::pass::{Kit, List, ShadingPoints};
use crate::plan::{Plan, StepTable};
use crate::settings::ClusterOrder;

/// How shading points form clusters of 64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointOrder {
    /// They form none: the list is in order of arrival.
    Any,
    /// Sorted by position in space.
    Space,
    /// By their pixels; the list has gaps.
    Screen,
}

impl PointOrder {
    /// The order for the points of a plan.
    pub fn of(plan: &Plan, scene: &DeviceScene) -> PointOrder {
        let settings = &plan.settings;
        // Clusters in space find fewer lights that all of their points see behind edges, but cannot have lights of their own.
        let gaps = plan.bounces() == 1 || plan.chooses_lights();
        // Clusters of the screen choose their lights, whichever kernel traces the shadow rays.
        let by_screen = gaps && settings.cluster_order == ClusterOrder::Screen && settings.max_depth > 1;
        match scene.wide_nodes {
            _ if by_screen => PointOrder::Screen,
            None => PointOrder::Any,
            Some(_) => PointOrder::Space,
        }
    }

    /// The order of the points that gather rays of points in this order hit.
    pub fn of_gathered(self) -> PointOrder {
        if self == PointOrder::Any { PointOrder::Any } else { PointOrder::Space }
    }

    /// Step of the pass that makes a list of points, so many of each pixel; `lit`: they will be shaded; `last`: they only emit.
    pub(super) fn step(self, components: u32, lit: bool, last: bool) -> PointStep {
        let order = match self {
            PointOrder::Screen => PointStep::SCREEN,
            PointOrder::Space if lit => PointStep::TO_SORT,
            PointOrder::Space | PointOrder::Any => PointStep::ANY,
        };
        PointStep { order, last: u32::from(last), components }
    }
}

/// Finishes a list of shading points: turns its length into dispatches, and sorts it if required.
pub(super) struct ListFinish {
    schedule: Schedule,
    list_step: u32,
    sort: Option<(Sort, SortSteps)>,
}

/// Steps of [`ListFinish`].
pub(super) struct ListFinishSteps {
    list: u32,
    sort: SortSteps,
}

impl ListFinishSteps {
    pub(super) fn new(table: &mut StepTable, classes: u32) -> ListFinishSteps {
        ListFinishSteps { list: table.add_list(), sort: SortSteps::new(table, classes) }
    }
}

impl ListFinish {
    /// `sort`: buffers for sorting, if the points are sorted.
    pub(super) fn new(
        kit: &Kit,
        list: &List,
        points: &ShadingPoints,
        sort: Option<&SortBuffers>,
        numbers: ListFinishSteps,
        steps: &Resources,
    ) -> Result<ListFinish> {
        let sort = match sort {
            Some(buffers) => Some((Sort::new(kit, list, points, buffers, steps)?, numbers.sort)),
            None => None,
        };
        Ok(ListFinish { schedule: Schedule::new(kit, &list.work, steps)?, list_step: numbers.list, sort })
    }

    pub(super) fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.schedule.record(rec, self.list_step)?;
        match &self.sort {
            Some((sort, steps)) => rec.scope("sort", |rec| sort.record(rec, steps)),
            None => Ok(()),
        }
    }
}

/// Chunks of the lights that light points after `bounce` gather rays.
pub(super) fn chunks(
    table: &mut StepTable,
    plan: &Plan,
    (context, scene): (&Context, &DeviceScene),
    bounce: u32,
    order: PointOrder,
) -> Vec<Chunk> {
    let settings = &plan.settings;
    let ray_clusters = Chunk::clusters(settings, scene.clusters(context)).filter(|_| order != PointOrder::Any);
    let size = Chunk::size(settings, ray_clusters.is_some());
    // Eye segment, gather rays, shadow ray and j reflections are bounce + j + 2 segments.
    let reflections = (settings.max_depth as usize).checked_sub(bounce as usize + 2);
    let ranges = reflections.map_or(Vec::new(), |j| plan.lists.chunks(size, j));
    let delta = plan.delta_slots(scene);
    let chunks: Vec<Chunk> = ranges
        .into_iter()
        .map(|(first, end)| {
            // Parallel light has no position.
            let mut places = delta.iter().take(end as usize).skip(first as usize);
            let parallel =
                places.any(|l| l.is_parallel()) || (plan.lists.environment && first < plan.lists.first_placed());
            let ray_clusters = ray_clusters.filter(|_| !parallel);
            Chunk::new(table, settings, (first, end), ray_clusters, order == PointOrder::Screen)
        })
        .collect();
    // Mirrors and glass on the particle's path count as well.
    let bounces = reflections.unwrap_or(0) as u32;
    chunks.iter().flat_map(|chunk| &chunk.rounds).for_each(|&step| table.steps[step as usize].bounces = bounces);
    chunks
}

/// Two buffers that alternate for lists of which the previous one is still needed.
#[derive(Clone)]
pub(super) struct Turns([Buffer; 2]);

impl Turns {
    pub(super) fn new(kit: &Kit, entries: u32) -> Result<Turns> {
        Ok(Turns([kit.array("list 0", entries, 4)?, kit.array("list 1", entries, 4)?]))
    }

    /// List number `i`, which may overwrite number i - 2.
    pub(super) fn list(&self, kit: &Kit, name: &str, i: usize) -> Result<List> {
        List::new(kit, &format!("{name} {i}"), &self.0[i % 2])
    }
}
