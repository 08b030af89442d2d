//! Glossy planes: the mirror image, its convolution, and its addition to the pixels.

use super::{Eye, Stage};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder};
use crate::pass::convolve::{self, Convolve, Library};
use crate::pass::mirror_image::{self, Image, MirrorImage, Tables};
use crate::pass::superpose::Superpose;
use crate::pass::{Kit, Lighting};
use crate::plan::Plan;
use crate::settings::Spread;
use crate::superposition::kernels::{CORE_RADIUS, VIEW_ANGLES};

/// The stage.
pub struct GlossyPlanes {
    /// The mirror image.
    pub image: Image,
    mirror_image: MirrorImage,
    convolution: Option<Convolution>,
    superpose: Superpose,
}

/// The convolution of the mirror image: by the tails of the kernels, and by their cores.
struct Convolution {
    library: Library,
    tail: Convolve,
    core: Convolve,
}

impl GlossyPlanes {
    /// Adds the light of the planes that `eye` sees to `shown`; it comes from the second components, lit by `lighting`.
    /// `None`: no plane mirrors the room.
    pub fn new(
        kit: &Kit,
        plan: &Plan,
        tables: Option<&Tables>,
        eye: &Eye,
        lighting: &Lighting,
        shown: &Buffer,
    ) -> Result<Option<GlossyPlanes>> {
        let (Some(settings), Some(tables), true) = (&plan.settings.superposition, tables, plan.eye.mirrors) else {
            return Ok(None);
        };
        let size = plan.lit_size();
        let image = Image::new(kit.context, size[0] * size[1])?;
        let (points, paths, tiles, planes) = (&eye.points, &eye.paths, &eye.ideal_tiles, &eye.planes);
        let inputs = mirror_image::Inputs { points, paths, lighting, tiles, planes, tables, image: &image };
        let mirror_image = MirrorImage::new(kit, &inputs)?;
        let convolution = match settings.spread {
            Spread::Mirror => None,
            Spread::Invariant | Spread::Variant => {
                let mut staging = kit.staging.borrow_mut();
                let library = Library::new(kit.context, &mut staging, &tables.textures, &tables.narrowings)?;
                let widest = size[0].max(size[1]) as f32;
                let mut convolve = |radius: f32, texture: usize, footprint: &Buffer, first: Option<&Convolve>| {
                    // One kernel for each reflector: that at normal incidence, the first one as wide as asked for.
                    let wide = |tan_beta: f32| {
                        let first = tables.facing.first().map_or(tan_beta, |&(tan_beta, _)| tan_beta);
                        radius * settings.kernel_width as f32 * tan_beta / first.max(f32::MIN_POSITIVE)
                    };
                    let kernel = |&(tan_beta, texture_of): &(f32, usize)| {
                        [wide(tan_beta), (texture + texture_of) as f32, 1.0, 0.0]
                    };
                    let kernels: Vec<[f32; 4]> =
                        [[0.0; 4]].into_iter().chain(tables.facing.iter().map(kernel)).collect();
                    let of_regions = staging.stage(kit.context, "footprints of reflectors", &kernels)?;
                    let (footprint, widest) = match settings.spread {
                        Spread::Invariant => (&of_regions, kernels.iter().map(|kernel| kernel[0]).fold(0.0, f32::max)),
                        _ => (footprint, radius * widest),
                    };
                    let inputs = convolve::Inputs {
                        library: &library,
                        source: &image.source,
                        footprint,
                        by_region: settings.spread == Spread::Invariant,
                        region: &planes.region,
                        size,
                        widest,
                        form: settings.form,
                        occlusion: settings.occlusion && settings.spread == Spread::Variant,
                        layers: false,
                    };
                    match first {
                        None => Convolve::new(kit.context, &mut staging, &inputs),
                        Some(first) => Convolve::after(kit.context, &mut staging, &inputs, first),
                    }
                };
                let tail = convolve(1.0, VIEW_ANGLES - 1, &image.footprint, None)?;
                let core = convolve(CORE_RADIUS as f32, 2 * VIEW_ANGLES - 1, &image.core_footprint, Some(&tail))?;
                Some(Convolution { library, tail, core })
            }
        };
        let spread = convolution.as_ref().map_or([&image.source; 2], |c| [&c.tail.spread, &c.core.spread]);
        let superpose = Superpose::new(kit, points, tiles, (planes, spread), tables, shown)?;
        Ok(Some(GlossyPlanes { image, mirror_image, convolution, superpose }))
    }

    /// Records the mirror image.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        self.mirror_image.record(rec)
    }

    /// Records the convolution of the mirror image.
    pub fn record_spread(&self, rec: &mut Recorder) -> Result<()> {
        match &self.convolution {
            Some(Convolution { tail, core, .. }) => rec.scope("convolve", |rec| {
                tail.record(rec)?;
                core.record(rec)
            }),
            None => Ok(()),
        }
    }

    /// Records the addition of the spread image to the pixels.
    pub fn record_superpose(&self, rec: &mut Recorder) -> Result<()> {
        self.superpose.record(rec)
    }
}

impl Stage for GlossyPlanes {
    const NAME: &'static str = "mirrors";

    /// Records the preparation of the kernels.
    fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        self.convolution.as_ref().map_or(Ok(()), |convolution| convolution.library.record(rec))
    }

    fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_image(rec)?;
        self.record_spread(rec)?;
        self.record_superpose(rec)
    }
}
