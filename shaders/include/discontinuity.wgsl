// Shared by the steps of the discontinuity buffer. See pass/discontinuity.rs. Needs frame.wgsl and work.wgsl.

// Push constants. Host twin: pass::layout::Window.
struct Window {
    shares_x: vec4<f32>,    // share of a neighbour 1, 2, 3, 4 columns away; the centre pixel has 1
    shares_y: vec4<f32>,    // the same for rows
    reach: vec2<i32>,       // maximum offsets with a share
    middle: f32,            // share of the centre pixel in the whole window
    component: u32,         // 0: first components; 1: second components, on the list of tiles
}
var<immediate> window: Window;

// First slot of the present components.
fn first_slot() -> i32 {
    return i32(window.component * frame.size.z);
}

// Upper left pixel of a tile.
fn tile_corner(tile: u32) -> vec2<i32> {
    return 8 * vec2<i32>(divided(tile, (frame.size.x + 7u) / 8u).yx);
}

fn slot_at(at: vec2<i32>) -> i32 {
    return first_slot() + at.y * i32(frame.size.x) + at.x;
}

// Texel of a pixel in the images of the guides.
fn texel_at(at: vec2<i32>) -> vec2<i32> {
    return at + vec2<i32>(0, i32(window.component * frame.size.y));
}
