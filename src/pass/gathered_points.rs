//! Hits of gather rays become shading points of the next bounce, with the share 1 - d^2 / clip^2 that the clipped lights leave open (Kollig
//! and Keller 2004), emission included. Mirrors enter with their diffuse base alone, and glass is black.
//!
//! Shading points that can send light back are put on a list. If it is not ordered nothing depends on its order.
//!
//! Cost: 112 bytes read and 128 written for a hit, some 150 operations, and 4 texels for each texture.

use super::layout::PointStep;
use super::schedule::LIST_GROUPS;
use super::{BoundKernel, Kit, List, Rays, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// The pass for one bounce.
pub struct GatheredPoints {
    kernel: BoundKernel,
    work_in: Buffer,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Traced gather rays.
    pub rays: &'a Rays,
    /// Those to take.
    pub list_in: &'a List,
    /// The shading points that are lit.
    pub list_out: &'a List,
    /// Throughput along the gather path; w: the eye's first lobe.
    pub beta: &'a Buffer,
    /// Output.
    pub points: &'a ShadingPoints,
    /// Order of the list, and whether shading points only emit.
    pub step: PointStep,
}

impl GatheredPoints {
    /// Writes `points` and `list_out`, and multiplies `beta`.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<Self> {
        let Inputs { rays, list_in, list_out, beta, points, step } = *inputs;
        let own = Resources::of([("beta", beta), ("point_step", &kit.stage("point step", &[step])?)]);
        let sets = [&rays.resources(), &list_in.as_input(), &list_out.as_output(), &points.resources(), &own];
        let shaders = [&shaders::GATHERED_POINTS, &shaders::GATHERED_POINTS_UNTEXTURED];
        Ok(GatheredPoints { kernel: kit.bind_surface(shaders, &sets)?, work_in: list_in.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run_listed(rec, &[], &self.work_in, LIST_GROUPS)
    }
}
