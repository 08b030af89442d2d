//! The points of an atlas ([`crate::view::Atlas`]): each texel lies on a triangle and is seen from one of its sides along its
//! normal, as if a ray of length 1 had hit it. `eye_points` makes a shading point of it like of any hit.
//!
//! Replaces `camera_rays` and the `trace` of its rays. A texel without a triangle counts as a ray that hit nothing.
//!
//! Cost: 48 bytes read, 64 bytes written and 20 operations a texel.

use glam::Vec3;

use super::{BoundKernel, EyePathState, Kit, Rays, ShadingPoints, groups};
use crate::accel::Bvh;
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Recorder, Resources, Staging, shaders};
use crate::view::{self, Texel};

/// Triangle number of a texel that lies on no triangle.
const NONE: u32 = u32::MAX;

/// The pass.
pub struct Atlas {
    kernel: BoundKernel,
    /// Of each texel: number of the triangle in the order of the leaves (all ones: none), bits of u and v, 1 if seen from the back.
    pub records: Buffer,
    /// [`Bvh::leaf_numbers`]: the device numbers triangles in the order of the leaves.
    leaves: Vec<u32>,
    texels: u32,
}

impl Atlas {
    /// Writes `rays.hits` and `rays.direction`, and initialises `paths` and the emission of `points`.
    ///
    /// Errors: a texel names a triangle that is not in the scene, or lies outside its triangle.
    pub fn new(
        kit: &Kit,
        bvh: &Bvh,
        atlas: &view::Atlas,
        rays: &Rays,
        paths: &EyePathState,
        points: &ShadingPoints,
    ) -> Result<Self> {
        let leaves = bvh.leaf_numbers();
        let records = kit.stage("atlas", &records(&leaves, &atlas.texels)?)?;
        let texels = Resources::of([("texels", &records)]);
        let sets = [&texels, &rays.resources(), &paths.resources(), &points.resources()];
        Ok(Atlas { kernel: kit.bind(&shaders::ATLAS, &sets)?, records, leaves, texels: atlas.texels.len() as u32 })
    }

    /// Stages other texels, as many as before. Errors: those of [`Atlas::new`].
    pub fn stage(&self, ctx: &Context, staging: &mut Staging, texels: &[Option<Texel>]) -> Result<()> {
        staging.stage_into(ctx, &self.records, 0, &records(&self.leaves, texels)?)
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.texels))
    }
}

/// The kernel's record of each texel.
fn records(leaves: &[u32], texels: &[Option<Texel>]) -> Result<Vec<[u32; 4]>> {
    let record = |(i, texel): (usize, &Option<Texel>)| {
        let Some(Texel { triangle, uv: [u, v], back }) = *texel else { return Ok([NONE, 0, 0, 0]) };
        let Some(&leaf) = leaves.get(triangle as usize) else {
            return Err(Error::Scene(format!(
                "texel {i} of the atlas lies on triangle {triangle}, which does not exist"
            )));
        };
        if !(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6) {
            return Err(Error::Scene(format!("texel {i} of the atlas lies at ({u}, {v}), outside of its triangle")));
        }
        Ok([leaf, u.to_bits(), v.to_bits(), u32::from(back)])
    };
    texels.iter().enumerate().map(record).collect()
}

/// Oracle: the point of a texel and its viewing direction.
pub fn reference(scene: &crate::Scene, texel: &Texel) -> (Vec3, Vec3) {
    let [a, b, c] = scene.triangles[texel.triangle as usize].vertices.map(|v| scene.positions[v as usize]);
    let front = crate::accel::unit_normal(b - a, c - a);
    let normal = if texel.back { -front } else { front };
    (a + texel.uv[0] * (b - a) + texel.uv[1] * (c - a), -normal)
}
