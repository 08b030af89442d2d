//! Antialiased edges.

use super::{Counts, Seen, Stage};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder};
use crate::pass::edges::{self, Inputs};
use crate::pass::schedule::Schedule;
use crate::pass::shade::Chunk;
use crate::pass::trace::{EyeSteps, Trace};
use crate::pass::{Kit, Lighting, List};
use crate::plan::{Plan, StepTable};

/// The stage.
pub struct Edges {
    /// Rays at edges, among those of the eye, which have done their work.
    pub list: List,
    /// Finds edges, starts rays and lights them.
    pub pass: edges::Edges,
    counts: Counts,
    schedule: Schedule,
    list_step: u32,
    trace: Trace,
    steps: EyeSteps,
    reflected: Option<Reflected>,
}

/// The rays that flat mirrors reflect.
struct Reflected {
    list: List,
    schedule: Schedule,
    trace: Trace,
    rounds: Vec<u32>,
}

impl Edges {
    /// Antialiases the image of what is `seen`, lit by `lighting`; `None`: the plan does not.
    /// `path_gain`: receives what the rays add.
    pub fn new(
        kit: &Kit,
        scene: &DeviceScene,
        plan: &Plan,
        seen: &Seen,
        (lighting, path_gain): (&Lighting, Option<&Buffer>),
    ) -> Result<Option<Edges>> {
        let Some(guides) = seen.guides.filter(|_| plan.antialiases()) else { return Ok(None) };
        let Seen { points, paths, rays, pixels, plain_mirrors, .. } = *seen;
        let mut table = StepTable::default();
        // Clusters of rays share their origin.
        let shares_origin = !plan.view.is_orthographic();
        let ray_clusters = Chunk::clusters(&plan.settings, scene.clusters(kit.context)).filter(|_| shares_origin);
        let edge_steps = EyeSteps::of_list(&mut table, plan, ray_clusters);
        let list_step = table.add_list();
        let rounds = if plain_mirrors { table.add_list_rounds(plan) } else { Vec::new() };
        let steps = table.stage(kit, "edge steps")?;
        let list = List::new(kit, "edge rays", &kit.array("edge rays list", pixels, 4)?)?;
        let reflected = match plain_mirrors {
            true => {
                let entries = kit.array("reflected edge rays list", pixels, 4)?;
                let list = List::new(kit, "reflected edge rays", &entries)?;
                let schedule = Schedule::new(kit, &list.work, &steps)?;
                let trace = Trace::new(kit, rays, &list, &steps)?;
                Some(Reflected { list, schedule, trace, rounds })
            }
            false => None,
        };
        let turned = reflected.as_ref().map(|reflected| &reflected.list);
        let inputs = Inputs { guides, points, paths, lighting, rays, list: &list, reflected: turned, path_gain };
        let pass = edges::Edges::new(kit, &inputs, plan.view.size())?;
        Ok(Some(Edges {
            counts: Counts::new(kit, 1, [&list].into_iter().chain(turned))?,
            schedule: Schedule::new(kit, &list.work, &steps)?,
            list_step,
            trace: Trace::of_edges(kit, &pass, rays, &list, &steps, shares_origin && scene.wide_nodes.is_some())?,
            steps: edge_steps,
            pass,
            reflected,
            list,
        }))
    }

    /// The part up to the hits of the rays of a round.
    pub fn record_rays(&self, rec: &mut Recorder, round: u32) -> Result<()> {
        self.counts.record_clear(rec)?;
        self.pass.record_rays(rec, round)?;
        self.schedule.record(rec, self.list_step)?;
        self.trace.record_edges(rec, &self.steps, self.pass.tile_count)
    }

    /// The part in which mirrors reflect some of them.
    pub fn record_reflected(&self, rec: &mut Recorder) -> Result<()> {
        let Some(Reflected { schedule, trace, rounds, .. }) = &self.reflected else { return Ok(()) };
        self.pass.record_turn(rec)?;
        schedule.record(rec, self.list_step)?;
        trace.record(rec, rounds, None)
    }
}

impl Stage for Edges {
    const NAME: &'static str = "edges";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.pass.record_mark(rec)?;
        (0..edges::ROUNDS).try_for_each(|round| {
            self.record_rays(rec, round)?;
            self.record_reflected(rec)?;
            self.pass.record_light(rec, round)
        })
    }
}
