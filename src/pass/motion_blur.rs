//! Motion blur by convolution (Bastos 1999, section 8.2.3.1): "the kernel shape is related to the velocity vector of the visible point at each
//! pixel with respect to the viewer".
//!
//! The kernel of a pixel q is the segment along its velocity v_q ([`super::velocity`]), in the middle of which it lies; k_q(o) is the part of
//! the time that it spends on the pixel at offset o. Along the longer side of the segment, of m pixels, that is the part of the segment that
//! lies in the column of o, over m; in it one of the two nearest rows takes all. Which one changes from column to column by a sequence of even
//! steps of the golden section, and from pass to pass by its start, so that in the mean over columns or passes both take their
//! shares. The k_q sum to 1 over the grid, and for m up to 1 they are a delta.
//!
//! The sum is that of the splat convolution ([`super::convolve`], program 7.17) taken from front to back, because segments of different
//! surfaces cover a pixel at different times. With the sources F in front of p, whose depth is less than that of p:
//!
//! ```text
//! f = sum over q in F of k_q(p - q)                                          time for which something in front covers p
//! C = sum over q in F of k_q(p - q) L_q
//! O = sum over q not in F of k_p(q - p) L_q / sum over q not in F of k_p(q - p)
//! e = sum over q in the image of k_p(q - p)                                  1, but for p whose segment leaves the image
//! r = max(e - f, 0)
//! L'_p = (C / max(f, 1) + r O) / (min(f, 1) + r)
//! ```
//!
//! O is the surface of p itself, as it passes, and beyond its outline what lies behind: the light of pixels there stands in for the background
//! that p hides now and uncovers meanwhile. So the background of a moving object is not smeared, an edge gets the profile of a box, half of it
//! within the outline, and a pixel that does not move and that nothing in front passes keeps its bits. Where all move alike L' is the plain
//! sum of k_q L_q.
//!
//! **Tiles.** The motion in each tile of 8 x 8 pixels bounds the pixels from which sources in front may come: a window along the longest
//! velocity that reaches the tile, widened by how much others deviate from it, at each distance. There is no window, and O is taken over
//! all q, where all velocities that reach the tile are [`ALIKE`], or where they do not jump between neighbours ([`VELOCITY_JUMP`]): there the
//! image moves like one smooth surface, whatever its depths, nothing is uncovered, and the point that is at p at a time t is p - v_p t, to first
//! order in the slope of v. A window is not looked through for pixels that are nearer than all that moves around. One of more than [`SAMPLES`]
//! pixels takes every second, third, ... column and row, from another start in each pass.
//!
//! The pass adds L' - L to the emission of the pixel, as the [`lens`](super::lens) does, after it; light without shutter and with it differ by no
//! bit where nothing moves.
//!
//! Differs from the thesis in: no texture holds the kernel, and no pyramid spreads it, since that would blur across the motion; front to back;
//! length by projection. Differs from a shutter in: there is one layer of points, so that the background hidden by a moving object is guessed
//! from the pixels along its path, and what only shows at other times is missing; shadows, highlights and mirrored objects do not move;
//! each point moves along a straight line at constant speed.
//!
//! Cost: 2 vec4 a pixel for its tile, a few hundred bytes for each tile; where something moves 12 vec4, then a texel for each pixel of length,
//! and where velocity jumps one for each pixel of the window, two if it is in front. 32 bytes of memory a pixel.

use ash::vk;

use super::layout::{MotionTile, MotionWindow};
use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Image, Recorder, Resources, shaders};

pub mod reference;

pub use reference::reference;

/// Relative difference of depths from which on a source counts as being in front.
///
/// Higher: near things behind an edge bleed over it. Lower: parts of one surface count as in front of each other, which does no harm.
pub const DEPTH_TOLERANCE: f32 = 0.01;
/// Samples of a window.
pub const SAMPLES: f32 = 12000.0;
/// Greatest difference between the velocities of neighbours on one surface, pixels.
///
/// Higher: less time; edges between things that touch and move differently are off by as much for each pixel of the way.
pub const VELOCITY_JUMP: f32 = 0.25;
/// Difference of velocities up to which they count as alike, pixels.
pub const ALIKE: f32 = 0.25;
/// The same as a share of the longest. Higher: less time where cameras move through a scene, and edges between surfaces at different depths
/// are off by up to this share of the blur.
pub const ALIKE_SHARE: f32 = 0.0625;

/// The pass.
pub struct MotionBlur {
    /// Image of the pass before it; w: depth. Written where something that moves reaches. An image, because lavapipe loads texels faster than
    /// elements of buffers.
    pub source: Image,
    /// Velocities there; z: depth.
    pub sweep: Image,
    /// [`MotionWindow`] of each tile.
    pub windows: Buffer,
    farthest: Buffer,
    tiles: BoundKernel,
    reach: BoundKernel,
    image: BoundKernel,
    spread: BoundKernel,
    count: u64,
}

/// Inputs and outputs.
pub struct Inputs<'a> {
    /// Velocities, [`super::velocity::Velocity::velocity`].
    pub velocity: &'a Buffer,
    /// Visible shading points; the difference that the pass makes is added to `emitted`.
    pub points: &'a ShadingPoints,
    /// Throughput and depth.
    pub paths: &'a EyePathState,
    /// Lighting of these points.
    pub lighting: &'a Lighting,
    /// Width and height of the image.
    pub size: [u32; 2],
}

impl MotionBlur {
    /// Prepares the pass.
    pub fn new(kit: &Kit, inputs: &Inputs) -> Result<MotionBlur> {
        let [width, height] = inputs.size;
        let count = width.div_ceil(8) * height.div_ceil(8);
        let image = |name| Image::new(kit.context, name, width, height, vk::Format::R32G32B32A32_SFLOAT);
        let (source, sweep) = (image("image before motion")?, image("motion of the image")?);
        let tiles = kit.array("motion tiles", count, size_of::<MotionTile>() as u64)?;
        let windows = kit.array("motion windows", count, size_of::<MotionWindow>() as u64)?;
        let farthest = kit.array("reach of motion", 1, 4)?;
        let own = Resources::of([
            ("velocity", inputs.velocity),
            ("motion_tiles", &tiles),
            ("motion_windows", &windows),
            ("farthest", &farthest),
        ])
        .with_image("source", &source)
        .with_image("sweep", &sweep);
        let sets = [&own, &inputs.points.resources(), &inputs.paths.resources(), &inputs.lighting.resources()];
        Ok(MotionBlur {
            tiles: kit.bind(&shaders::MOTION_BLUR_TILES, &sets)?,
            reach: kit.bind(&shaders::MOTION_BLUR_REACH, &sets)?,
            image: kit.bind(&shaders::MOTION_BLUR_IMAGE, &sets)?,
            spread: kit.bind(&shaders::MOTION_BLUR, &sets)?,
            count: u64::from(count),
            source,
            sweep,
            windows,
            farthest,
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        self.record_image(rec)?;
        self.spread.run(rec, &[], self.count)
    }

    /// Records the windows of the tiles, and the image of the pass where something reaches.
    pub fn record_image(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.farthest, 0)?;
        rec.image_to_general(&self.source)?;
        rec.image_to_general(&self.sweep)?;
        let lanes = self.count.div_ceil(super::GROUP);
        self.tiles.run(rec, &[], lanes)?;
        self.reach.run(rec, &[], lanes)?;
        self.image.run(rec, &[], self.count)
    }
}
