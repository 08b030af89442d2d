//! Splats: particles are traced once and stored on glossy surfaces; each pass looks them up at the points that it shows.

use super::{Counts, Eye, Shade, Stage, batch};
use crate::device_scene::{DeviceScene, SurfaceBuffers};
use crate::error::Result;
use crate::gpu::{Buffer, Memory, Recorder, Resources};
use crate::pass::layout::{DispatchCounts, FrameParameters, Step};
use crate::pass::schedule::{Schedule, groups_of};
use crate::pass::sort::SortSteps;
use crate::pass::splat_find::{self, SplatFind};
use crate::pass::splat_follow::{self, SplatFollow};
use crate::pass::splat_grid::{Grid, SplatGrid};
use crate::pass::splat_light::{self, SplatLight};
use crate::pass::splat_pack::{self, SplatPack};
use crate::pass::splat_start::{SplatStart, SplatState};
use crate::pass::splat_width::SplatWidth;
use crate::pass::trace::Trace;
use crate::pass::{Kit, List, Rays};
use crate::plan::{Plan, SplatPlan, StepTable};

/// The stage. Recorded as a whole it adds light; [`Splats::record_particles`] comes before the first pass.
pub struct Splats {
    /// Number and kernels of its particles.
    pub plan: SplatPlan,
    /// Rays of a batch of particles.
    pub rays: Rays,
    /// Flux of each.
    pub flux: Buffer,
    /// Glass media around each.
    pub media: Buffer,
    /// For each number of bounces, the particles of the batch that continue.
    pub lists: Vec<List>,
    /// The hits of the batch.
    pub fresh: Buffer,
    /// A [`SplatState`].
    pub state: Buffer,
    /// The hits stored.
    pub hits: Buffer,
    /// Number of hits on each surface.
    pub surface_hits: Buffer,
    /// h of each surface.
    pub width: Buffer,
    /// The hits in their grid.
    pub grid: Grid,
    /// The shading points that splats show: slot and surface.
    pub found: List,
    tracing: Tracing,
    pack: SplatPack,
    widths: SplatWidth,
    sort: (SplatGrid, SortSteps, Buffer),
    find: SplatFind,
    light: SplatLight,
    round_steps: Vec<u32>,
}

/// The tracing of a batch.
struct Tracing {
    /// Parameters of the first pass: particles do not depend on the pass that is next when they are traced.
    parameters: Buffer,
    /// Rays lost; they fail each pass that looks up the others.
    status: Buffer,
    counts: Counts,
    start: SplatStart,
    /// Step of each batch.
    batches: Vec<u32>,
    first: (Trace, Vec<u32>),
    follow: Vec<Follow>,
    list_step: u32,
    list_rounds: Vec<u32>,
}

/// A step along the particles' paths.
struct Follow {
    pass: SplatFollow,
    step: u32,
    schedule: Schedule,
    trace: Trace,
}

impl Splats {
    /// `None`: the plan has no splats.
    pub fn new(kit: &Kit, scene: &DeviceScene, plan: &Plan, (eye, shade): (&Eye, &Shade)) -> Result<Option<Splats>> {
        let (Some(splats), Some(surfaces)) = (plan.splats, &scene.surfaces) else {
            return Ok(None);
        };
        let (capacity, particles) = (splats.settings.particles, splats.batch);
        let mut table = StepTable::default();
        let bounds = Step { end: particles, steps: plan.trace_steps(), ..Step::default() };
        let first_rounds = table.add_rounds(plan.trace_rounds(), bounds);
        let batches = splats.batches().map(|(first, end)| table.add(Step { first, end, ..Step::default() })).collect();
        let follow_steps: Vec<u32> = (0..=splats.bounces)
            .map(|bounce| table.add(Step { bounce, last: u32::from(bounce == splats.bounces), ..Step::default() }))
            .collect();
        let list_step = table.add_list();
        let list_rounds = table.add_list_rounds(plan);
        let sort_steps = SortSteps::new(&mut table, 1);
        let parameters = splats.parameters();
        let round_steps: Vec<u32> = (0..parameters.rounds)
            .map(|round| table.add(Step { first: round * splats.chunk, ..Step::default() }))
            .collect();
        let steps = table.stage(kit, "splat steps")?;
        let own = Resources::of([("splat_parameters", &kit.stage("splat parameters", &[parameters])?)]);
        let of_frame =
            Buffer::new(kit.context, "parameters of particles", size_of::<FrameParameters>() as u64, Memory::Device)?;
        let status = kit.array("status of particles", 4, 4)?;
        let traced = steps.clone().with("frame", &of_frame).with("status", &status);
        let of_traced = traced.clone().and(&own);

        let rays = Rays::new(kit.context, "splat particle", particles)?;
        let flux = kit.vec4s("splat flux", particles)?;
        let media = kit.vec4s("splat media", particles)?;
        let fresh = kit.array("splats of a batch", splats.slots(), 32)?;
        let state = kit.array("splat state", 1, size_of::<SplatState>() as u64)?;
        let hits = kit.array("splats", capacity, 32)?;
        let surface_hits = kit.array("hits of surfaces", surfaces.count, 4)?;
        let width = kit.array("widths of splats", surfaces.count, 4)?;
        let grid = Grid::new(kit, capacity, 1 << splats.bucket_bits())?;
        // A list is filled while the previous one is still needed, so two buffers alternate.
        let turns = [kit.array("splat list 0", particles, 4)?, kit.array("splat list 1", particles, 4)?];
        let list = |i: usize| List::new(kit, &format!("splat particles {i}"), &turns[i % 2]);
        let lists = (0..follow_steps.len()).map(list).collect::<Result<Vec<List>>>()?;
        let batch = batch(kit, "splat particles")?;
        let SurfaceBuffers { records, edges, of_triangle, .. } = surfaces;
        let follow = (lists.iter().zip(follow_steps).enumerate())
            .map(|(i, (list_out, step))| {
                let inputs = splat_follow::Inputs {
                    rays: &rays,
                    flux: &flux,
                    media: &media,
                    fresh: &fresh,
                    surface_of: of_triangle,
                    state: &state,
                    list_in: i.checked_sub(1).map_or(&batch, |before| &lists[before]),
                    list_out,
                };
                Ok(Follow {
                    pass: SplatFollow::new(kit, &inputs, &of_traced)?,
                    step,
                    schedule: Schedule::new(kit, &list_out.work, &traced)?,
                    trace: Trace::new(kit, &rays, list_out, &traced)?,
                })
            })
            .collect::<Result<_>>()?;
        let tracing = Tracing {
            counts: Counts::new(kit, 1, lists.iter().chain([&batch]))?,
            start: SplatStart::new(kit, &scene.emitter_records, &rays, (&flux, particles), (&state, &of_traced))?,
            batches,
            first: (Trace::new(kit, &rays, &batch, &traced)?, first_rounds),
            follow,
            list_step,
            list_rounds,
            parameters: of_frame,
            status,
        };
        let mebibytes = splats.bytes().div_ceil(1 << 20);
        log::info!("splats: {capacity} particles, in {mebibytes} MiB, on {} surfaces", surfaces.count);
        let work = DispatchCounts { total: capacity, total_groups: groups_of(capacity), ..DispatchCounts::default() };
        let grid_work = kit.stage("splat grid's first work", &[work])?;
        let packed = splat_pack::Inputs { fresh: &fresh, state: &state, hits: &hits, surface_hits: &surface_hits };
        let slots = eye.list.entries.bytes() / 4;
        let found = List::new(kit, "points with splats", &kit.array("points with splats", slots as u32, 8)?)?;
        let round_groups = kit.array("rounds of splats", parameters.rounds, 16)?;
        let find = splat_find::Inputs {
            points: &eye.points,
            list: &eye.list,
            rays: &eye.rays,
            surface_of: of_triangle,
            width: &width,
            grid: &grid,
            particle_status: &tracing.status,
            found: &found,
            round_groups: &round_groups,
        };
        let light = splat_light::Inputs {
            points: &eye.points,
            found: &found,
            grid: &grid,
            state: &state,
            surfaces: [records, edges, &width],
            round_groups: &round_groups,
            lighting: &shade.lighting,
        };
        Ok(Some(Splats {
            pack: SplatPack::new(kit, &packed, splats.slots(), &own)?,
            widths: SplatWidth::new(kit, [records, &surface_hits, &width], &own)?,
            sort: (
                SplatGrid::new(kit, [&state, &hits, &width], &grid, (&steps, &own), capacity)?,
                sort_steps,
                grid_work,
            ),
            find: SplatFind::new(kit, &find, &own)?,
            light: SplatLight::new(kit, &light, (&steps, &own))?,
            round_steps,
            plan: splats,
            tracing,
            rays,
            flux,
            media,
            lists,
            fresh,
            state,
            hits,
            surface_hits,
            width,
            grid,
            found,
        }))
    }

    /// Number of batches.
    pub fn batches(&self) -> usize {
        self.tracing.batches.len()
    }

    /// Records that nothing is stored yet. `parameters`: those of the first pass.
    pub fn record_clear(&self, rec: &mut Recorder, parameters: &FrameParameters) -> Result<()> {
        rec.update(&self.tracing.parameters, 0, bytemuck::bytes_of(parameters))?;
        rec.fill(&self.tracing.status, 0)?;
        rec.fill(&self.state, 0)?;
        rec.fill(&self.surface_hits, 0)
    }

    /// Records the start of a batch, and its first hits.
    pub fn record_start(&self, rec: &mut Recorder, batch: usize) -> Result<()> {
        let tracing = &self.tracing;
        tracing.counts.record_clear(rec)?;
        rec.fill(&self.fresh, 0)?;
        tracing.start.record(rec, tracing.batches[batch])?;
        tracing.first.0.record(rec, &tracing.first.1, Some(self.plan.batch))
    }

    /// Records the step after so many bounces. Nothing is traced after the last.
    pub fn record_step(&self, rec: &mut Recorder, bounces: usize) -> Result<()> {
        let tracing = &self.tracing;
        let follow = &tracing.follow[bounces];
        follow.pass.record(rec, follow.step, (bounces == 0).then_some(self.plan.batch))?;
        if bounces + 1 == tracing.follow.len() {
            return Ok(());
        }
        let from = bounces.checked_sub(1).map(|before| &self.lists[before].work);
        follow.schedule.record_filled_from(rec, tracing.list_step, from)?;
        follow.trace.record(rec, &tracing.list_rounds, None)
    }

    /// Records the storing of a batch beside those that are stored.
    pub fn record_pack(&self, rec: &mut Recorder) -> Result<()> {
        self.pack.record(rec)
    }

    /// Records a whole batch.
    pub fn record_batch(&self, rec: &mut Recorder, batch: usize) -> Result<()> {
        self.record_start(rec, batch)?;
        (0..self.tracing.follow.len()).try_for_each(|bounces| self.record_step(rec, bounces))?;
        self.record_pack(rec)
    }

    /// Records the widths of kernels and the sorting of what is stored into the grid.
    pub fn record_grid(&self, rec: &mut Recorder) -> Result<()> {
        self.widths.record(rec)?;
        rec.copy(&self.sort.2, &self.grid.list.work)?;
        self.sort.0.record(rec, &self.sort.1)
    }

    /// Records all particles anew. `parameters`: those of the first pass.
    pub fn record_particles(&self, rec: &mut Recorder, parameters: &FrameParameters) -> Result<()> {
        rec.scope("particles", |rec| {
            self.record_clear(rec, parameters)?;
            (0..self.batches()).try_for_each(|batch| self.record_batch(rec, batch))?;
            self.record_grid(rec)
        })
    }

    /// Records the search for the points that splats show, while the eye's rays are there.
    pub fn record_find(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope(Self::NAME, |rec| self.find.record(rec))
    }
}

impl Stage for Splats {
    const NAME: &'static str = "splats";

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.light.record(rec, &self.round_steps)
    }
}
