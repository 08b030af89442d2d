//! Caustic photons within the frame: their buffers and passes.

use crate::error::Result;
use crate::gpu::{Buffer, Context, Memory, Recorder, Staging};
use crate::pass::layout::{Step, Work};
use crate::pass::photon_find::PhotonFind;
use crate::pass::photon_follow::{self, PhotonFollow};
use crate::pass::photon_grid::{Grid, PhotonGrid};
use crate::pass::photon_light::PhotonLight;
use crate::pass::photon_start::PhotonStart;
use crate::pass::schedule::{Schedule, groups_of};
use crate::pass::sort::SortSteps;
use crate::pass::trace::Trace;
use crate::pass::{Kernels, List, Rays, Receivers, Sums, vec4s};
use crate::plan::{PhotonPlan, StepTable, trace_steps};
use crate::scene_buffers::{SceneBuffers, TargetBuffers};
use crate::settings::Settings;

/// Photons are shot, followed, sorted into a grid, and light what the eye sees.
pub struct Photons {
    /// Photons of all classes.
    pub count: u32,
    /// Their rays; where a photon is stored, that of its arrival.
    pub rays: Rays,
    /// Flux of each if it were the only one of its class; w: bits of its target + 1.
    pub flux: Buffer,
    /// Bodies of glass around each.
    pub media: Buffer,
    /// Where each is stored; w: 1 if it is.
    pub position: Buffer,
    /// Geometric normal there, on the side of its arrival.
    pub normal: Buffer,
    /// For each step the photons that go on.
    pub lists: Vec<List>,
    /// The stored photons in their grid.
    pub grid: Grid,
    /// The receivers that may have photons around them.
    pub found: List,
    batch: List,
    clear_work: Buffer,
    grid_work: Buffer,
    start: PhotonStart,
    first_trace: Trace,
    steps: Vec<(PhotonFollow, Schedule, Trace)>,
    sort: PhotonGrid,
    find: PhotonFind,
    light: PhotonLight,
    numbers: PhotonSteps,
}

/// Indices into the step table.
pub(super) struct PhotonSteps {
    first_trace: Vec<u32>,
    follow: Vec<u32>,
    list: u32,
    list_trace: Vec<u32>,
    sort: SortSteps,
    light: Vec<u32>,
}

impl PhotonSteps {
    /// Adds the steps to the table.
    pub(super) fn new(
        table: &mut StepTable,
        settings: &Settings,
        plan: &PhotonPlan,
        mirrored_lights: bool,
    ) -> PhotonSteps {
        let trace = Step { steps: trace_steps(settings.loop_budget), ..Step::default() };
        let fresh = u32::from(mirrored_lights);
        let chunk = PhotonPlan::chunk(settings.loop_budget);
        PhotonSteps {
            first_trace: table.add_rounds(settings.rounds, Step { end: plan.total(), ..trace }),
            follow: (0..=plan.steps)
                .map(|bounce| {
                    table.add(Step { bounce, last: u32::from(bounce == plan.steps), fresh, ..Step::default() })
                })
                .collect(),
            list: table.add(Step { indirect: 1, ..Step::default() }),
            list_trace: table.add_rounds(settings.rounds, Step { indirect: 1, ..trace }),
            sort: SortSteps::new(table, 1),
            light: (0..plan.total())
                .step_by(chunk as usize)
                .map(|first| table.add(Step { first, end: plan.total().min(first + chunk), ..Step::default() }))
                .collect(),
        }
    }
}

/// What the photons' passes share with the frame.
pub(super) struct Inputs<'a> {
    pub(super) parameters: &'a Buffer,
    pub(super) scene: &'a SceneBuffers,
    pub(super) targets: &'a TargetBuffers,
    pub(super) receivers: &'a Receivers,
    pub(super) list: &'a List,
    pub(super) sums: &'a Sums,
    pub(super) steps: &'a Buffer,
    pub(super) status: &'a Buffer,
}

impl Photons {
    /// Creates the passes. The receivers on `list` are lit.
    pub(super) fn new(
        context: &Context,
        kernels: &Kernels,
        staging: &mut Staging,
        plan: &PhotonPlan,
        numbers: PhotonSteps,
        inputs: &Inputs,
    ) -> Result<Photons> {
        let Inputs { parameters, scene, targets, receivers, list, sums, steps, status } = *inputs;
        let count = plan.total();
        let device = |name: &str, bytes: u64| Buffer::new(context, name, bytes, Memory::Device);
        let rays = Rays::new(context, "photon", count)?;
        let flux = vec4s(context, "photon flux", count)?;
        let media = vec4s(context, "photon media", count)?;
        let position = vec4s(context, "photon position", count)?;
        let normal = vec4s(context, "photon normal", count)?;
        let grid = Grid::new(context, plan)?;

        // Photons are listed while the list before is still needed, so two take turns.
        let even = device("photon list 0", 4 * u64::from(count))?;
        let odd = device("photon list 1", 4 * u64::from(count))?;
        let new_list = |name: &str, number: usize| -> Result<List> {
            let pixels = if number.is_multiple_of(2) { even.clone() } else { odd.clone() };
            Ok(List { pixels, work: device(name, size_of::<Work>() as u64)? })
        };
        let lists = (0..numbers.follow.len())
            .map(|i| new_list(&format!("photon work {i}"), i))
            .collect::<Result<Vec<List>>>()?;
        let batch = new_list("photon batch work", 1)?;
        let found = List {
            pixels: device("receivers with photons", list.pixels.bytes())?,
            work: device("photon_light work", size_of::<Work>() as u64)?,
        };
        let trace = |list: &List| Trace::new(kernels, parameters, scene, &rays, list, steps, status);
        let follow = lists
            .iter()
            .enumerate()
            .map(|(i, list_out)| {
                let inputs = photon_follow::Inputs {
                    frame: parameters,
                    scene,
                    target_of: &targets.of_triangle,
                    mirror_of: scene.mirrors.as_ref().map_or(&targets.of_triangle, |m| &m.of_triangle),
                    rays: &rays,
                    flux: &flux,
                    media: &media,
                    position: &position,
                    normal: &normal,
                    list_in: i.checked_sub(1).map_or(&batch, |before| &lists[before]),
                    list_out,
                    steps,
                };
                let schedule = Schedule::new(kernels, &list_out.work, steps, status)?;
                Ok((PhotonFollow::new(kernels, &inputs)?, schedule, trace(list_out)?))
            })
            .collect::<Result<_>>()?;
        let grid_work = Work { total: count, total_groups: groups_of(count), ..Work::default() };
        Ok(Photons {
            count,
            start: PhotonStart::new(
                kernels,
                parameters,
                &scene.emitters,
                &targets.spheres,
                &rays,
                [&flux, &position],
                count,
            )?,
            first_trace: trace(&batch)?,
            steps: follow,
            sort: PhotonGrid::new(
                context,
                kernels,
                parameters,
                &rays,
                [&flux, &position, &normal],
                &grid,
                steps,
                count,
            )?,
            find: PhotonFind::new(kernels, parameters, receivers, list, &grid, &found, steps, status)?,
            light: PhotonLight::new(kernels, parameters, receivers, &found, &grid, sums, steps)?,
            found,
            clear_work: staging.stage(context, "cleared photon work", &[Work::default()])?,
            grid_work: staging.stage(context, "photon grid's first work", &[grid_work])?,
            rays,
            flux,
            media,
            position,
            normal,
            lists,
            grid,
            batch,
            numbers,
        })
    }

    /// Records the clearing of the counters.
    pub(super) fn record_clear(&self, rec: &mut Recorder) -> Result<()> {
        for list in self.lists.iter().chain([&self.batch, &self.found]) {
            rec.copy(&self.clear_work, &list.work)?;
        }
        rec.copy(&self.grid_work, &self.grid.list.work)
    }

    /// Photons leave the lights and are traced to their first hits.
    pub fn record_start(&self, rec: &mut Recorder) -> Result<()> {
        self.start.record(rec)?;
        self.first_trace.record(rec, &self.numbers.first_trace, Some(self.count))
    }

    /// Photons go on at mirrors and glass, or are stored; steps from 0. After the last nothing is traced.
    pub fn record_step(&self, rec: &mut Recorder, step: usize) -> Result<()> {
        let (follow, schedule, trace) = &self.steps[step];
        follow.record(rec, self.numbers.follow[step], (step == 0).then_some(self.count))?;
        if step + 1 == self.steps.len() {
            return Ok(());
        }
        schedule.record(rec, self.numbers.list)?;
        trace.record(rec, &self.numbers.list_trace, None)
    }

    /// The stored photons are sorted into the grid.
    pub fn record_grid(&self, rec: &mut Recorder) -> Result<()> {
        self.sort.record(rec, &self.numbers.sort)
    }

    /// All of it, up to the grid.
    pub(super) fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_start(rec)?;
        (0..self.steps.len()).try_for_each(|step| self.record_step(rec, step))?;
        self.record_grid(rec)
    }

    /// The photons' light is added to the sums of what the eye sees.
    pub fn record_light(&self, rec: &mut Recorder) -> Result<()> {
        self.find.record(rec, self.numbers.list)?;
        self.light.record(rec, &self.numbers.light)
    }
}
