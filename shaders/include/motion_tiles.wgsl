// Tiles of 8 x 8 pixels by what moves in them. See pass/motion_blur.rs.

// Velocities in a tile.
struct MotionTile {
    range: vec4<f32>,        // least and greatest velocity to the right, then downwards, of the pixels that move
    longest: vec2<f32>,     // the longest of them
    kinds: u32,             // bits, see below
    nearest: f32,           // least depth of those that move
}

const MOVES: u32 = 1u;      // some of its pixels move
const RESTS: u32 = 2u;      // some do not
const JUMPS: u32 = 4u;      // between neighbours, one of which it holds, velocity or depth jumps

// The sources that reach a tile, as a window around each of its pixels.
struct MotionWindow {
    slope: f32,             // of the longest velocity, against its longer side
    along: f32,             // reach along that side, pixels; -1: nothing reaches the tile
    across: f32,            // greatest distance of the end of a segment from the line of that slope
    spread: f32,            // the same for each pixel of distance along the line
    margin: f32,            // pixels beyond
    wide: u32,              // 1: the longer side lies along rows
    even: u32,              // 1: all sources count as one surface, and depths need no comparison
    stride: u32,            // pixels from one sample of the window to the next
    nearest: f32,           // least depth of these sources
}
