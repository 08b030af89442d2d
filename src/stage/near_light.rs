//! Near light that clipping cut off, mostly from irradiance that other pixels have already: one near ray for each shading
//! point (see [`crate::pass::near_points`]), and one at near emitters (see [`crate::pass::near_aim`]).

use super::points::chunks;
use super::{Counts, Eye, PointOrder, Shade, SoftShadows, Stage};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Recorder};
use crate::pass::gather::Gather;
use crate::pass::layout::Step;
use crate::pass::light_lists::LightLists;
use crate::pass::near_aim::{NearAim, Source};
use crate::pass::near_collect::{self, NearCollect};
use crate::pass::near_points::{self, NearPoints};
use crate::pass::schedule::Schedule;
use crate::pass::shade::{self, Chunk};
use crate::pass::trace::Trace;
use crate::pass::{Kit, Lighting, List, ShadingPoints};
use crate::plan::{Plan, StepTable};
use crate::ring::Paths;

/// The stage.
pub struct NearLight {
    /// Hits of near rays.
    pub points: ShadingPoints,
    /// Throughput of near rays; w: the lobe.
    pub beta: Buffer,
    /// Pixels that show the hits, or [`near_points::NOT_SHOWN`].
    pub near_slot: Buffer,
    /// Light at hits that no pixel shows.
    pub hit_lighting: Lighting,
    /// These hits.
    pub list: List,
    /// Points that near rays start from.
    pub started: List,
    /// Near rays that go on from hits that no pixel shows.
    pub onward: List,
    /// Near light: direct and indirect; w of the first: the lobe.
    pub near: [Buffer; 2],
    /// Points, and lit hits of near rays, with a ray towards a near emitter.
    pub aimed: [List; 2],
    counts: Counts,
    aim: [(NearAim, Trace, Schedule); 2],
    gather: (Gather, u32),
    trace: (Trace, Vec<u32>),
    near_points: NearPoints,
    onward_trace: Trace,
    onward_points: NearPoints,
    schedules: [Schedule; 3],
    list_step: u32,
    shade: (shade::Shade, Vec<Chunk>),
    delta: u32,
    collect: NearCollect,
}

impl NearLight {
    /// From the points of `eye`, lit by the lights of `lists` and, with soft shadows, by `soft`. `None`: nothing is cut off, or it is gathered exactly.
    pub fn new(
        kit: &Kit,
        scene: &DeviceScene,
        plan: &Plan,
        (eye, lists, shade): (&Eye, &LightLists, &Shade),
        soft: Option<&SoftShadows>,
    ) -> Result<Option<NearLight>> {
        if !plan.reuses_pixels() {
            return Ok(None);
        }
        let slots = plan.eye.slots();
        let mut table = StepTable::default();
        let gather_step = table.add(Step { bounce: 0, ..Step::default() });
        let rounds = table.add_list_rounds(plan);
        let list_step = table.add_list();
        // Single rays: the hits are few and far between. They have no near light of their own, so their lights are clipped
        // closer.
        let chunks = chunks(&mut table, plan, (kit.context, scene), 1, PointOrder::Any);
        chunks.iter().flat_map(|chunk| &chunk.rounds).for_each(|&step| table.steps[step as usize].closer = 1);
        let steps = table.stage(kit, "near steps")?;
        let points = ShadingPoints::new(kit.context, "near", slots)?;
        let hit_lighting = Lighting::new(kit.context, "near", slots)?;
        let beta = kit.vec4s("near beta", slots)?;
        let near_slot = kit.array("near slots", slots, 4)?;
        let near = [kit.vec4s("near direct", slots)?, kit.vec4s("near indirect", slots)?];
        let list = List::new(kit, "near points", &kit.array("near points list", slots, 4)?)?;
        let started = List::new(kit, "near rays", &kit.array("near rays list", slots, 4)?)?;
        let onward = List::new(kit, "near rays onward", &kit.array("near rays onward list", slots, 4)?)?;
        let aimed = [
            List::new(kit, "near emitters", &kit.array("near emitters list", slots, 4)?)?,
            List::new(kit, "near emitters of hits", &kit.array("list of near emitters of hits", slots, 4)?)?,
        ];
        let inputs = near_points::Inputs {
            rays: &eye.rays,
            list_in: &started,
            seen: &eye.points,
            list_out: &list,
            beta: &beta,
            near_slot: &near_slot,
            points: &points,
            onward: &onward,
        };
        let shade_inputs = shade::Inputs {
            points: &points,
            list: &list,
            lists,
            progress: &eye.rays.progress,
            lighting: &hit_lighting,
            classes: None,
        };
        let collect_inputs = near_collect::Inputs {
            all: &eye.list,
            list: &started,
            points: &points,
            lighting: &hit_lighting,
            beta: &beta,
            near_slot: &near_slot,
            pixels: &shade.lighting,
            soft_direct: soft.map(|soft| &soft.pass.direct),
            seen: &eye.points,
            near: &near,
        };
        Ok(Some(NearLight {
            counts: Counts::new(kit, 1, [&list, &started, &onward, &aimed[0], &aimed[1]])?,
            aim: [
                (
                    NearAim::new(
                        kit,
                        (Source::Pixels, &eye.points),
                        (&eye.list, &aimed[0]),
                        &eye.rays,
                        &shade.lighting.direct,
                    )?,
                    Trace::new(kit, &eye.rays, &aimed[0], &steps)?,
                    Schedule::new(kit, &aimed[0].work, &steps)?,
                ),
                (
                    NearAim::new(kit, (Source::Hits, &points), (&list, &aimed[1]), &eye.rays, &hit_lighting.direct)?,
                    Trace::new(kit, &eye.rays, &aimed[1], &steps)?,
                    Schedule::new(kit, &aimed[1].work, &steps)?,
                ),
            ],
            gather: (
                Gather::of_near_rays(kit, &eye.points, (&eye.list, &started), &eye.rays, &beta, &steps)?,
                gather_step,
            ),
            trace: (Trace::new(kit, &eye.rays, &started, &steps)?, rounds),
            near_points: NearPoints::new(kit, &inputs)?,
            onward_trace: Trace::new(kit, &eye.rays, &onward, &steps)?,
            onward_points: NearPoints::onward(kit, &inputs)?,
            schedules: [
                Schedule::new(kit, &started.work, &steps)?,
                Schedule::new(kit, &onward.work, &steps)?,
                Schedule::new(kit, &list.work, &steps)?,
            ],
            list_step,
            shade: (shade::Shade::new(kit, &shade_inputs, &steps)?, chunks),
            delta: plan.lists.delta,
            collect: NearCollect::new(kit, plan, &collect_inputs)?,
            points,
            beta,
            near_slot,
            hit_lighting,
            list,
            started,
            onward,
            aimed,
            near,
        }))
    }

    /// Records its passes for lights of these paths.
    pub fn run_paths(&self, rec: &mut Recorder, paths: &Paths) -> Result<()> {
        rec.scope(Self::NAME, |rec| self.record_paths(rec, paths))
    }

    /// Records the part that pixels of one class need no others for, for [`NearLight::run_spread`] elsewhere. Where no near ray starts the means are 0.
    pub(crate) fn run_means(&self, rec: &mut Recorder, paths: &Paths) -> Result<()> {
        rec.scope(Self::NAME, |rec| {
            self.means().into_iter().try_for_each(|mean| rec.fill(mean, 0))?;
            self.record_light(rec, paths)?;
            rec.scope("near_collect", |rec| self.collect.record_means(rec))
        })
    }

    /// Records the rest.
    pub(crate) fn run_spread(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope(Self::NAME, |rec| self.collect.record_spread(rec))
    }

    /// Means over neighbours of a class, slot by slot, direct and indirect, that spread over the pixels of all classes; none where they do not.
    pub(crate) fn means(&self) -> Vec<&Buffer> {
        let means = [&self.hit_lighting.direct, &self.hit_lighting.indirect];
        means.into_iter().filter(|_| self.collect.spreads()).collect()
    }

    fn record_paths(&self, rec: &mut Recorder, paths: &Paths) -> Result<()> {
        self.record_light(rec, paths)?;
        rec.scope("near_collect", |rec| self.record_collect(rec))
    }

    fn record_light(&self, rec: &mut Recorder, paths: &Paths) -> Result<()> {
        rec.scope("near_aim", |rec| self.record_aimed(rec))?;
        self.record_rays(rec)?;
        rec.scope("near_points", |rec| self.record_points(rec))?;
        rec.scope("near_onward", |rec| self.record_onward(rec))?;
        rec.scope("near_shade", |rec| self.record_shade(rec, paths))
    }

    fn record_aimed(&self, rec: &mut Recorder) -> Result<()> {
        self.record_aimed_rays(rec)?;
        self.record_aimed_light(rec, 0)
    }

    /// Clears the counts, and traces rays towards near emitters.
    pub fn record_aimed_rays(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)?;
        self.record_aim(rec, 0)
    }

    fn record_aim(&self, rec: &mut Recorder, k: usize) -> Result<()> {
        let (aim, trace, schedule) = &self.aim[k];
        aim.record_rays(rec)?;
        schedule.record(rec, self.list_step)?;
        trace.record(rec, &self.trace.1, None)
    }

    /// Adds what the rays of [`NearLight::aimed`] number `k` found to the light of their points.
    pub fn record_aimed_light(&self, rec: &mut Recorder, k: usize) -> Result<()> {
        self.aim[k].0.record_light(rec)
    }

    /// The part up to the hits of the near rays.
    pub fn record_rays(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope("near_gather", |rec| self.gather.0.record(rec, self.gather.1))?;
        self.schedules[0].record(rec, self.list_step)?;
        rec.scope("near_trace", |rec| self.trace.0.record(rec, &self.trace.1, None))
    }

    /// The part that finds pixels that show the hits.
    pub fn record_points(&self, rec: &mut Recorder) -> Result<()> {
        self.near_points.record(rec)
    }

    /// The part that traces rays from lit hits to near emitters, and follows those that go on from hits that no pixel shows.
    pub fn record_onward(&self, rec: &mut Recorder) -> Result<()> {
        self.schedules[2].record(rec, self.list_step)?;
        self.record_aim(rec, 1)?;
        self.schedules[1].record(rec, self.list_step)?;
        self.onward_trace.record(rec, &self.trace.1, None)?;
        self.onward_points.record(rec)?;
        self.schedules[2].record(rec, self.list_step)
    }

    /// Hits that no pixel shows are lit by lights of these paths.
    pub fn record_shade(&self, rec: &mut Recorder, paths: &Paths) -> Result<()> {
        self.shade.0.record(rec, self.shade.1.iter().filter(|chunk| chunk.is_lit(paths, self.delta)))?;
        self.record_aimed_light(rec, 1)
    }

    /// The light goes back to the pixels.
    pub fn record_collect(&self, rec: &mut Recorder) -> Result<()> {
        self.collect.record(rec)
    }
}

impl Stage for NearLight {
    const NAME: &'static str = "near_light";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_paths(rec, &Paths::default())
    }
}
