//! Lists the shading points that splats show: those with a lobe that is left to them, on a surface with hits around the point.
//!
//! With interleaved sampling one class of pixels takes splats in each pass, and counts for the others: in as many passes as there are
//! classes each pixel takes them once. The filter averages the classes within a pass. Kernels are wider than the pattern, so neighbours would
//! add up nearly the same hits.
//!
//! It also finds the most candidates (hits in the cells of a look-up) of any point, and schedules as many dispatches of `splat_light` as
//! these need: each takes a bounded number of candidates. The order of the list varies, but nothing depends on it.
//!
//! Cost for each shading point 20 bytes, and for each listed one 27 look-ups of 8 bytes.

use super::schedule::LIST_GROUPS;
use super::splat_grid::Grid;
use super::{BoundKernel, Kit, List, Rays, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// The pass.
pub struct SplatFind {
    find: BoundKernel,
    rounds: BoundKernel,
    work: Buffer,
    cleared: Buffer,
    found_work: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// The shading points of the eye.
    pub points: &'a ShadingPoints,
    /// Those that are lit.
    pub list: &'a List,
    /// The last rays to them, with their hits.
    pub rays: &'a Rays,
    /// Surface + 1 of each triangle.
    pub surface_of: &'a Buffer,
    /// h of each surface.
    pub width: &'a Buffer,
    /// The hits of particles.
    pub grid: &'a Grid,
    /// Rays of particles that were lost.
    pub particle_status: &'a Buffer,
    /// Slots and surfaces of the points that are found.
    pub found: &'a List,
    /// Indirect dispatches of `splat_light`.
    pub round_groups: &'a Buffer,
}

impl SplatFind {
    /// Fills `found` and `round_groups`.
    pub fn new(kit: &Kit, inputs: &Inputs, own: &Resources) -> Result<Self> {
        let set = Resources::of([
            ("surface_of", inputs.surface_of),
            ("surface_width", inputs.width),
            ("found", &inputs.found.entries),
            ("found_work", &inputs.found.work),
            ("round_groups", inputs.round_groups),
            ("particle_status", inputs.particle_status),
        ]);
        let sets = [
            &inputs.points.resources(),
            &inputs.list.resources(),
            &inputs.rays.resources(),
            &inputs.grid.resources(),
            &set,
            own,
        ];
        Ok(SplatFind {
            find: kit.bind(&shaders::SPLAT_FIND, &sets)?,
            rounds: kit.bind(&shaders::SPLAT_FIND_ROUNDS, &[&set, own])?,
            work: inputs.list.work.clone(),
            cleared: kit.stage("cleared counts of splats", &[super::layout::DispatchCounts::default()])?,
            found_work: inputs.found.work.clone(),
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.copy(&self.cleared, &self.found_work)?;
        self.find.run_listed(rec, &[], &self.work, LIST_GROUPS)?;
        self.rounds.run(rec, &[], 1)
    }
}
