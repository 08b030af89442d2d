//! Unpacks points of tasks that came packed (Wald et al. 2002, 4.2) into the arrays that the stages after shading read. Oracle:
//! [`TaskPoints::unpack`](crate::cluster::points::TaskPoints::unpack).
//!
//! A task's points lie in columns, one word for each point. Place and depth of a plain point, which a diffuse surface shows, follow from
//! the ray of its pixel; a second dispatch goes through the list of points with more to tell. Directions of rays differ from the oracle's by rounding, some 2e-7.
//!
//! Cost: 20 bytes read and 176 written a point, 8 and 8 for each hit of a pixel, some 60 operations; 44 bytes more of points with more to tell, and 24
//! of those off their ray.

use glam::{Vec3, Vec4};

use super::layout::{FrameParameters, UnpackPush};
use super::{BoundKernel, EyePathState, Lighting, ShadingPoints, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Resources, Shader, shaders};

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Words of the columns.
    pub packed: &'a Buffer,
    /// Output, as the rest.
    pub points: &'a ShadingPoints,
    /// Of these the throughput.
    pub paths: &'a EyePathState,
    /// Light of the points.
    pub lighting: &'a Lighting,
    /// Hits of pixels by eye rays and beyond flat mirrors, if there are such.
    pub hits: [Option<&'a Buffer>; 2],
}

/// The points of a task among the words.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Their first word.
    pub first: u32,
    /// Points, pixels, points with more to tell, those off their ray.
    pub counts: [u32; 4],
    /// Exponents of direct, indirect irradiance, emission, specular radiance.
    pub exponents: [i32; 4],
    /// That of throughputs.
    pub throughput: i32,
    /// A step of coordinates, scene units.
    pub step: f32,
    /// Hits of a pixel.
    pub hits: u32,
}

/// The pass.
pub struct UnpackPoints {
    plain: BoundKernel,
    rich: BoundKernel,
}

impl UnpackPoints {
    /// Writes points of `inputs.packed`.
    pub fn new(context: &Context, inputs: &Inputs) -> Result<UnpackPoints> {
        let none = Buffer::new(context, "no hits", 8, Memory::Device)?;
        let hits = inputs.hits.map(|hits| hits.unwrap_or(&none));
        let own = Resources::of([("packed", inputs.packed), ("first_hits", hits[0]), ("second_hits", hits[1])]);
        let sets = [&own, &inputs.points.resources(), &inputs.paths.resources(), &inputs.lighting.resources()];
        let bind = |shader: &'static Shader| -> Result<BoundKernel> {
            Ok(BoundKernel(Kernel::new(context, shader)?.bind_from(&sets, &Resources::new())?))
        };
        Ok(UnpackPoints { plain: bind(&shaders::UNPACK_POINTS)?, rich: bind(&shaders::UNPACK_POINTS_RICH)? })
    }

    /// Records the points of a part, from the camera of `parameters`.
    pub fn record(&self, rec: &mut Recorder, part: &Part, parameters: &FrameParameters) -> Result<()> {
        let push = push(part, parameters);
        let push = bytemuck::bytes_of(&push);
        self.plain.run(rec, push, groups(part.counts[0]))?;
        if part.counts[2] > 0 {
            self.rich.run(rec, push, groups(part.counts[2]))?;
        }
        Ok(())
    }
}

/// The rays of [`camera_rays::row`](super::camera_rays::row) are linear in column and row.
fn push(part: &Part, parameters: &FrameParameters) -> UnpackPush {
    let [eye, right, up, forward] =
        [parameters.eye, parameters.right, parameters.up, parameters.forward].map(|row| Vec4::from(row).truncate());
    let [x, y, width, height] = parameters.within.map(f64::from);
    let [offset, shift] = [parameters.pixel_offset, parameters.shift].map(|row| row.map(f64::from));
    let s = 2.0 * (x + offset[0]) / width - 1.0 + shift[0];
    let t = 1.0 - 2.0 * (y + offset[1]) / height + shift[1];
    let parallel = parameters.is_orthographic();
    let begin = if parallel { Vec3::ZERO } else { forward };
    let corner = (begin.as_dvec3() + s * right.as_dvec3() + t * up.as_dvec3()).as_vec3();
    let [across, down] = [(2.0 / width) * right.as_dvec3(), (-2.0 / height) * up.as_dvec3()].map(|step| step.as_vec3());
    let [wide, pixels] = [parameters.size[0], parameters.size[0] * parameters.size[1]];
    UnpackPush {
        corner: corner.extend(part.step).to_array(),
        across: across.extend(part.throughput as f32).to_array(),
        down: down.extend(0.0).to_array(),
        eye: eye.extend(parameters.eye[3]).to_array(),
        forward: forward.extend(if parallel { 1.0 } else { 0.0 }).to_array(),
        counts: part.counts,
        image: [part.first, wide, pixels, part.hits],
        exponents: part.exponents,
    }
}
