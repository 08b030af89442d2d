// Tiles of 8 x 8 pixels by what moves in them. See pass/motion_blur.rs.

// Velocities in a tile.
struct MotionTile {
    range: vec4<f32>,        // least and greatest velocity to the right, then downwards, of the pixels that move
    longest: vec2<f32>,     // the longest of them
    moves: u32,             // 1: some move
    rests: u32,             // 1: some do not
}

// The sources that reach a tile, as a window around each of its pixels.
struct MotionWindow {
    slope: f32,             // of the longest velocity, against its longer side
    along: f32,             // reach along that side, pixels; -1: nothing reaches the tile
    across: f32,            // greatest distance of the end of a segment from the line of that slope
    spread: f32,            // the same for each pixel of distance along the line
    margin: f32,            // pixels beyond
    wide: u32,              // 1: the longer side lies along rows
    even: u32,              // 1: all sources move alike, and depths need no comparison
    stride: u32,            // pixels from one sample of the window to the next
}
