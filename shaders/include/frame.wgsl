// Parameters of the pass, and where slots lie in the image.
#include "frame_parameters.wgsl"

@group(0) @binding(0) var<storage, read> frame: FrameParameters;

// Quotient below 2^20, and remainder, of numbers below 2^31. By floats, whose error is below 1/2 here, and a correction by one: SIMD
// processors divide integers one by one.
fn divided(n: u32, d: u32) -> vec2<u32> {
    let estimate = i32(f32(i32(n)) / f32(i32(d)));
    let rest = i32(n) - estimate * i32(d);
    let one = select(select(0, 1, rest >= i32(d)), -1, rest < 0);
    return vec2<u32>(vec2<i32>(estimate + one, rest - one * i32(d)));
}

// Component of a slot: 0 is the first. Second components follow the first ones of all pixels, and third ones those.
fn component_of(slot: u32) -> u32 {
    return select(0u, 1u, slot >= frame.size.z) + select(0u, 1u, slot >= 2u * frame.size.z);
}

// Whether a slot is that of a third component.
fn is_third(slot: u32) -> bool {
    return component_of(slot) == 2u;
}

// Pixel of a slot.
fn pixel_of(slot: u32) -> u32 {
    return slot - component_of(slot) * frame.size.z;
}

// Column and row of a pixel.
fn place_of_pixel(pixel: u32) -> vec2<u32> {
    return divided(pixel, frame.size.x).yx;
}

// Class of the pixel at a place by interleaved sampling: the place in the pattern.
fn class_at(at: vec2<u32>) -> u32 {
    return divided(at.x, frame.pattern.x).y + frame.pattern.x * divided(at.y, frame.pattern.y).y;
}

// Whether a pixel belongs to the task of the pass.
fn in_task(at: vec2<u32>) -> bool {
    let within = all(at >= frame.task[0].xy) && all(at < frame.task[0].zw);
    let in_class = frame.task[1].y == 0u || class_at(at) + 1u == frame.task[1].y;
    return frame.task[1].x == 0u || (within && in_class);
}

// Class of a slot: that of its pixel.
fn class_of(slot: u32) -> u32 {
    return class_at(place_of_pixel(pixel_of(slot)));
}

// Number of a slot in the whole image, for random numbers: a region of an image draws those of the whole.
fn sample_of(slot: u32) -> u32 {
    let at = place_of_pixel(pixel_of(slot));
    return at.x + frame.within.x + (at.y + frame.within.y + component_of(slot) * frame.within.w) * frame.within.z;
}

// Part of a tile of 8 x 8 pixels that lies in the image: lower corner, width and height.
fn part_of_tile(tile: u32) -> vec4<u32> {
    let low = 8u * divided(tile, (frame.size.x + 7u) / 8u).yx;
    return vec4<u32>(low, min(frame.size.xy - low, vec2<u32>(8u)));
}

// Pixel of a lane in a tile of 8 x 8 pixels; it may lie beyond the image.
fn pixel_of_tile(tile: u32, lane: u32) -> vec2<u32> {
    return 8u * divided(tile, (frame.size.x + 7u) / 8u).yx + vec2<u32>(lane & 7u, lane / 8u);
}

// Whether eye rays are parallel. Host twin: layout::FrameParameters::is_orthographic.
fn is_orthographic() -> bool {
    return frame.shift.z != 0.0;
}

// Width of a pixel at a depth, as cones.x has it of one at unit depth. Host twin: layout::FrameParameters::depth_scale.
fn depth_scale(depth: f32) -> f32 {
    return select(depth, 1.0, is_orthographic());
}

// Whether rays that leave the scene meet an environment. Host twin: layout::FrameParameters::ENVIRONMENT.
fn has_environment() -> bool {
    return (frame.keys.z & 8u) != 0u;
}
