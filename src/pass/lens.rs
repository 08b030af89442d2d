//! Depth of field by the convolution (Bastos 1999, section 8.2.3.1; row B12): "the kernel shape represents the impulse response
//! of the camera lens, the support is proportional to the distance from the in-focus plane".
//!
//! The image of the pass is the source, and each pixel is spread by the disc that a thin lens of diameter a, focused on the plane at
//! distance F, makes of a point at depth z:
//!
//! ```text
//! L = L_e + throughput (kd / pi (E_direct + E_indirect) + L_specular)     what accumulate would add
//! c = a f |1 / z - 1 / F|                                                 diameter of the circle of confusion in pixels
//! L_e += L' - L                                                           L' is L convolved
//! ```
//!
//! f are the pixels of a unit of length at unit distance, depths are along the direction of view, so the circle is the same all over
//! the image; it is that of the image on the plane in focus, so that a wide field does not deform it. What is seen through mirrors and glass
//! has the depth of its mirror image; a ray that meets nothing is infinitely far. The kernel is a uniform disc.
//!
//! So `accumulate` finds the blurred radiance and its other layers stay sharp. With [`super::convolve`]'s occlusion
//! what is blurred behind does not bleed over what is sharp in front: the pixels behind the plane in focus are one of its layers and those
//! before it are the other.
//!
//! Differs from the thesis in: the circle is exactly that of the thin lens, its normalisation and occlusion. From a lens: there is one layer of
//! pixels, so what is hidden behind the rim of a blurred object in front, or just beyond the image's border, is missing, and the rim of such an object
//! stays hard on its inside. What glossy planes and glass show besides the first component has its pixel's depth. Circles are no wider than the image.
//!
//! Cost: 10 vec4 and 30 operations a pixel before the convolution, 4 vec4 after it; 36 bytes of memory a pixel, and those of the convolution,
//! which takes by far the most time.

use glam::Vec3;

use super::convolve::{self, Convolve, Form, KERNEL_TEXELS, Library};
use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints, groups, layout};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

pub use super::mirror_image::NOTHING_SEEN;

/// Circles are no greater, pixels.
pub const MAX_DIAMETER: f32 = 1e6;

/// The pass.
pub struct Lens {
    /// What the pass shows without the lens; w: depth.
    pub source: Buffer,
    /// Circle of each pixel: diameter, kernel, u axis.
    pub footprint: Buffer,
    /// Layer of each pixel: 1, in focus or behind; 2, before.
    pub region: Buffer,
    library: Library,
    /// Spreads the image.
    pub convolution: Convolve,
    prepare: BoundKernel,
    add: BoundKernel,
    pixels: u32,
}

/// What the pass reads and writes.
pub struct Inputs<'a> {
    /// What the eye sees; `emitted` is added to.
    pub points: &'a ShadingPoints,
    /// Throughput and depth.
    pub paths: &'a EyePathState,
    /// Their light.
    pub lighting: &'a Lighting,
    /// Width and height of the image.
    pub size: [u32; 2],
}

impl Lens {
    /// Prepares the pass.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<Lens> {
        let [width, height] = inputs.size;
        let pixels = width * height;
        let source = kit.vec4s("sharp image", pixels)?;
        let footprint = kit.vec4s("circles of confusion", pixels)?;
        let region = kit.array("lens layers", pixels, 4)?;
        let kernel = kit.stage("lens kernel", &disc())?;
        let mut staging = kit.staging.borrow_mut();
        let library = Library::new(kit.context, &mut staging, &kernel, &[0])?;
        let convolution = Convolve::new(
            kit.context,
            &mut staging,
            &convolve::Inputs {
                library: &library,
                source: &source,
                footprint: &footprint,
                region: &region,
                size: inputs.size,
                widest: width.max(height) as f32,
                form: Form::Auto,
                occlusion: true,
                layers: true,
            },
        )?;
        let own = Resources::of([
            ("source", &source),
            ("footprint", &footprint),
            ("region", &region),
            ("spread", &convolution.spread),
        ]);
        let (points, paths) = (inputs.points.resources(), inputs.paths.resources());
        let sets = [&own, &points, &paths, &inputs.lighting.resources()];
        let (prepare, add) = (kit.bind(&shaders::LENS, &sets)?, kit.bind(&shaders::LENS_ADD, &sets)?);
        Ok(Lens { source, footprint, region, library, convolution, prepare, add, pixels })
    }

    /// Records what must happen once after the uploads: the kernel gets the form in which it is sampled.
    pub fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        self.library.record(rec)
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_image(rec)?;
        rec.scope("convolve", |rec| self.convolution.record(rec))?;
        self.record_add(rec)
    }

    /// The image of the pass and its circles are put together.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        self.prepare.run(rec, &[], groups(self.pixels))
    }

    /// What the lens changes is added to what the pixels emit.
    pub fn record_add(&self, rec: &mut Recorder) -> Result<()> {
        self.add.run(rec, &[], groups(self.pixels))
    }
}

/// The kernel: a uniform disc.
pub fn disc() -> Vec<f32> {
    let centre = |i: u32| 2.0 * (i as f32 + 0.5) / KERNEL_TEXELS as f32 - 1.0;
    let inside = |i: u32| centre(i % KERNEL_TEXELS).hypot(centre(i / KERNEL_TEXELS)) <= 1.0;
    (0..KERNEL_TEXELS * KERNEL_TEXELS).map(|i| if inside(i) { 1.0 } else { 0.0 }).collect()
}

/// Oracle: diameter in pixels of the disc that a lens `aperture` wide, focused on `focus`, makes of a point at a depth, or
/// infinitely far: the rays from the lens's rim through the point, cut by the plane in focus.
pub fn reference(frame: &layout::Frame, aperture: f32, focus: f32, depth: Option<f32>) -> f32 {
    let [width, half_width] = [frame.size[0] as f32, Vec3::from_slice(&frame.right[..3]).length()];
    let on_plane = depth.map_or(aperture, |z| aperture * (focus - z).abs() / z);
    on_plane / (2.0 * half_width * focus) * width
}
