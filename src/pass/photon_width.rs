//! Widths of the footprints of photons, by the photons around them.
//!
//! A photon i of flux Phi_i, with the photons j around it within the radius r of the look-up, whose normals lie within 60 degrees of its
//! own, lights a disc of radius
//!
//! ```text
//! r_i = r sqrt(min(k Phi_i / sum_j Phi_j, 1))
//! ```
//!
//! with k = [`FOOTPRINT`] over the root of the number of the pass in its instance: where photons are dense some k of them light a point, and caustics stay
//! sharp, the sharper the more passes there are to average; where they are sparse, or one
//! carries much more than those around it, it keeps r, and no spot shows. Each photon gives all its flux whatever its width, so energy
//! is kept. A radius set by hand is that of all photons ([`photon_radius`](crate::settings::Settings::photon_radius)).
//!
//! Differs from Wald et al. 2002, 4.1 in that: there all photons count within one fixed radius.
//!
//! Cost: for each stored photon 8 look-ups of 8 bytes, and 36 bytes and 30 operations for each photon in the buckets, by stretches as in
//! `photon_light`. It grows with the square of the photons in a cell.

use glam::Vec3;

use super::photon_grid::Grid;
use super::photon_light::{MIN_COSINE, Photon};
use super::{BoundKernel, Kit, groups, layout, push};
use crate::error::Result;
use crate::gpu::{Recorder, Resources, shaders};

/// Photons whose flux, if they were alike, would light a point where photons are dense, in the first pass. Higher: less noise from a pass, and more blur.
pub const FOOTPRINT: f32 = 14.0;

/// The pass.
pub struct PhotonWidth {
    kernel: BoundKernel,
    photons: u32,
}

impl PhotonWidth {
    /// For a grid of at most `photons` photons; `steps`: stretches of them.
    pub fn new(kit: &Kit, grid: &Grid, photons: u32, steps: &Resources) -> Result<Self> {
        let work = Resources::of([("work", &grid.list.work)]);
        Ok(PhotonWidth { kernel: kit.bind(&shaders::PHOTON_WIDTH, &[&grid.resources(), &work, steps])?, photons })
    }

    /// Records the sums, one dispatch for each stretch of photons.
    pub fn record(&self, rec: &mut Recorder, steps: &[u32]) -> Result<()> {
        steps.iter().try_for_each(|&step| self.kernel.run(rec, &push(step), groups(self.photons)))
    }
}

/// Oracle: the flux of the photons around one, itself included.
pub fn around(frame: &layout::FrameParameters, own: &Photon, photons: &[Photon]) -> f32 {
    let radius = frame.photon[0];
    let near = |p: &&Photon| p.class == own.class && p.position.distance_squared(own.position) < radius * radius;
    let faces = |p: &&Photon| p.normal.dot(own.normal) > MIN_COSINE;
    photons.iter().filter(near).filter(faces).map(|p| mean(p.flux)).sum()
}

/// Oracle: r^2 over the squared radius of a footprint, by the flux of the photons around its photon.
pub fn narrowing(frame: &layout::FrameParameters, photon: &Photon, around: f32) -> f32 {
    match frame.lens[3] {
        0.0 => 1.0,
        many => (around / (many * mean(photon.flux))).max(1.0),
    }
}

fn mean(v: Vec3) -> f32 {
    v.element_sum() / 3.0
}
