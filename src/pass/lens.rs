//! Depth of field by convolution (Bastos 1999, section 8.2.3.1): "the kernel shape represents the impulse response of
//! the camera lens, the support is proportional to the distance from the in-focus plane".
//!
//! The source is the image of the pass. Each pixel is spread over the disc into which a thin lens of diameter a,
//! focused on the plane at distance F, images a point at depth z:
//!
//! ```text
//! L = L_e + throughput (kd / pi (E_direct + E_indirect) + L_specular)     what accumulate would add
//! c = a f |1 / z - 1 / F|                                                 diameter of the circle of confusion in pixels
//! L_e += L' - L                                                           L' is L convolved
//! ```
//!
//! f is the number of pixels in a unit of length at unit distance. Depths are along the view direction, so the circle
//! is the same all over the image; it is measured on the plane in focus, so that a wide field of view does not deform
//! it. Points seen through mirrors and glass have the depth of their mirror image; a ray that hits nothing has infinite
//! depth. The kernel is a uniform disc.
//!
//! So `accumulate` sees the blurred radiance, and its other layers stay sharp. With the occlusion of
//! [`super::convolve`] a blurred background does not bleed over a sharp foreground: pixels behind the plane in focus
//! form one of its layers, and pixels in front of it the other.
//!
//! Differs from the thesis in: the circle is exactly that of the thin lens; normalisation and occlusion. Differs from a
//! lens in: the image has a single layer of visible points, so points hidden behind the edge of a blurred foreground
//! object, or just outside the image, are missing, and such an object's edge stays hard on its inside. Second
//! components of glossy planes and glass have the depth of their pixel. Circles are limited to the width of the image.
//!
//! Cost: 10 vec4 and 30 operations a pixel before the convolution, 4 vec4 after it; 36 bytes of memory a pixel. The
//! convolution adds its own memory and takes most of the time.

use glam::Vec3;

use super::convolve::{self, Convolve, Form, KERNEL_TEXELS, Library};
use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints, groups, layout};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

pub use super::mirror_image::NOTHING_SEEN;

/// Maximum diameter of a circle, pixels.
pub const MAX_DIAMETER: f32 = 1e6;

/// The pass.
pub struct Lens {
    /// Image of the pass without the lens; w: depth.
    pub source: Buffer,
    /// Circle of each pixel: diameter, kernel, u axis.
    pub footprint: Buffer,
    /// Layer of each pixel: 1, in focus or behind; 2, in front.
    pub region: Buffer,
    library: Library,
    /// Spreads the image.
    pub convolution: Convolve,
    prepare: BoundKernel,
    add: BoundKernel,
    pixels: u32,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Visible shading points; the difference that the lens makes is added to `emitted`.
    pub points: &'a ShadingPoints,
    /// Throughput and depth.
    pub paths: &'a EyePathState,
    /// Lighting of these points.
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
                by_region: false,
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

    /// Records the preparation of the kernel, once after the uploads.
    pub fn record_setup(&self, rec: &mut Recorder) -> Result<()> {
        self.library.record(rec)
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_image(rec)?;
        rec.scope("convolve", |rec| self.convolution.record(rec))?;
        self.record_add(rec)
    }

    /// Records the image of the pass and its circles.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        self.prepare.run(rec, &[], groups(self.pixels))
    }

    /// Records the addition of the difference that the lens makes to `emitted`.
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

/// Oracle: diameter in pixels of the disc into which a lens of diameter `aperture`, focused on `focus`, images a point
/// at a depth (`None`: infinite): the rays from the lens's rim through the point, intersected with the plane in focus.
pub fn reference(frame: &layout::FrameParameters, aperture: f32, focus: f32, depth: Option<f32>) -> f32 {
    let [width, half_width] = [frame.size[0] as f32, Vec3::from_slice(&frame.right[..3]).length()];
    let on_plane = depth.map_or(aperture, |z| aperture * (focus - z).abs() / z);
    on_plane / (2.0 * half_width * focus) * width
}
