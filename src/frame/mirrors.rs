//! Glossy planes in the frame: the mirror image, its convolution, and its way into the pixels.

use crate::error::Result;
use crate::gpu::{Buffer, Context, Recorder, Staging};
use crate::pass::convolve::{self, Convolve, Form, Library};
use crate::pass::mirror_image::{self, Image, MirrorImage, Planes, Tables};
use crate::pass::superpose::Superpose;
use crate::pass::{Kernels, List, Paths, Receivers, Sums};
use crate::settings::{Spread, Superposition};
use crate::superposition::kernels::{CORE_RADIUS, VIEW_ANGLES};

/// The passes of glossy planes with their buffers.
pub struct Mirrors {
    /// Kernels and reflectance of the planes.
    pub tables: Tables,
    /// The mirror image.
    pub image: Image,
    mirror_image: MirrorImage,
    convolution: Option<Convolution>,
    superpose: Superpose,
}

/// How the mirror image is spread: by the tails of the kernels, and by their cores.
struct Convolution {
    library: Library,
    tail: Convolve,
    core: Convolve,
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
        let convolution = match settings.spread {
            Spread::Mirror => None,
            Spread::Invariant | Spread::Variant => {
                let library = Library::new(context, staging, &tables.textures, &tables.narrowings)?;
                let widest = width.max(height) as f32;
                let mut convolve = |radius: f32, texture: usize, footprint: &Buffer| {
                    // One kernel for all: that of the greatest reflector seen head on.
                    let width = radius * settings.kernel_width as f32;
                    let one = staging.stage(context, "footprint of all", &[[width, texture as f32, 1.0, 0.0]])?;
                    let (footprint, widest) = match settings.spread {
                        Spread::Invariant => (&one, width),
                        _ => (footprint, radius * widest),
                    };
                    Convolve::new(
                        context,
                        staging,
                        &convolve::Inputs {
                            library: &library,
                            source: &image.source,
                            footprint,
                            region: &inputs.planes.region,
                            size: inputs.size,
                            widest,
                            form: Form::Auto,
                            occlusion: settings.occlusion && settings.spread == Spread::Variant,
                            layers: false,
                        },
                    )
                };
                let tail = convolve(1.0, VIEW_ANGLES - 1, &image.footprint)?;
                let core = convolve(CORE_RADIUS as f32, 2 * VIEW_ANGLES - 1, &image.core_footprint)?;
                Some(Convolution { library, tail, core })
            }
        };
        let spread = convolution.as_ref().map_or([&image.source; 2], |c| [&c.tail.spread, &c.core.spread]);
        let superpose = Superpose::new(
            kernels,
            inputs.frame,
            inputs.receivers,
            inputs.tiles,
            (inputs.planes, spread),
            &tables,
            inputs.shown,
        )?;
        Ok(Mirrors { tables, image, mirror_image, convolution, superpose })
    }

    /// Records what must happen once after the uploads: the kernels get the form in which they are sampled.
    pub(super) fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        self.convolution.as_ref().map_or(Ok(()), |convolution| convolution.library.record(rec))
    }

    /// Records the passes.
    pub(super) fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_image(rec)?;
        self.record_spread(rec)?;
        self.record_superpose(rec)
    }

    /// The mirror image is put together.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        self.mirror_image.record(rec)
    }

    /// The mirror image is spread.
    pub fn record_spread(&self, rec: &mut Recorder) -> Result<()> {
        match &self.convolution {
            Some(Convolution { tail, core, .. }) => rec.scope("convolve", |rec| {
                tail.record(rec)?;
                core.record(rec)
            }),
            None => Ok(()),
        }
    }

    /// What has been spread is added to the pixels.
    pub fn record_superpose(&self, rec: &mut Recorder) -> Result<()> {
        self.superpose.record(rec)
    }
}
