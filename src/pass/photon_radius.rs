//! The radius of the look-up of a pass, by the number of photons that were stored.
//!
//! Where mirrors and glass are far from the lights or hidden from them, few photons are stored, and each carries much. With n of N
//! photons stored, and r the radius of the parameters,
//!
//! ```text
//! r' = r sqrt(EXPECTED N / n)       at least r, at most WIDEST r, if n <= MANY N
//! r' = r sqrt(MANY N / n)           at least NARROWEST r, otherwise
//! ```
//!
//! so that n photons cover at least the area that a usual number of them covers, and none is a spot; and so that look-ups where most photons are
//! stored, before glass that fills the targets of the lights, do not visit more of them than elsewhere. Where they are dense `photon_width` narrows them further. The pass changes [`FrameParameters::photon`] on the device. Not where the radius is set by hand.
//!
//! Cost: 16 bytes for each photon, by one workgroup.

use super::layout::FrameParameters;
use super::{BoundKernel, Kit};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Share of the photons that are stored from which on the radius is not widened.
pub const EXPECTED: f32 = 0.05;
/// Share of the photons that are stored from which on the radius is narrowed. Higher: slower look-ups. Lower: single photons show.
pub const MANY: f32 = 0.1;
/// Maximum factor of the radius. Higher: fainter spots, and more of the light of photons fades at edges.
pub const WIDEST: f32 = 3.0;
/// Minimum factor of the radius. Lower: single photons show on walls.
pub const NARROWEST: f32 = 0.5;

/// The pass.
pub struct PhotonRadius {
    kernel: BoundKernel,
}

impl PhotonRadius {
    /// Reads the `position` of the photons (w: 1 if stored).
    pub fn new(kit: &Kit, position: &Buffer) -> Result<Self> {
        let own = Resources::of([("photon_position", position)]);
        Ok(PhotonRadius { kernel: kit.bind(&shaders::PHOTON_RADIUS, &[&own])? })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.kernel.run(rec, &[], 1)
    }
}

/// Oracle: [`FrameParameters::photon`] after the pass.
pub fn reference(frame: &FrameParameters, stored: usize) -> [f32; 4] {
    let [r, half, share, bits] = frame.photon;
    if frame.lens[3] == 0.0 {
        return frame.photon;
    }
    let count = (frame.photons[0] * frame.pattern[2]) as f32;
    let ratio = count / stored.max(1) as f32;
    let wide = (EXPECTED * ratio).sqrt().clamp(1.0, WIDEST) * (MANY * ratio).sqrt().clamp(NARROWEST, 1.0);
    [r * wide, half / wide, share / (wide * wide), bits]
}
