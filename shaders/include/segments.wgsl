// Segments that points cover in the image while the shutter is open. See pass/motion_blur.rs.

// A source is in front of a pixel if its depth is less by more than this share. Host twin: pass::motion_blur::DEPTH_TOLERANCE.
const DEPTH_TOLERANCE: f32 = 0.01;

// Sources of less depth are in front of a pixel of this one.
fn depth_in_front(depth: f32) -> f32 {
    return depth - abs(depth) * DEPTH_TOLERANCE;
}

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

// The pixels of the image on a segment: of column m that of number origin + m * along + row * across.
struct Line {
    origin: i32,
    along: i32,
    across: i32,
    columns: vec2<i32>,     // first and last that lie in the image and in the segment
    rows: vec2<i32>,        // first and last that lie in the image
}

// `sign`: 1, or -1 for a segment turned round its middle, the pixels whose sources reach this one.
fn line_of(at: vec2<i32>, segment: Segment, sign: i32) -> Line {
    let size = vec2<i32>(frame.size.xy);
    let last = size - 1 - at;
    // Offsets that stay in the image, in both directions.
    let low = select(-last, -at, sign > 0);
    let high = select(at, last, sign > 0);
    let reach = i32(segment.half + 0.5);
    var line: Line;
    line.origin = at.y * size.x + at.x;
    line.along = sign * select(size.x, 1, segment.wide);
    line.across = sign * select(1, size.x, segment.wide);
    line.columns = clamp(vec2<i32>(-reach, reach), vec2<i32>(select(low.y, low.x, segment.wide)), vec2<i32>(select(high.y, high.x, segment.wide)));
    line.rows = vec2<i32>(select(low.x, low.y, segment.wide), select(high.x, high.y, segment.wide));
    return line;
}
