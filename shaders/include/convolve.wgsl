// Shared by the steps of the convolution. See pass/convolve.rs.
#include "spread_out.wgsl"

// A step: a level of the pyramid, or rows of the window. Host twin: pass::layout::ConvolveStep.
struct ConvolveStep {
    size: vec2<u32>,        // texels of the level
    tiles: vec2<u32>,       // its tiles of 8 x 8 texels
    first: u32,             // its first entry; from level 1 on two for each texel, one plane after the other
    first_tile: u32,        // its first tile
    rows: vec2<i32>,        // rows of the window in this round: first, one past the last
    flags: u32,             // bits, see below
    layers: u32,            // textures of the library
    texel: f32,             // edge of a texel in pixels
    widest: f32,            // maximum diameter in pixels
    reach: u32,             // reach of a source of the level, in tiles
    level: u32,             // of the pyramid; 0: the image
}

const FIRST_ROUND: u32 = 1u;
const LAST_ROUND: u32 = 2u;
const TOP_LEVEL: u32 = 4u;
const INVARIANT: u32 = 8u;
const EVERYWHERE: u32 = 16u;

struct Push {
    step: u32,
}

@group(0) @binding(0) var<storage, read> steps: array<ConvolveStep>;
var<immediate> push: Push;

// Host twins: pass::convolve::{KERNEL_TEXELS, NORM_WIDTHS, NORM_ANGLES, ...}.
const TEXELS: u32 = 32u;
// Cells between the centres of texels, with a rim of zeros around the texture.
const CELLS: u32 = 33u;
const CELLS_OF_LAYER: u32 = 1089u;
const NORM_STEPS: f32 = 8.0;
const NORM_WIDTHS: u32 = 129u;
const NORM_ANGLES: u32 = 8u;
// Reach of a kernel in radii: to texels with centres in the disc, and on to the next texels.
const SUPPORT: f32 = 1.0885;
// A kernel with a smaller sum over the grid falls between its texels.
const MIN_SUM: f32 = 1e-3;
// Most steps of 2^(1/4) by which a kernel is narrower along v: four bits.
const MAX_STEPS: u32 = 15u;
// Inverse radius of a source that does not spread.
const DELTA: f32 = 1e6;

// Steps of 2^(1/4) in a factor; none below 1.
fn steps_of(factor: f32) -> u32 {
    return u32(4.0 * log2(clamp(factor, 1.0, 16.0)) + 0.5);
}
