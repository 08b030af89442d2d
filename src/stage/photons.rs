//! Caustic photons: shot, followed, sorted into a grid, and looked up at the visible points.

use super::{Counts, Eye, Shade, Stage, Walk, batch};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder};
use crate::pass::layout::{DispatchCounts, Step};
use crate::pass::photon_find::PhotonFind;
use crate::pass::photon_follow::{self, PhotonFollow};
use crate::pass::photon_grid::{Grid, PhotonGrid};
use crate::pass::photon_light::PhotonLight;
use crate::pass::photon_lights::PhotonLights;
use crate::pass::photon_radius::PhotonRadius;
use crate::pass::photon_start::PhotonStart;
use crate::pass::photon_width::PhotonWidth;
use crate::pass::schedule::{Schedule, groups_of};
use crate::pass::sort::SortSteps;
use crate::pass::trace::Trace;
use crate::pass::{Kit, List, Rays};
use crate::plan::{PhotonPlan, Plan, StepTable};

/// Shoots photons from the emitters at mirrors and glass and sorts them into a grid.
pub struct Photons {
    /// Number of photons of all classes.
    pub count: u32,
    /// Their rays; of a stored photon, the ray on which it arrived.
    pub rays: Rays,
    /// Flux of each if its class had this photon only; w: bits of what it is aimed at ([`Shot::aim`](crate::light::targets::Shot::aim)).
    pub flux: Buffer,
    /// Glass media around each.
    pub media: Buffer,
    /// Position of each stored photon; w: 1 if stored.
    pub position: Buffer,
    /// Geometric normal there, on the side of arrival.
    pub normal: Buffer,
    /// For each step, the photons that continue.
    pub lists: Vec<List>,
    /// The stored photons in their grid.
    pub grid: Grid,
    /// Weights of the virtual lights that photons start from.
    pub lights: PhotonLights,
    counts: Counts,
    grid_work: Buffer,
    start: PhotonStart,
    first_trace: (Trace, Vec<u32>),
    follow: Vec<Follow>,
    list_step: u32,
    list_rounds: Vec<u32>,
    radius: PhotonRadius,
    sort: (PhotonGrid, SortSteps),
}

/// A step along the photons' paths.
struct Follow {
    pass: PhotonFollow,
    step: u32,
    schedule: Schedule,
    trace: Trace,
}

impl Photons {
    /// `None`: there are no photons, or no targets.
    pub fn new(kit: &Kit, plan: &Plan, walk: &Walk) -> Result<Option<Photons>> {
        let Some(photons) = &plan.photons else { return Ok(None) };
        let count = photons.total();
        let mut table = StepTable::default();
        let first = Step { end: count, steps: plan.trace_steps(), ..Step::default() };
        let first_rounds = table.add_rounds(plan.trace_rounds(), first);
        let mirrored_lights = u32::from(plan.mirrors.is_some());
        let follow_steps: Vec<u32> = (0..=photons.steps)
            .map(|bounce| {
                let last = u32::from(bounce == photons.steps);
                table.add(Step { bounce, last, mirrored_lights, ..Step::default() })
            })
            .collect();
        let list_step = table.add_list();
        let list_rounds = table.add_list_rounds(plan);
        let sort_steps = SortSteps::new(&mut table, 1);
        let steps = table.stage(kit, "photon steps")?;

        let rays = Rays::new(kit.context, "photon", count)?;
        let flux = kit.vec4s("photon flux", count)?;
        let media = kit.vec4s("photon media", count)?;
        let position = kit.vec4s("photon position", count)?;
        let normal = kit.vec4s("photon normal", count)?;
        let grid = Grid::new(kit, photons)?;
        // A list is filled while the previous one is still needed, so two buffers alternate.
        let turns = [kit.array("photon list 0", count, 4)?, kit.array("photon list 1", count, 4)?];
        let list = |i: usize| List::new(kit, &format!("photons {i}"), &turns[i % 2]);
        let lists = (0..follow_steps.len()).map(list).collect::<Result<Vec<List>>>()?;
        let batch = batch(kit, "photons")?;
        let follow = (lists.iter().zip(follow_steps).enumerate())
            .map(|(i, (list_out, step))| {
                let inputs = photon_follow::Inputs {
                    rays: &rays,
                    flux: &flux,
                    media: &media,
                    position: &position,
                    normal: &normal,
                    list_in: i.checked_sub(1).map_or(&batch, |before| &lists[before]),
                    list_out,
                };
                Ok(Follow {
                    pass: PhotonFollow::new(kit, &inputs, &steps)?,
                    step,
                    schedule: Schedule::new(kit, &list_out.work, &steps)?,
                    trace: Trace::new(kit, &rays, list_out, &steps)?,
                })
            })
            .collect::<Result<_>>()?;
        let grid_work = DispatchCounts { total: count, total_groups: groups_of(count), ..DispatchCounts::default() };
        let stored = [&flux, &position, &normal];
        let lights = PhotonLights::new(kit, &walk.lights, photons.classes)?;
        Ok(Some(Photons {
            count,
            counts: Counts::new(kit, 1, lists.iter().chain([&batch]))?,
            grid_work: kit.stage("photon grid's first work", &[grid_work])?,
            start: PhotonStart::new(kit, (&walk.lights, &lights.sums), &rays, [&flux, &position], count)?,
            first_trace: (Trace::new(kit, &rays, &batch, &steps)?, first_rounds),
            follow,
            list_step,
            list_rounds,
            radius: PhotonRadius::new(kit, &position)?,
            sort: (PhotonGrid::new(kit, &rays, stored, &grid, &steps, count)?, sort_steps),
            lights,
            rays,
            flux,
            media,
            position,
            normal,
            lists,
            grid,
        }))
    }

    /// Records the start of the photons and their first hits.
    pub fn record_start(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)?;
        rec.copy(&self.grid_work, &self.grid.list.work)?;
        self.lights.record(rec)?;
        self.start.record(rec)?;
        self.first_trace.0.record(rec, &self.first_trace.1, Some(self.count))
    }

    /// Records a step at mirrors and glass, from 0; photons at other surfaces are stored. Nothing is traced after the
    /// last step.
    pub fn record_step(&self, rec: &mut Recorder, step: usize) -> Result<()> {
        let follow = &self.follow[step];
        follow.pass.record(rec, follow.step, (step == 0).then_some(self.count))?;
        if step + 1 == self.follow.len() {
            return Ok(());
        }
        let from = step.checked_sub(1).map(|before| &self.lists[before].work);
        follow.schedule.record_filled_from(rec, self.list_step, from)?;
        follow.trace.record(rec, &self.list_rounds, None)
    }

    /// Records the radius of the look-up and the sorting of the stored photons into the grid.
    pub fn record_grid(&self, rec: &mut Recorder) -> Result<()> {
        self.radius.record(rec)?;
        self.sort.0.record(rec, &self.sort.1)
    }
}

impl Stage for Photons {
    const NAME: &'static str = "photons";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_start(rec)?;
        (0..self.follow.len()).try_for_each(|step| self.record_step(rec, step))?;
        self.record_grid(rec)
    }
}

/// Adds the photons' light to the lighting of the visible points.
pub struct PhotonLighting {
    /// The shading points that may have photons around them.
    pub found: List,
    /// Irradiance by those of small footprints, of each slot of first and second components; `None`: the filter averages it too.
    pub caustic: Option<Buffer>,
    counts: Counts,
    find: PhotonFind,
    width: PhotonWidth,
    light: PhotonLight,
    list_step: u32,
    stretches: Vec<u32>,
}

impl PhotonLighting {
    /// Adds to the lighting of `shade`. `None`: there are no photons.
    pub fn new(
        kit: &Kit,
        plan: &Plan,
        photons: Option<&Photons>,
        (eye, shade): (&Eye, &Shade),
    ) -> Result<Option<PhotonLighting>> {
        let Some(photons) = photons else { return Ok(None) };
        let mut table = StepTable::default();
        let list_step = table.add_list();
        let chunk = PhotonPlan::chunk(plan.settings.loop_budget, plan.scene.tables);
        let stretches = (0..photons.count)
            .step_by(chunk as usize)
            .map(|first| table.add(Step { first, end: photons.count.min(first + chunk), ..Step::default() }))
            .collect();
        let steps = table.stage(kit, "photon light steps")?;
        let entries = kit.array("points with photons", 1, eye.list.entries.bytes())?;
        let found = List::new(kit, "points with photons", &entries)?;
        let keeps = plan.settings.filter.is_some() && !plan.settings.interleave_photons;
        let caustic = kit.vec4s("caustic", if keeps { plan.eye.pixels * plan.eye.components } else { 1 })?;
        Ok(Some(PhotonLighting {
            counts: Counts::new(kit, 1, [&found])?,
            find: PhotonFind::new(kit, &eye.points, &eye.list, &photons.grid, &found, &steps)?,
            width: PhotonWidth::new(kit, &photons.grid, photons.count, &steps)?,
            light: PhotonLight::new(kit, &eye.points, &found, &photons.grid, (&shade.lighting, &caustic), &steps)?,
            list_step,
            stretches,
            found,
            caustic: Some(caustic).filter(|_| keeps),
        }))
    }
}

impl Stage for PhotonLighting {
    const NAME: &'static str = "photons";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.counts.record_clear(rec)?;
        self.caustic.as_ref().map_or(Ok(()), |caustic| rec.fill(caustic, 0))?;
        self.find.record(rec, self.list_step)?;
        self.width.record(rec, &self.stretches)?;
        self.light.record(rec, &self.stretches)
    }
}
