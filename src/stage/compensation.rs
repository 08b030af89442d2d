//! Near light that clipping cut off: short rays from the shading points, whose hits are lit in turn (see [`crate::pass::gather`]), and
//! rays towards near emitters (see [`crate::pass::near_aim`]).

use super::points::{ListFinish, ListFinishSteps, chunks};
use super::{Counts, Eye, Shade, Stage};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder};
use crate::pass::collect::Collect;
use crate::pass::gather::Gather;
use crate::pass::gathered_points::{self, GatheredPoints};
use crate::pass::layout::Step;
use crate::pass::light_lists::LightLists;
use crate::pass::near_aim::{NearAim, Source};
use crate::pass::schedule::Schedule;
use crate::pass::shade::{self, Chunk};
use crate::pass::trace::Trace;
use crate::pass::{Kit, Lighting, List, ShadingPoints};
use crate::plan::{Plan, StepTable};

/// The stage.
pub struct Compensation {
    /// Shading points where the rays hit.
    pub points: ShadingPoints,
    /// Throughput of each slot's gather path; w: 0 if it began with the diffuse lobe, 1 with the specular lobe.
    pub beta: Buffer,
    /// Light there.
    pub lighting: Lighting,
    /// One after the other.
    pub bounces: Vec<Bounce>,
    counts: Counts,
    list_rounds: Vec<u32>,
    list_step: u32,
    /// Lights of the classes of pixels, where clusters of the screen have others.
    lists: Option<LightLists>,
}

/// From one set of points to the next, and the light of these back to the pixels.
pub struct Bounce {
    /// The points that the rays hit.
    pub list: List,
    /// Points before with a ray towards a near emitter.
    pub aimed: List,
    aim: (NearAim, Trace, Schedule),
    gather: (Gather, u32),
    /// Finishes the list of the points that have a ray, if it is another than that of the points.
    started: Option<Schedule>,
    trace: Trace,
    points: GatheredPoints,
    finish: ListFinish,
    shade: Option<(shade::Shade, Vec<Chunk>)>,
    collect: (Collect, u32),
}

impl Compensation {
    /// From the points of `eye` to the lighting of `shade`. The hits are lit by the lights of `lists`, or by those that their classes choose
    /// of `lights` if each cluster of the screen has lights of its own. `None`: nothing is cut off.
    pub fn new(
        kit: &Kit,
        scene: &DeviceScene,
        plan: &Plan,
        (eye, lists, lights, shade): (&Eye, &LightLists, &Buffer, &Shade),
    ) -> Result<Option<Compensation>> {
        if plan.bounces() == 1 {
            return Ok(None);
        }
        let (settings, slots) = (&plan.settings, plan.eye.slots());
        let points = ShadingPoints::new(kit.context, "gathered", slots)?;
        let lighting = Lighting::new(kit.context, "gathered", slots)?;
        let beta = kit.vec4s("beta", slots)?;
        let mut table = StepTable::default();
        let list_rounds = table.add_list_rounds(plan);
        let list_step = table.add_list();
        let bounces: Vec<BounceSteps> =
            (1..plan.bounces()).map(|bounce| BounceSteps::new(&mut table, kit, scene, plan, eye, bounce)).collect();
        let steps = table.stage(kit, "compensation steps")?;
        let of_classes = match &eye.clusters {
            Some(_) => Some(LightLists::of_classes(kit, plan, eye, lights)?),
            None => None,
        };
        let lists = of_classes.as_ref().unwrap_or(lists);
        let sort_buffers = eye.sort_buffers.as_ref();
        let order = eye.order.of_gathered();
        let started = match &eye.clusters {
            Some(_) => Some(List::new(kit, "gather rays", &kit.array("gather rays list", slots, 4)?)?),
            None => None,
        };
        let aimed_entries = kit.array("list of near emitters", slots, 4)?;
        let mut before = (eye.list.clone(), &eye.points, &shade.lighting);
        let mut made = Vec::new();
        for (bounce, numbers) in (1..).zip(bounces) {
            let list = eye.turns.list(kit, "gathered points", bounce)?;
            let (list_in, from, of_points) = &before;
            // The list of the screen has gaps.
            let started = started.as_ref().filter(|_| bounce == 1);
            let gather = match started {
                Some(started) => Gather::with_gaps(kit, from, (list_in, started), &eye.rays, &beta, &steps)?,
                None => Gather::new(kit, from, list_in, &eye.rays, &beta, &steps)?,
            };
            let aimed = List::new(kit, "near emitters", &aimed_entries)?;
            let points_in = Source::Gathering { gaps: started.is_some(), steps: &steps, step: numbers.gather };
            let aim = (
                NearAim::new(kit, (points_in, from), (list_in, &aimed), &eye.rays, &of_points.direct)?,
                Trace::new(kit, &eye.rays, &aimed, &steps)?,
                Schedule::new(kit, &aimed.work, &steps)?,
            );
            let list_in = started.unwrap_or(list_in);
            let lit = !numbers.chunks.is_empty();
            let shade_inputs = shade::Inputs {
                points: &points,
                list: &list,
                lists,
                progress: &eye.rays.progress,
                lighting: &lighting,
                classes: sort_buffers.map(|buffers| &buffers.classes),
            };
            let last = bounce + 1 == settings.max_depth as usize;
            let inputs = gathered_points::Inputs {
                rays: &eye.rays,
                list_in,
                list_out: &list,
                beta: &beta,
                points: &points,
                step: order.step(1, lit, last),
            };
            let sort = sort_buffers.filter(|_| lit);
            made.push(Bounce {
                gather: (gather, numbers.gather),
                started: match started {
                    Some(started) => Some(Schedule::new(kit, &started.work, &steps)?),
                    None => None,
                },
                trace: Trace::new(kit, &eye.rays, list_in, &steps)?,
                points: GatheredPoints::new(kit, &inputs)?,
                finish: ListFinish::new(kit, &list, &points, sort, numbers.finish, &steps)?,
                shade: match lit {
                    true => Some((shade::Shade::new(kit, &shade_inputs, &steps)?, numbers.chunks)),
                    false => None,
                },
                collect: (
                    Collect::new(kit, &points, list_in, &beta, &lighting, &shade.lighting, &steps)?,
                    numbers.collect,
                ),
                list: list.clone(),
                aimed,
                aim,
            });
            before = (list, &points, &lighting);
        }
        let lists = made.iter().flat_map(|bounce| [&bounce.list, &bounce.aimed]).chain(&started);
        let counts = Counts::new(kit, settings.classes(), lists)?;
        Ok(Some(Compensation {
            points,
            beta,
            lighting,
            bounces: made,
            counts,
            list_rounds,
            list_step,
            lists: of_classes,
        }))
    }

    /// Clears the counts.
    pub fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)
    }

    /// Traces rays towards near emitters from the points before this bounce.
    pub fn record_aimed_rays(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        let (aim, trace, schedule) = &self.bounces[bounce - 1].aim;
        aim.record_rays(rec)?;
        schedule.record(rec, self.list_step)?;
        trace.record(rec, &self.list_rounds, None)
    }

    /// Adds what they found to the light of their points.
    pub fn record_aimed_light(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        self.bounces[bounce - 1].aim.0.record_light(rec)
    }

    /// Short rays from the points before find those of this bounce; bounces from 1.
    pub fn record_gather(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        let bounce = &self.bounces[bounce - 1];
        bounce.gather.0.record(rec, bounce.gather.1)?;
        bounce.started.as_ref().map_or(Ok(()), |schedule| schedule.record(rec, self.list_step))?;
        bounce.trace.record(rec, &self.list_rounds, None)?;
        bounce.points.record(rec)?;
        bounce.finish.record(rec)
    }

    /// The points of this bounce are lit; those of the last one only emit.
    pub fn record_shade(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        match &self.bounces[bounce - 1].shade {
            Some((shade, chunks)) => shade.record(rec, chunks),
            None => Ok(()),
        }
    }

    /// Their light goes back to the pixels.
    pub fn record_collect(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        let bounce = &self.bounces[bounce - 1];
        bounce.collect.0.record(rec, bounce.collect.1)
    }
}

/// Steps of one bounce.
struct BounceSteps {
    gather: u32,
    collect: u32,
    finish: ListFinishSteps,
    chunks: Vec<Chunk>,
}

impl BounceSteps {
    fn new(table: &mut StepTable, kit: &Kit, scene: &DeviceScene, plan: &Plan, eye: &Eye, bounce: u32) -> BounceSteps {
        let chunks = chunks(table, plan, (kit.context, scene), bounce, eye.order.of_gathered());
        BounceSteps {
            gather: table.add(Step { bounce: bounce - 1, ..Step::default() }),
            collect: table.add(Step { bounce, ..Step::default() }),
            finish: ListFinishSteps::new(table, plan.settings.classes()),
            chunks,
        }
    }
}

impl Stage for Compensation {
    const NAME: &'static str = "compensation";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_clear(rec)?;
        self.lists.as_ref().map_or(Ok(()), |lists| lists.run(rec))?;
        let aim = |rec: &mut Recorder, bounce: usize| {
            self.record_aimed_rays(rec, bounce)?;
            self.record_aimed_light(rec, bounce)
        };
        rec.scope("aim", |rec| aim(rec, 1))?;
        (1..=self.bounces.len()).try_for_each(|bounce| {
            rec.scope("gather", |rec| self.record_gather(rec, bounce))?;
            rec.scope("shade", |rec| self.record_shade(rec, bounce))?;
            if bounce < self.bounces.len() {
                rec.scope("aim", |rec| aim(rec, bounce + 1))?;
            }
            rec.scope("collect", |rec| self.record_collect(rec, bounce))
        })
    }

    /// Its parts have times of their own.
    fn run(&self, rec: &mut Recorder) -> Result<()> {
        self.record(rec)
    }
}
