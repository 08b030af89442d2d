//! The particles' walk: particles start from the emitters and leave a point light at every vertex of their paths.

use super::{Counts, Stage, batch};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Staging};
use crate::pass::layout::{PointLight, Step};
use crate::pass::trace::Trace;
use crate::pass::walk_reflect::WalkReflect;
use crate::pass::walk_start::WalkStart;
use crate::pass::{Kit, Rays};
use crate::plan::{Plan, StepTable, trace_steps};

/// The stage.
pub struct Walk {
    /// [`PointLight`]s: for each class of pixels the delta lights, then those of particles by number of reflections.
    pub lights: Buffer,
    /// Rays of the particles.
    pub particles: Rays,
    /// Flux of each particle.
    pub flux: Buffer,
    counts: Counts,
    start: WalkStart,
    trace: Trace,
    reflect: WalkReflect,
    /// For the reflections j = 1, 2, ...: the rounds of the rays up to it, and its step.
    reflections: Vec<(Vec<u32>, u32)>,
    particle_count: u32,
    classes: u32,
    slots: u32,
}

impl Walk {
    /// Particles start from `emitters`, whose records hold the probability of each.
    pub fn new(kit: &Kit, scene: &DeviceScene, plan: &Plan, emitters: &Buffer) -> Result<Walk> {
        let (settings, classes) = (&plan.settings, plan.settings.classes());
        let particle_count = settings.particles();
        let mut table = StepTable::default();
        let survivors = &plan.lights.survivors;
        let reflections = (1..survivors.len())
            .map(|j| {
                // Ray j starts at every particle that has made j - 1 reflections and survives the next.
                let (end, steps) = (survivors[j] * classes, trace_steps(settings.loop_budget));
                let rays = table.add_rounds(settings.rounds, Step { end, steps, ..Step::default() });
                (rays, table.add(Step { bounce: j as u32, ..Step::default() }))
            })
            .collect();
        let steps = table.stage(kit, "walk steps")?;
        let slots = plan.lights.slots();
        let mut of_class = plan.delta_slots(scene).into_owned();
        of_class.resize(slots.max(1) as usize, PointLight::default());
        let lights = kit.stage("lights", &of_class.repeat(classes as usize))?;
        let particles = Rays::new(kit.context, "particle", particle_count)?;
        let flux = kit.vec4s("particle flux", particle_count)?;
        let batch = batch(kit, "particles")?;
        Ok(Walk {
            counts: Counts::new(kit, classes, [&batch])?,
            start: WalkStart::new(kit, emitters, &particles, [&flux, &lights], particle_count)?,
            trace: Trace::new(kit, &particles, &batch, &steps)?,
            reflect: WalkReflect::new(kit, &particles, [&flux, &lights], &steps)?,
            reflections,
            lights,
            particles,
            flux,
            particle_count,
            classes,
            slots,
        })
    }

    /// Stages changed delta lights at the beginning of each class; their number must not change.
    pub fn stage_delta(&self, context: &Context, staging: &mut Staging, delta: &[PointLight]) -> Result<()> {
        let class = u64::from(self.slots) * size_of::<PointLight>() as u64;
        (0..u64::from(self.classes)).try_for_each(|i| staging.stage_into(context, &self.lights, i * class, delta))
    }

    /// Records the start of the particles and the lights on the emitters.
    pub fn record_start(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)?;
        self.start.record(rec)
    }

    /// Records the j-th reflection, from one vertex to the next; j from 1.
    pub fn record_reflection(&self, rec: &mut Recorder, j: usize) -> Result<()> {
        let Some((rounds, reflect)) = j.checked_sub(1).and_then(|i| self.reflections.get(i)) else { return Ok(()) };
        self.trace.record(rec, rounds, Some(self.particle_count))?;
        self.reflect.record(rec, *reflect, self.particle_count)
    }
}

impl Stage for Walk {
    const NAME: &'static str = "walk";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_start(rec)?;
        (1..=self.reflections.len()).try_for_each(|j| self.record_reflection(rec, j))
    }
}
