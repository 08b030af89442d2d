//! One short ray from each receiver: the compensation of Kollig and Keller 2004 (*Illumination in the Presence of Weak
//! Singularities*).
//!
//! Clipping the distance to virtual lights takes from the integral over surfaces the share 1 - d^2 / clip^2 where d < clip.
//! That share is estimated by a path: a direction by the reflectance (diffuse lobe by the cosine law, specular lobe by
//! visible normals), traced no farther than clip. What it hits becomes a receiver of the next bounce with that weight,
//! lit by the same clipped lights and gathered from in turn until the path is as long as allowed.
//!
//! The directions of a pixel over the passes follow one low-discrepancy sequence, randomised anew for every pixel. Of Sobol' points the
//! same two dimensions serve all bounces, in another order for each (padded replications, Wald et al. 2002, 4.4; see
//! [`crate::plan`]).
//!
//! Differs from the paper in that: there the geometry term is bounded as a whole, cosines included; here only 1/d^2 is,
//! so that a ray of length clip is all that is ever needed.
//!
//! Cost: some 150 operations and 200 bytes a receiver, and one ray of `trace`.

use glam::Vec3;

use super::schedule::LIST_GROUPS;
use super::shade::Receiver;
use super::{Kernels, List, Rays, Receivers, layout, push};
use crate::accel::Ray;
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Kernel, Recorder};
use crate::sampling::dimensions::{GATHER, GATHER_LOBE};
use crate::sampling::halton::radical_inverse;
use crate::sampling::random::{hash, key, random_f32};
use crate::sampling::rotate;
use crate::sampling::sobol::unit;

/// The pass from one set of receivers.
pub struct Gather {
    kernel: Kernel,
    bindings: Bindings,
    work: Buffer,
}

impl Gather {
    /// Writes `rays` and multiplies `beta` for the receivers in `list`.
    pub fn new(
        kernels: &Kernels,
        frame: &Buffer,
        receivers: &Receivers,
        list: &List,
        rays: &Rays,
        beta: &Buffer,
        steps: &Buffer,
    ) -> Result<Self> {
        let kernel = kernels.gather.clone();
        let bindings = kernel.bind(&[
            ("frame", frame.into()),
            ("work", (&list.work).into()),
            ("list", (&list.pixels).into()),
            ("steps", steps.into()),
            ("receiver_position", (&receivers.position).into()),
            ("receiver_geometric", (&receivers.geometric).into()),
            ("receiver_shading", (&receivers.shading).into()),
            ("receiver_kd", (&receivers.kd).into()),
            ("receiver_f0", (&receivers.f0).into()),
            ("receiver_wo", (&receivers.wo).into()),
            ("beta", beta.into()),
            ("ray_origin", (&rays.origin).into()),
            ("ray_direction", (&rays.direction).into()),
        ])?;
        Ok(Gather { kernel, bindings, work: list.work.clone() })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder, step: u32) -> Result<()> {
        rec.dispatch_indirect(&self.kernel, &self.bindings, &push(step), &self.work, LIST_GROUPS)
    }
}

/// Oracle: the ray, the throughput after it, and whether it left through the specular lobe.
pub fn reference(frame: &layout::Frame, pixel: u32, bounce: u32, receiver: &Receiver, beta: Vec3) -> (Ray, Vec3, bool) {
    let [u, v] = [0, 1].map(|d| {
        let k = key(frame.keys[1], GATHER, pixel, 2 * bounce + d as u32);
        if frame.has(layout::Frame::SOBOL) {
            return unit(frame.sobol[bounce as usize][2 + d] ^ hash(k));
        }
        let base = frame.shifts[bounce as usize][2 + d].to_bits();
        rotate(radical_inverse(base, frame.size[3]), random_f32(k))
    });
    let r = &receiver.reflectance;
    let p = r.diffuse_probability();
    let diffuse = random_f32(key(frame.keys[0], GATHER_LOBE, pixel, bounce)) < p;
    let (wi, weight) = r.sample_lobe(diffuse, receiver.shading, receiver.wo, u, v);
    let above = wi.dot(receiver.geometric) > 0.0 && wi.dot(receiver.shading) > 0.0;
    let weight = match (above, bounce == 0 && diffuse) {
        (false, _) => Vec3::ZERO,
        // Irradiance of the eye's diffuse lobe: the albedo comes in when the image is put together.
        (true, true) => Vec3::splat(std::f32::consts::PI / p),
        (true, false) => weight,
    };
    let ray = Ray { origin: receiver.position, t_max: if above { frame.up[3] } else { 0.0 }, direction: wi };
    (ray, beta * weight, !diffuse)
}
