//! The passes of a frame that only some settings and scenes have.

use super::Frame;
use crate::error::Result;
use crate::gpu::Recorder;

impl Frame {
    /// The emitters get the probabilities by which the particles of this pass choose them, after what the eye sees.
    pub fn record_importance(&self, rec: &mut Recorder) -> Result<()> {
        match &self.importance {
            Some(importance) => importance.record(rec),
            None => Ok(()),
        }
    }

    /// The lights without area that this pass is lit by.
    pub fn record_delta_choice(&self, rec: &mut Recorder) -> Result<()> {
        match &self.delta_choice {
            Some(pass) => rec.scope("delta_choice", |rec| pass.record(rec)),
            None => Ok(()),
        }
    }

    /// Lights and the planar mirrors that mirror them are chosen.
    pub fn record_mirror_choice(&self, rec: &mut Recorder) -> Result<()> {
        match &self.mirror_lights {
            Some(pass) => rec.scope("mirror_lights", |rec| pass.record_choice(rec)),
            None => Ok(()),
        }
    }

    /// What the eye sees, bounce 0, is lit by mirrored lights.
    pub fn record_mirror_light(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        match &self.mirror_lights {
            Some(pass) if bounce == 0 => rec.scope("mirror_lights", |rec| pass.record_light(rec)),
            _ => Ok(()),
        }
    }

    /// Photons leave the lights by way of mirrors and glass and are sorted into their grid.
    pub fn record_photons(&self, rec: &mut Recorder) -> Result<()> {
        match &self.photons {
            Some(photons) => rec.scope("photons", |rec| photons.record(rec)),
            None => Ok(()),
        }
    }

    /// What the eye sees, bounce 0, is lit by photons.
    pub fn record_photon_light(&self, rec: &mut Recorder, bounce: usize) -> Result<()> {
        match &self.photons {
            Some(photons) if bounce == 0 => rec.scope("photons", |rec| photons.record_light(rec)),
            _ => Ok(()),
        }
    }

    /// Irradiance is averaged over neighbours on one surface.
    pub fn record_discontinuity(&self, rec: &mut Recorder) -> Result<()> {
        match &self.discontinuity {
            Some(pass) => rec.scope("discontinuity", |rec| pass.record(rec)),
            None => Ok(()),
        }
    }

    /// The light of second components is added to their pixels.
    pub fn record_merge(&self, rec: &mut Recorder) -> Result<()> {
        match &self.second {
            Some(second) => rec.scope("merge", |rec| second.merge.record(rec)),
            None => Ok(()),
        }
    }

    /// Mirror images are spread over their glossy planes.
    pub fn record_mirrors(&self, rec: &mut Recorder) -> Result<()> {
        match &self.mirrors {
            Some(mirrors) => rec.scope("mirrors", |rec| mirrors.record(rec)),
            None => Ok(()),
        }
    }

    /// What is out of focus is blurred.
    pub fn record_lens(&self, rec: &mut Recorder) -> Result<()> {
        match &self.lens {
            Some(lens) => rec.scope("lens", |rec| lens.record(rec)),
            None => Ok(()),
        }
    }

    /// The summands of the image are added to their sums.
    pub fn record_summands(&self, rec: &mut Recorder) -> Result<()> {
        match &self.summands {
            Some(pass) => rec.scope("summands", |rec| pass.record(rec)),
            None => Ok(()),
        }
    }
}
