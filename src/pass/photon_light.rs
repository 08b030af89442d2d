//! Photons light the visible shading points around them: the second sum of Wald et al. 2002, section 4, over photons of
//! flux Phi_j that arrived at z_j from omega_j,
//!
//! ```text
//! L(x, omega) += sum_j B_r(z_j, x) / (pi r^2) f_r(omega_j, x, omega) Phi_j / N      B_r(z, x) = 2 max(1 - |z - x|^2 / r^2, 0)
//! ```
//!
//! The paper counts photons within r alike; this kernel (Epanechnikov's) has no edge, so that single photons show no discs.
//!
//! Each photon has its own r, at most that of the look-up ([`photon_width`](super::photon_width)), and photons are found by 8 look-ups in the grid of cells of
//! size 2r (4.1). The diffuse part is added to the indirect irradiance, the lobe's to the specular radiance. A photon counts if it arrived on the
//! point's side, at a surface within 60 degrees of the point's, so that light does not pass thin walls or turn around
//! corners; and with [`interleave_photons`](crate::settings::Settings::interleave_photons) if its class is that of the pixel (4.2), else
//! those of all classes count, and N is the number of all. Both components of a split eye path are lit.
//!
//! No light is counted twice: virtual lights leave out ideal reflection and transmission (`walk_reflect`), and shadow
//! rays and gather rays (`gathered_points`) end at mirrors and glass. The hits of gather rays are not lit by photons: that
//! would add only the near part of light that continues from caustics, whose far part virtual lights leave out.
//!
//! Bias: caustics are blurred by r, and fade within r of an edge. In a concave corner only photons of the point's own
//! side count.
//!
//! Cost for each point that `photon_find` has listed: 8 look-ups of 8 bytes, and 20 bytes and 40 operations for each
//! photon in the buckets, 44 bytes and 40 operations more where its footprint reaches the point. A bucket may hold many photons, so a dispatch takes a range of all photons, as many as its
//! loop may ([`crate::plan::PhotonPlan::chunk`]).

use glam::Vec3;

use super::caustics::SHARP;
use super::photon_grid::{Grid, grid_class};
use super::schedule::LIST_GROUPS;
use super::shade::ShadingPoint;
use super::sort::class_of;
use super::{BoundKernel, Kit, Lighting, List, ShadingPoints, layout, push};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};
use crate::scene::Material;

/// Minimum cosine between the normals of photon and shading point.
pub const MIN_COSINE: f32 = 0.5;

/// The pass.
pub struct PhotonLight {
    kernel: BoundKernel,
    work: Buffer,
}

impl PhotonLight {
    /// Adds to `lighting` of the points on the list, and to `caustic`, as far as it goes, the irradiance by photons of footprints that are
    /// [`SHARP`].
    pub fn new(
        kit: &Kit,
        points: &ShadingPoints,
        list: &List,
        grid: &Grid,
        (lighting, caustic): (&Lighting, &Buffer),
        steps: &Resources,
    ) -> Result<Self> {
        let own = Resources::of([("caustic", caustic), ("stored", &grid.list.work)]);
        let sets = [&points.resources(), &list.resources(), &grid.resources(), &lighting.resources(), &own, steps];
        Ok(PhotonLight { kernel: kit.bind(&shaders::PHOTON_LIGHT, &sets)?, work: list.work.clone() })
    }

    /// Records the look-ups, one dispatch for each range of photons.
    pub fn record(&self, rec: &mut Recorder, steps: &[u32]) -> Result<()> {
        steps.iter().try_for_each(|&step| self.kernel.run_listed(rec, &push(step), &self.work, LIST_GROUPS))
    }
}

/// A stored photon.
#[derive(Clone, Copy, Debug)]
pub struct Photon {
    /// Its position.
    pub position: Vec3,
    /// Geometric normal there, on the side of arrival.
    pub normal: Vec3,
    /// Direction back along its last ray.
    pub wi: Vec3,
    /// Flux if the class had this photon only.
    pub flux: Vec3,
    /// r^2 over the squared radius of its footprint ([`narrowing`](super::photon_width::narrowing)).
    pub narrowing: f32,
    /// Its class in the grid.
    pub class: u32,
    /// It comes from an emitter without area.
    pub without_area: bool,
}

/// Oracle: irradiance and specular radiance that photons add at the shading point of a slot, and the irradiance by those of sharp footprints.
pub fn reference(
    frame: &layout::FrameParameters,
    materials: &[Material],
    slot: u32,
    receiver: &ShadingPoint,
    photons: &[Photon],
) -> [Vec3; 3] {
    let [radius, _, share, _] = frame.photon;
    let class = grid_class(frame, class_of(frame, slot));
    let mut sums = [Vec3::ZERO; 3];
    for photon in photons {
        let (cos_geometric, cos_shading) = (photon.wi.dot(receiver.geometric), photon.wi.dot(receiver.shading));
        let width2 = radius * radius / photon.narrowing;
        let part = photon.position.distance_squared(receiver.position) / width2;
        let kernel = 2.0 * (1.0 - part) * photon.narrowing;
        let near = photon.class == class && kernel > 0.0;
        let faces = photon.normal.dot(receiver.geometric) > MIN_COSINE && cos_geometric > 0.0 && cos_shading > 0.0;
        if near && faces {
            let arriving = photon.flux * ((cos_shading / cos_geometric.max(1e-7)).min(4.0) * share * kernel);
            sums[0] += arriving;
            if photon.narrowing >= SHARP {
                sums[2] += arriving;
            }
            // A path along the lobe brings this light, unless no path can meet its emitter.
            if receiver.sampled.is_none() || photon.without_area {
                sums[1] +=
                    arriving * receiver.reflectance.eval_specular(materials, receiver.shading, photon.wi, receiver.wo);
            }
        }
    }
    sums
}
