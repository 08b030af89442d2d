//! Where eye paths end, pixels get shading points: position, normals, material with its textures, emission.
//!
//! A point that the eye sees, directly or through mirrors and glass (`eye_paths`), enters with its emission, the term L_e of Keller
//! 1997, eq. 1, times the throughput of that way. Mirrors enter with their diffuse base alone, and glass is black. A glossy plane
//! that mirrors the room (see `mirror_image`) and is seen directly is a shading point without a lobe.
//!
//! Shading points that can send light to the eye are put on a list. If it is not ordered nothing depends on its order.
//!
//! Cost: 128 bytes read and 144 written for a pixel, some 150 operations, and 4 texels for each texture.

use super::layout::PointStep;
use super::{BoundKernel, EyePathState, Kit, List, Rays, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Recorder, Resources, shaders};

/// The pass.
pub struct EyePoints {
    kernel: BoundKernel,
    tiles: u32,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Traced rays.
    pub rays: &'a Rays,
    /// Throughput of the eye's paths; their depths become those of the shading points.
    pub paths: &'a EyePathState,
    /// Output.
    pub points: &'a ShadingPoints,
    /// The shading points that are lit.
    pub list: &'a List,
    /// Order of the list, and whether shading points only emit.
    pub step: PointStep,
}

impl Inputs<'_> {
    /// All, by their names in shaders.
    pub(super) fn resources(&self, kit: &Kit) -> Result<Resources> {
        let step = kit.stage("point step", &[self.step])?;
        let (rays, paths, points) = (self.rays.resources(), self.paths.resources(), self.points.resources());
        Ok(rays.and(&paths).and(&points).and(&self.list.as_output()).and(&Resources::of([("point_step", &step)])))
    }
}

impl EyePoints {
    /// Writes the `points` of all pixels, in so many tiles of 8 x 8.
    pub fn new(kit: &Kit, inputs: &Inputs, tiles: u32) -> Result<Self> {
        let shaders = [&shaders::EYE_POINTS, &shaders::EYE_POINTS_UNTEXTURED];
        Ok(EyePoints { kernel: kit.bind_surface(shaders, &[&inputs.resources(kit)?])?, tiles })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], u64::from(self.tiles))
    }
}
