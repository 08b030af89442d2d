//! Direct light of the largest emitters with soft shadows by convolution ([`crate::pass::soft_shadow`]), one emitter after the other.

use super::{Counts, Eye, Stage};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Recorder, Resources};
use crate::pass::layout::Step;
use crate::pass::schedule::Schedule;
use crate::pass::shade::{Chunk, ShadowRays};
use crate::pass::soft_shadow::SoftShadow;
use crate::pass::trace::Trace;
use crate::pass::{Kit, TraversalKernels};
use crate::plan::{Plan, StepTable};

/// The stage.
pub struct SoftShadows {
    /// The pass, whose `direct` is the light of all emitters.
    pub pass: SoftShadow,
    emitters: Vec<OfEmitter>,
    counts: [Counts; 2],
    shadow_rays: ShadowRays,
    trace: (Trace, Vec<u32>),
    schedules: [Schedule; 2],
    list_step: u32,
}

/// Step and chunk of lights of one emitter.
struct OfEmitter {
    step: u32,
    chunk: Chunk,
}

impl SoftShadows {
    /// At the points of `eye`. `None`: the plan has no such emitters.
    pub fn new(kit: &Kit, scene: &DeviceScene, plan: &Plan, eye: &Eye) -> Result<Option<SoftShadows>> {
        if plan.soft_emitters.is_empty() {
            return Ok(None);
        }
        let settings = &plan.settings;
        let mut table = StepTable::default();
        let clusters = Chunk::clusters(settings, scene.clusters(kit.context));
        let emitters = (0..plan.soft_emitters.len() as u32)
            .map(|k| OfEmitter {
                step: table.add(Step { first: k, clears: u32::from(k == 0), ..Step::default() }),
                chunk: Chunk::new(&mut table, settings, (k, k + 1), clusters, false),
            })
            .collect();
        let rounds = table.add_list_rounds(plan);
        let list_step = table.add_list();
        let steps = table.stage(kit, "soft shadow steps")?;
        let pass = SoftShadow::new(kit, &eye.points, plan.lit_size(), &steps)?;
        let kernels = TraversalKernels::visibility(kit.context, settings.traversal, false)?;
        let own = Resources::of([("lights", &pass.lights), ("visible", &pass.visible)]);
        let nothing_more = Resources::new();
        let of_clusters = scene.wide_nodes.as_ref().map(|_| &nothing_more);
        let sets = [&eye.points.resources(), &own];
        let rays = (&pass.list, &eye.rays.progress);
        Ok(Some(SoftShadows {
            shadow_rays: ShadowRays::new(kit, &kernels, &sets, of_clusters, rays, &steps)?,
            trace: (Trace::new(kit, &pass.rays, &pass.blocked, &steps)?, rounds),
            schedules: [Schedule::new(kit, &pass.list.work, &steps)?, Schedule::new(kit, &pass.blocked.work, &steps)?],
            counts: [Counts::new(kit, 1, [&pass.list])?, Counts::new(kit, 1, [&pass.blocked])?],
            emitters,
            list_step,
            pass,
        }))
    }

    /// Number of its emitters.
    pub fn emitters(&self) -> usize {
        self.emitters.len()
    }

    /// Records the part before the first emitter.
    pub fn record_list(&self, rec: &mut Recorder) -> Result<()> {
        self.counts[0].record_clear(rec)?;
        self.pass.record_list(rec)?;
        self.schedules[0].record(rec, self.list_step)
    }

    /// Records the shadow rays of emitter k.
    pub fn record_rays(&self, rec: &mut Recorder, k: usize) -> Result<()> {
        rec.fill(&self.pass.visible, 0)?;
        self.shadow_rays.record(rec, [&self.emitters[k].chunk])
    }

    /// Records the distances of what blocks its light.
    pub fn record_blockers(&self, rec: &mut Recorder, k: usize) -> Result<()> {
        self.counts[1].record_clear(rec)?;
        self.pass.record_source(rec, k as u32)?;
        self.schedules[1].record(rec, self.list_step)?;
        self.trace.0.record(rec, &self.trace.1, None)?;
        self.pass.record_blockers(rec)
    }

    /// Records the widths of its kernels.
    pub fn record_search(&self, rec: &mut Recorder) -> Result<()> {
        self.pass.record_search(rec)
    }

    /// Records the convolution, and its light.
    pub fn record_convolution(&self, rec: &mut Recorder, k: usize) -> Result<()> {
        self.pass.record_convolution(rec, self.emitters[k].step)
    }
}

impl Stage for SoftShadows {
    const NAME: &'static str = "soft_shadows";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_list(rec)?;
        (0..self.emitters.len()).try_for_each(|k| {
            rec.scope("soft_rays", |rec| self.record_rays(rec, k))?;
            rec.scope("soft_blockers", |rec| self.record_blockers(rec, k))?;
            rec.scope("soft_search", |rec| self.record_search(rec))?;
            rec.scope("soft_convolve", |rec| self.record_convolution(rec, k))
        })
    }
}
