//! Glossy planes in the frame: the mirror image, its convolution, and its way into the pixels.

use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Staging};
use crate::pass::mirror_image::{self, Image, MirrorImage, Planes, Tables};
use crate::pass::superpose::Superpose;
use crate::pass::{Kernels, List, Paths, Receivers, Sums};
use crate::settings::Superposition;

/// The passes of glossy planes with their buffers.
pub struct Mirrors {
    /// Kernels and reflectance of the planes.
    pub tables: Tables,
    /// The mirror image.
    pub image: Image,
    mirror_image: MirrorImage,
    superpose: Superpose,
}

/// What the passes read and write.
pub(super) struct Inputs<'a> {
    pub(super) frame: &'a Buffer,
    pub(super) receivers: &'a Receivers,
    pub(super) paths: &'a Paths,
    pub(super) sums: &'a Sums,
    /// What the light of the planes is added to.
    pub(super) shown: &'a Buffer,
    pub(super) tiles: &'a List,
    pub(super) planes: &'a Planes,
    pub(super) size: [u32; 2],
}

impl Mirrors {
    pub(super) fn new(
        context: &Context,
        kernels: &Kernels,
        staging: &mut Staging,
        settings: &Superposition,
        tables: Tables,
        inputs: &Inputs,
    ) -> Result<Mirrors> {
        let [width, height] = inputs.size;
        let image = Image::new(context, width * height)?;
        let mirror_image = MirrorImage::new(
            kernels,
            &mirror_image::Inputs {
                frame: inputs.frame,
                receivers: inputs.receivers,
                paths: inputs.paths,
                sums: inputs.sums,
                tiles: inputs.tiles,
                planes: inputs.planes,
                tables: &tables,
                image: &image,
            },
        )?;
        let spread = &image.source;
        let superpose = Superpose::new(
            kernels,
            inputs.frame,
            inputs.receivers,
            inputs.tiles,
            (&inputs.planes.region, spread),
            &tables,
            inputs.shown,
        )?;
        Ok(Mirrors { tables, image, mirror_image, superpose })
    }

    /// Records the passes.
    pub(super) fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_image(rec)?;
        self.record_superpose(rec)
    }

    /// The mirror image is put together.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        self.mirror_image.record(rec)
    }

    /// What has been spread is added to the pixels.
    pub fn record_superpose(&self, rec: &mut Recorder) -> Result<()> {
        self.superpose.record(rec)
    }
}
