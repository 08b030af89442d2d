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
//! **Tiles.** The motion in tiles of 8 x 8 pixels tells where something reaches a pixel at all. Depths are not compared, and O is taken over
//! all q, where all velocities that reach the tile are [`ALIKE`], or where they do not jump between neighbours ([`VELOCITY_JUMP`]): there the
//! image moves like one smooth surface, whatever its depths, nothing is uncovered, and the point that is at p at a time t is p - v_p t, to first
//! order in the slope of v. Elsewhere each q adds its time and its light to f and C of the pixels that it passes in front of, feed-forward as
//! in program 7.17. Atomic sums of whole numbers do not depend on their order: a step is 1 / 2^32 of the greatest sum that the longest
//! segments allow, of time 2^-25 for 31 pixels, of light as much of the brightest pixel.
//!
//! The pass adds L' - L to the emission of the pixel, as the [`lens`](super::lens) does, after it; light without shutter and with it differ by no
//! bit where nothing moves.
//!
//! Differs from the thesis in: no texture holds the kernel, and no pyramid spreads it, since that would blur across the motion; front to back;
//! length by projection. Differs from a shutter in: there is one layer of points, so that the background hidden by a moving object is guessed
//! from the pixels along its path, and what only shows at other times is missing; shadows, highlights and mirrored objects do not move;
//! each point moves along a straight line at constant speed.
//!
//! Cost: 2 vec4 a pixel for its tile, 44 bytes for each tile; where something moves 13 vec4, then a texel for each pixel of length, and where
//! velocity jumps 4 bytes for each pixel of length and 16 bytes of atomic sums for each pixel passed in front of. 52 bytes of memory a pixel.

use super::layout::{MotionReach, MotionTile};
use super::{BoundKernel, EyePathState, Kit, Lighting, ShadingPoints};
use crate::error::Result;
use crate::gpu::{Buffer, Recorder, Resources, shaders};

pub mod reference;

pub use reference::reference;

/// Relative difference of depths from which on a source counts as being in front.
///
/// Higher: near things behind an edge bleed over it. Lower: parts of one surface count as in front of each other, which does no harm.
pub const DEPTH_TOLERANCE: f32 = 0.01;
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
    /// [`MotionReach`] of each tile.
    pub reach: Buffer,
    farthest: Buffer,
    brightest: Buffer,
    find_tiles: BoundKernel,
    find_reach: BoundKernel,
    find_sends: BoundKernel,
    image: BoundKernel,
    front: BoundKernel,
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
        let pixels = width * height;
        let tiles = kit.array("motion tiles", count, size_of::<MotionTile>() as u64)?;
        let reach = kit.array("reach of motion", count, size_of::<MotionReach>() as u64)?;
        let sends = kit.array("tiles in front", count, 4)?;
        let [farthest, brightest] = [kit.array("farthest motion", 1, 4)?, kit.array("brightest pixel", 1, 4)?];
        let (source, sweep) = (kit.vec4s("image before motion", pixels)?, kit.vec4s("motion of the image", pixels)?);
        let (front, passing) = (kit.array("depths in front", pixels, 4)?, kit.vec4s("light in front", pixels)?);
        let own = Resources::of([
            ("velocity", inputs.velocity),
            ("motion_tiles", &tiles),
            ("motion_reach", &reach),
            ("sends", &sends),
            ("farthest", &farthest),
            ("brightest", &brightest),
            ("source", &source),
            ("sweep", &sweep),
            ("front", &front),
            ("passing", &passing),
        ]);
        let sets = [&own, &inputs.points.resources(), &inputs.paths.resources(), &inputs.lighting.resources()];
        Ok(MotionBlur {
            find_tiles: kit.bind(&shaders::MOTION_BLUR_TILES, &sets)?,
            find_reach: kit.bind(&shaders::MOTION_BLUR_REACH, &sets)?,
            find_sends: kit.bind(&shaders::MOTION_BLUR_SENDS, &sets)?,
            image: kit.bind(&shaders::MOTION_BLUR_IMAGE, &sets)?,
            front: kit.bind(&shaders::MOTION_BLUR_FRONT, &sets)?,
            spread: kit.bind(&shaders::MOTION_BLUR, &sets)?,
            count: u64::from(count),
            reach,
            farthest,
            brightest,
        })
    }

    /// Records the pass.
    pub fn record(&self, rec: &mut Recorder) -> Result<()> {
        rec.fill(&self.farthest, 0)?;
        rec.fill(&self.brightest, 0)?;
        let lanes = self.count.div_ceil(super::GROUP);
        self.find_tiles.run(rec, &[], lanes)?;
        self.find_reach.run(rec, &[], lanes)?;
        self.find_sends.run(rec, &[], lanes)?;
        self.image.run(rec, &[], self.count)?;
        self.front.run(rec, &[], self.count)?;
        self.spread.run(rec, &[], self.count)
    }
}
