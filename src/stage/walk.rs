//! The particles' walk: particles start from the emitters and leave a point light at every vertex of their paths.

use super::{Counts, Stage, batch};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Staging};
use crate::pass::layout::{PointLight, Step};
use crate::pass::schedule::Schedule;
use crate::pass::trace::Trace;
use crate::pass::walk_follow::{self, WalkFollow};
use crate::pass::walk_reflect::WalkReflect;
use crate::pass::walk_start::WalkStart;
use crate::pass::{Kit, List, Rays};
use crate::plan::{Plan, StepTable};

/// The stage.
pub struct Walk {
    /// [`PointLight`]s: for each class of pixels the delta lights, then those of particles by number of reflections.
    pub lights: Buffer,
    /// Rays of the particles.
    pub particles: Rays,
    /// Flux of each particle; w: mirrors and glass on its path.
    pub flux: Buffer,
    /// Glass media around each particle.
    pub media: Buffer,
    /// Whether the lights are those that it was to go on with.
    pub keeps: bool,
    counts: Counts,
    start: WalkStart,
    trace: Trace,
    reflect: WalkReflect,
    /// For the reflections j = 1, 2, ...
    reflections: Vec<Reflection>,
    list_step: u32,
    list_rounds: Vec<u32>,
    classes: u32,
    slots: u32,
}

/// A reflection and what comes before it.
struct Reflection {
    /// Particles that may make it.
    count: u32,
    /// Rounds of the rays up to it.
    rounds: Vec<u32>,
    /// Steps through mirrors and glass, each with its number in the table.
    follow: Vec<(Follow, u32)>,
    step: u32,
}

/// One step through mirrors and glass.
struct Follow {
    pass: WalkFollow,
    schedule: Schedule,
    trace: Trace,
    /// Particles that continue.
    list: List,
}

impl Walk {
    /// Particles start from `emitters`, whose records hold the probability of each. `kept`: lights of a ring to go on with.
    pub fn new(kit: &Kit, scene: &DeviceScene, plan: &Plan, emitters: &Buffer, kept: Option<&Buffer>) -> Result<Walk> {
        let classes = plan.settings.classes();
        let particle_count = plan.particles * classes;
        let mut table = StepTable::default();
        let survivors = &plan.lights.survivors;
        let reflections: Vec<(u32, Vec<u32>, Vec<u32>, u32)> = (1..survivors.len())
            .map(|j| {
                // Ray j starts at every particle that has made j - 1 reflections and survives the next.
                let (end, steps) = (survivors[j] * classes, plan.trace_steps());
                let rays = table.add_rounds(plan.trace_rounds(), Step { end, steps, ..Step::default() });
                let follow = (0..plan.walk_steps(scene, j as u32))
                    .map(|i| {
                        let clears = u32::from((i, j) == (0, 1));
                        table.add(Step { bounce: j as u32, indirect: u32::from(i > 0), clears, ..Step::default() })
                    })
                    .collect();
                (end, rays, follow, table.add(Step { bounce: j as u32, ..Step::default() }))
            })
            .collect();
        let list_step = table.add_list();
        let list_rounds = table.add_list_rounds(plan);
        let steps = table.stage(kit, "walk steps")?;
        let slots = plan.lights.slots();
        let mut of_class = plan.delta_slots(scene).into_owned();
        of_class.resize(slots.max(1) as usize, PointLight::default());
        let bytes = u64::from(slots) * size_of::<PointLight>() as u64;
        let kept = kept.filter(|lights| classes == 1 && slots > 0 && lights.bytes() == bytes);
        let lights = match kept {
            None => kit.stage("lights", &of_class.repeat(classes as usize))?,
            Some(lights) => {
                let delta = &of_class[..plan.lights.delta as usize];
                kit.staging.borrow_mut().stage_into(kit.context, lights, 0, delta)?;
                lights.clone()
            }
        };
        let particles = Rays::new(kit.context, "particle", particle_count)?;
        let flux = kit.vec4s("particle flux", particle_count)?;
        let batch = batch(kit, "particles")?;
        let follows = reflections.iter().any(|(_, _, follow, _)| !follow.is_empty());
        let media = kit.vec4s("particle media", if follows { particle_count } else { 1 })?;
        // A list is filled while the previous one is still needed, so two buffers alternate.
        let length = if follows { particle_count } else { 1 };
        let turns = [kit.array("particle list 0", length, 4)?, kit.array("particle list 1", length, 4)?];
        let reflections = reflections
            .into_iter()
            .map(|(count, rounds, numbers, step)| {
                let mut list_in = batch.clone();
                let mut follow = Vec::new();
                for (i, number) in numbers.into_iter().enumerate() {
                    let list = List::new(kit, &format!("particles {i}"), &turns[i % 2])?;
                    let inputs = walk_follow::Inputs {
                        particles: &particles,
                        flux: &flux,
                        media: &media,
                        list_in: &list_in,
                        list_out: &list,
                    };
                    let made = Follow {
                        pass: WalkFollow::new(kit, &inputs, &steps)?,
                        schedule: Schedule::new(kit, &list.work, &steps)?,
                        trace: Trace::new(kit, &particles, &list, &steps)?,
                        list: list.clone(),
                    };
                    follow.push((made, number));
                    list_in = list;
                }
                Ok(Reflection { count, rounds, follow, step })
            })
            .collect::<Result<Vec<_>>>()?;
        let lists = reflections.iter().flat_map(|r| r.follow.iter().map(|(follow, _)| &follow.list));
        Ok(Walk {
            counts: Counts::new(kit, classes, lists.chain([&batch]))?,
            start: WalkStart::new(kit, emitters, &particles, [&flux, &lights], particle_count)?,
            trace: Trace::new(kit, &particles, &batch, &steps)?,
            reflect: WalkReflect::new(kit, &particles, [&flux, &lights], &steps)?,
            reflections,
            list_step,
            list_rounds,
            lights,
            particles,
            flux,
            media,
            keeps: kept.is_some(),
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
        let Some(reflection) = j.checked_sub(1).and_then(|i| self.reflections.get(i)) else { return Ok(()) };
        self.trace.record(rec, &reflection.rounds, Some(reflection.count))?;
        (0..reflection.follow.len()).try_for_each(|step| self.record_follow(rec, j, step))?;
        self.reflect.record(rec, reflection.step, reflection.count)
    }

    /// Records the rays up to the j-th reflection, without mirrors and glass.
    pub fn record_rays(&self, rec: &mut Recorder, j: usize) -> Result<()> {
        let Reflection { rounds, count, .. } = &self.reflections[j - 1];
        self.trace.record(rec, rounds, Some(*count))
    }

    /// Number of steps through mirrors and glass before the j-th reflection.
    pub fn follow_steps(&self, j: usize) -> usize {
        self.reflections[j - 1].follow.len()
    }

    /// Records one of them, from 0, and the rays after it.
    pub fn record_follow(&self, rec: &mut Recorder, j: usize, step: usize) -> Result<()> {
        let Reflection { follow: steps, count, .. } = &self.reflections[j - 1];
        let (follow, number) = &steps[step];
        follow.pass.record(rec, *number, (step == 0).then_some(*count))?;
        let from = step.checked_sub(1).map(|before| &steps[before].0.list.work);
        follow.schedule.record_filled_from(rec, self.list_step, from)?;
        follow.trace.record(rec, &self.list_rounds, None)
    }

    /// Records the reflection alone.
    pub fn record_reflect(&self, rec: &mut Recorder, j: usize) -> Result<()> {
        let Reflection { step, count, .. } = self.reflections[j - 1];
        self.reflect.record(rec, step, count)
    }
}

impl Stage for Walk {
    const NAME: &'static str = "walk";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_start(rec)?;
        (1..=self.reflections.len()).try_for_each(|j| self.record_reflection(rec, j))
    }
}
