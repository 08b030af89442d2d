//! Antialiased lamps in mirrors and glass.

use super::{Counts, Eye, Stage};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder};
use crate::pass::lamp_edges::{self, Inputs, MAX_BOUNCES};
use crate::pass::layout::Step;
use crate::pass::schedule::Schedule;
use crate::pass::trace::Trace;
use crate::pass::{Kit, Lighting, List};
use crate::plan::{Plan, StepTable};

/// The stage.
pub struct LampEdges {
    /// Finds edges, starts rays there, and adds what they find.
    pub pass: lamp_edges::LampEdges,
    counts: Counts,
    bounces: Vec<Bounce>,
    slots: u32,
    list_step: u32,
    rounds: Vec<u32>,
}

/// Traces rays up to a surface.
struct Bounce {
    /// Work of the list that its rays come from.
    from: Buffer,
    schedule: Schedule,
    trace: Trace,
    step: u32,
}

impl LampEdges {
    /// Antialiases what `eye` sees, lit by `lighting`; `None`: the plan does not, or paths do not split. `path_gain`: receives what the rays add.
    pub fn new(
        kit: &Kit,
        plan: &Plan,
        eye: &Eye,
        (lighting, path_gain): (&Lighting, Option<&Buffer>),
    ) -> Result<Option<LampEdges>> {
        let Some(guides) = eye.guides.as_ref().filter(|_| plan.antialiases() && plan.eye.components == 2) else {
            return Ok(None);
        };
        let traced = plan.eye.steps.min(MAX_BOUNCES) + 1;
        let components = plan.eye.slots_of_pixel;
        let mut table = StepTable::default();
        let slots = table.add(Step { components, ..Step::default() });
        let turn_steps: Vec<u32> = (1..=traced)
            .map(|bounce| table.add(Step { components, last: u32::from(bounce == traced), ..Step::default() }))
            .collect();
        let list_step = table.add_list();
        let rounds = table.add_list_rounds(plan);
        let steps = table.stage(kit, "lamp edge steps")?;
        // The rays lie among those of the eye, which have done their work. A list is filled while the previous one is still needed, so two buffers alternate.
        let turns = [0, 1].map(|i| kit.array(&format!("lamp edge list {i}"), plan.eye.slots(), 4));
        let turns = turns.into_iter().collect::<Result<Vec<Buffer>>>()?;
        let list = |i: u32| List::new(kit, &format!("lamp edge rays {i}"), &turns[i as usize % 2]);
        let lists = (0..=traced).map(list).collect::<Result<Vec<List>>>()?;
        let inputs = Inputs {
            guides,
            points: &eye.points,
            paths: &eye.paths,
            lighting,
            tiles: &eye.ideal_tiles,
            region: &eye.planes.region,
            rays: &eye.rays,
            lists: &lists,
            path_gain,
        };
        let sources = [&eye.ideal_tiles].into_iter().chain(&lists);
        let bounces = lists.iter().zip(sources).zip(turn_steps).map(|((list, source), step)| {
            let (schedule, trace) =
                (Schedule::new(kit, &list.work, &steps)?, Trace::new(kit, &eye.rays, list, &steps)?);
            Ok(Bounce { from: source.work.clone(), schedule, trace, step })
        });
        Ok(Some(LampEdges {
            pass: lamp_edges::LampEdges::new(kit, &inputs, [plan.eye.pixels, plan.eye.slots()], &steps)?,
            counts: Counts::new(kit, 1, &lists)?,
            bounces: bounces.collect::<Result<_>>()?,
            slots,
            list_step,
            rounds,
        }))
    }
}

impl Stage for LampEdges {
    const NAME: &'static str = "lamp_edges";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)?;
        self.pass.record_mark(rec)?;
        self.pass.record_rays(rec, self.slots)?;
        for (i, bounce) in self.bounces.iter().enumerate() {
            bounce.schedule.record_filled_from(rec, self.list_step, Some(&bounce.from))?;
            bounce.trace.record(rec, &self.rounds, None)?;
            self.pass.record_turn(rec, i, bounce.step)?;
        }
        self.pass.record_add(rec, self.slots)
    }
}
