// Tiles of 8 x 8 pixels by what moves in them. See pass/motion_blur.rs.

// Velocities in a tile.
struct MotionTile {
    range: vec4<f32>,        // least and greatest velocity to the right, then downwards, of the pixels that move
    longest: f32,           // length of the longest of them
    kinds: u32,             // bits, see below
    deepest: f32,           // greatest depth, of those too that do not move
}

const MOVES: u32 = 1u;      // some of its pixels move
const RESTS: u32 = 2u;      // some do not
const JUMPS: u32 = 4u;      // between neighbours, one of which it holds, velocity or depth jumps

// The sources that reach a tile.
struct MotionReach {
    reached: u32,           // 1: some do
    even: u32,              // 1: all of them count as one surface, and depths need no comparison
}

// Reach of a tile's sources along rows and columns, pixels.
fn reach_of(tile: MotionTile) -> vec2<f32> {
    let reach = 0.5 * vec2<f32>(max(-tile.range.x, tile.range.y), max(-tile.range.z, tile.range.w)) + 1.0;
    return select(vec2<f32>(-1.0), reach, (tile.kinds & MOVES) != 0u);
}

// Steps in which light and time in front of a pixel are counted, so that the sums are whole numbers and do not depend on their order. Of
// the sources at a distance of d pixels, 8 d at most, each spends 1 / (2 d - 1) of the time on the pixel, so that times sum up to
// less than 8 for each pixel of reach.
fn passing_steps(farthest: u32, brightest: f32) -> vec4<f32> {
    let step = f32(max(farthest, 1u)) * (64.0 / 4294967296.0);
    return step * vec4<f32>(vec3<f32>(max(brightest, 1e-30)), 1.0);
}
