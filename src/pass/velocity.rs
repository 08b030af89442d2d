//! Velocities in the image: how far the point that each pixel shows moves while the shutter is open.
//!
//! Let P be the point that the pixel shows now, at depth z along the view direction, and P_0, P_1 its places as the shutter opens and as it
//! closes, told by the displacements of the corners of its triangle. With the projections p_0, p_1 of the cameras at these times
//!
//! ```text
//! v = p_1(P_1) - p_0(P_0)                                   pixels; x to the right, y down
//! p_e(P_e) = projection of (d + (eye - eye_e + P_e - P) / z)
//! ```
//!
//! where d z is the vector from the eye to P. So a point at infinity moves as the camera turns, and where nothing moves v is exactly 0.
//! A longer velocity than [`MAX_LENGTH`] is cut.
//! Points nearer to the eye at one end than a twentieth of their depth now, or behind it, count as being there.
//!
//! Differs from the thesis (Bastos 1999, 8.2.3.1) in: there the support is proportional to the distance from the viewer; by the projection it
//! is f |v_perp| dt / z, the reverse.
//!
//! A point seen in mirrors or glass moves as one that stands still at the place of its image: right for planar mirrors that do not move.
//! Of glossy planes, the velocity is that of the plane.
//!
//! Cost: 3 vec4 and 70 operations a pixel, 6 vec4 more where triangles move; 16 bytes of memory a pixel, and 100 bytes for each triangle of a
//! scene whose objects may move.

use glam::{DVec2, Vec3};

use super::layout::Shutter;
use super::{BoundKernel, EyePathState, Kit, Rays, ShadingPoints, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Resources, Staging, shaders};
use crate::scene::Camera;

/// Maximum length of a velocity, pixels.
pub const MAX_LENGTH: f32 = 1023.0;

/// Least depth at the ends of the motion, as a share of the depth now.
const NEAREST: f64 = 0.05;

/// The pass.
pub struct Velocity {
    /// Velocity of each pixel, to the right and down, pixels; z: depth, w: 0.
    pub velocity: Buffer,
    shutter: Buffer,
    motion_of: Buffer,
    motion: Buffer,
    kernel: BoundKernel,
    pixels: u32,
}

/// Motion while the shutter is open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moving {
    /// For each triangle of the tree 1 + its number among those that move, or 0; empty: none moves.
    pub of_triangle: Vec<u32>,
    /// Of each of these the displacements of its corners, as the shutter opens and as it closes.
    pub displacements: Vec<[[Vec3; 3]; 2]>,
}

impl Moving {
    /// Displacements of the corners of a triangle of the tree, as the shutter opens and as it closes; `None`: it stands still.
    pub fn of(&self, leaf: u32) -> Option<&[[Vec3; 3]; 2]> {
        let number = self.of_triangle.get(leaf as usize).copied().unwrap_or(0);
        self.displacements.get(number.checked_sub(1)? as usize)
    }
}

impl Velocity {
    /// Prepares the pass; `triangles`: those that may move, of all of the scene or none.
    pub fn new(
        kit: &Kit,
        (rays, paths, points): (&Rays, &EyePathState, &ShadingPoints),
        pixels: u32,
        triangles: u32,
    ) -> Result<Velocity> {
        let velocity = kit.vec4s("velocities", pixels)?;
        let shutter = kit.array("shutter", 1, size_of::<Shutter>() as u64)?;
        let motion_of = kit.array("triangles that move", triangles.max(1), 4)?;
        let motion = kit.array("displacements", triangles.max(1), 96)?;
        let own = Resources::of([
            ("velocity", &velocity),
            ("shutter", &shutter),
            ("motion_of", &motion_of),
            ("motion", &motion),
        ]);
        let sets = [&own, &rays.resources(), &paths.resources(), &points.resources()];
        let kernel = kit.bind(&shaders::VELOCITY, &sets)?;
        Ok(Velocity { velocity, shutter, motion_of, motion, kernel, pixels })
    }

    /// Stages what moves.
    pub fn stage(
        &self,
        context: &Context,
        staging: &mut Staging,
        (now, ends): (&Camera, [&Camera; 2]),
        moving: &Moving,
    ) -> Result<()> {
        let count = moving.displacements.len() as u32;
        staging.stage_into(context, &self.shutter, 0, &[shutter(now, ends, count)])?;
        if count > 0 {
            let vec4s = |corners: &[Vec3; 3]| corners.map(|d| [d.x, d.y, d.z, 0.0]);
            let all: Vec<[[f32; 4]; 3]> = moving.displacements.iter().flatten().map(vec4s).collect();
            staging.stage_into(context, &self.motion, 0, &all)?;
            staging.stage_into(context, &self.motion_of, 0, &moving.of_triangle)?;
        }
        Ok(())
    }

    /// Records the pass, after the hits of the eye's rays and before later rays overwrite them.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], groups(self.pixels))
    }
}

/// Parameters of the cameras now and at the ends.
pub fn shutter(now: &Camera, ends: [&Camera; 2], moving: u32) -> Shutter {
    let xyz = |v: Vec3| [v.x, v.y, v.z, 0.0];
    // Displacement of the image's centre in the last components.
    let axis = |v: Vec3, shift: f32| [v.x, v.y, v.z, shift];
    Shutter {
        shift: ends.map(|end| xyz(now.eye - end.eye)),
        right: [0, 1].map(|e| axis(ends[e].world_from_camera().0 / ends[e].half_extents()[0], ends[e].shift()[0])),
        up: [0, 1].map(|e| axis(ends[e].world_from_camera().1 / ends[e].half_extents()[1], ends[e].shift()[1])),
        forward: ends.map(|end| xyz(end.world_from_camera().2)),
        moving: [moving, 0, 0, 0],
    }
}

/// Oracle: projects a point by the cameras at the ends. `places`: where it is then, or the direction to a point at infinity, of depth 1 now (orthographic: the origin of the ray to it, less the eye); `depth`: of the
/// point now, `None` for one at infinity.
pub fn reference(ends: [&Camera; 2], places: [Vec3; 2], depth: Option<f32>) -> DVec2 {
    let project = |e: usize| {
        let camera = ends[e];
        let (right, up, forward) = camera.world_from_camera();
        let from = if depth.is_some() { camera.eye } else { Vec3::ZERO };
        let seen = places[e].as_dvec3() - from.as_dvec3();
        let [width, height] = camera.resolution.map(f64::from);
        let depth_then = match camera.is_orthographic() {
            true => 1.0,
            false => seen.dot(forward.as_dvec3()).max(NEAREST * f64::from(depth.unwrap_or(1.0))),
        };
        let ([half_width, half_height], [across, upwards]) =
            (camera.half_extents().map(f64::from), camera.shift().map(f64::from));
        let s = seen.dot(right.as_dvec3()) / depth_then / half_width - across;
        let t = seen.dot(up.as_dvec3()) / depth_then / half_height - upwards;
        DVec2::new(0.5 * width * (1.0 + s), 0.5 * height * (1.0 - t))
    };
    let v = project(1) - project(0);
    v.clamp_length_max(f64::from(MAX_LENGTH))
}
