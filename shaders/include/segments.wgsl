// Segments that points cover in the image while the shutter is open. See pass/motion_blur.rs.

// A source is in front of a pixel if its depth is less by more than this share. Host twin: pass::motion_blur::DEPTH_TOLERANCE.
const DEPTH_TOLERANCE: f32 = 0.01;

// The segment of a velocity, which lies in the middle of it.
struct Segment {
    slope: f32,     // against its longer side
    half: f32,      // half of its longer side
    share: f32,     // part of it in each column that it crosses: 1 / its longer side
    wide: bool,     // the longer side lies along rows
}

// As a texel: slope; half of the longer side, negative where that lies along columns; depth; share.
fn packed_segment(v: vec2<f32>, depth: f32) -> vec4<f32> {
    let wide = abs(v.x) >= abs(v.y);
    let axes = select(v.yx, v, wide);
    let length = max(abs(axes.x), 1.0);
    let slope = axes.y / select(1.0, axes.x, abs(axes.x) > 1.0);
    return vec4<f32>(slope, select(-0.5, 0.5, wide) * length, depth, 1.0 / length);
}

fn segment_of(texel: vec4<f32>) -> Segment {
    return Segment(texel.x, abs(texel.y), texel.w, texel.y > 0.0);
}

// Part of a segment that lies in a column, counted along its longer side from its middle.
fn share_of(column: f32, segment: Segment) -> f32 {
    return saturate(segment.half + 0.5 - abs(column)) * segment.share;
}

// Part of a row by which a column is shifted; `dither`: a word that differs from pass to pass.
fn dither_of(column: i32, dither: u32) -> f32 {
    return f32((dither + u32(column) * 0x9e3779b9u) >> 8u) * (1.0 / 16777216.0);
}

// The row that takes a column's part of a segment: one of the two beside it, dithered from column to column, so that the mean over
// columns and passes lies on the segment. Host twin: pass::motion_blur::reference::Dither::row.
fn row_of(column: i32, slope: f32, dither: u32) -> i32 {
    return i32(floor(f32(column) * slope + dither_of(column, dither)));
}

// Time, as a share, that the source of a segment spends on the pixel at an offset from it.
fn time_on(segment: Segment, offset: vec2<i32>, dither: u32) -> f32 {
    let place = select(offset.yx, offset, segment.wide);
    return select(0.0, share_of(f32(place.x), segment), row_of(place.x, segment.slope, dither) == place.y);
}
