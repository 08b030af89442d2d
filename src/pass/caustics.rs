//! Keeps caustics out of the filters: E_indirect -= E_caustic before them, += E_caustic after them.
//!
//! E_caustic is the irradiance by photons whose footprints have at most half the radius of the look-up ([`SHARP`]). All pixels share the photons of a pass, and
//! each footprint covers some pixels, so there is little noise that neighbours do not have in common; the filters would only blur
//! the edges of caustics. Photons with wider footprints leave light without edges, and theirs is filtered. Where each class of pixels has photons of
//! its own ([`interleave_photons`](crate::settings::Settings::interleave_photons)) neighbours differ, and all light is filtered.
//!
//! Light before the filters gets it back too, since no filter has added it ([`gain`](super::gain)).
//!
//! Cost: a vec4 cleared and read twice for each slot, and 3 read and written for each slot that has such light; 16 bytes of memory a slot.

use super::{BoundKernel, Kit, Lighting, groups};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

/// Squared radius of the look-up over that of a footprint from which the light of a photon is a caustic. Higher: more noise of photons is filtered, and more
/// edges are blurred.
pub const SHARP: f32 = 4.0;

/// The pass.
pub struct Caustics {
    /// Irradiance of caustics, of each slot.
    pub caustic: Buffer,
    take: BoundKernel,
    add: BoundKernel,
    slots: u32,
}

impl Caustics {
    /// `caustic`: the irradiance of so many slots; `raw` and `filtered`: light before and after the filters.
    pub fn new(kit: &Kit, caustic: &Buffer, [raw, filtered]: [&Lighting; 2], slots: u32) -> Result<Self> {
        let sets =
            Resources::of([("caustic", caustic), ("raw_indirect", &raw.indirect), ("indirect", &filtered.indirect)]);
        Ok(Caustics {
            take: kit.bind(&shaders::CAUSTICS_TAKE, &[&sets])?,
            add: kit.bind(&shaders::CAUSTICS_ADD, &[&sets])?,
            caustic: caustic.clone(),
            slots,
        })
    }

    /// Records the part before the filters.
    pub fn run_take(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope("caustics", |rec| self.take.run(rec, &[], groups(self.slots)))
    }

    /// Records the part after them.
    pub fn run_add(&self, rec: &mut Recorder) -> Result<()> {
        rec.scope("caustics", |rec| self.add.run(rec, &[], groups(self.slots)))
    }
}
