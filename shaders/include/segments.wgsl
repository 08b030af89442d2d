// Segments that points cover in the image while the shutter is open. See pass/motion_blur.rs.

// A source is in front of a pixel if its depth is less by more than this share. Host twin: pass::motion_blur::DEPTH_TOLERANCE.
const DEPTH_TOLERANCE: f32 = 0.01;

// Columns of a segment: `along` counts them along its longer side, `middle` is where the segment is in the middle of the part of it that
// lies in a column, `share` is that part.
struct Column {
    share: f32,
    middle: f32,
}

fn column_of(along: f32, major: f32) -> Column {
    let length = max(abs(major), 1.0);
    let low = max(along - 0.5, -0.5 * length);
    let high = min(along + 0.5, 0.5 * length);
    return Column(max(high - low, 0.0) / length, 0.5 * (low + high));
}

// Slope of a segment against its longer side.
fn slope_of(major: f32, minor: f32) -> f32 {
    return minor / select(1.0, major, abs(major) > 1.0);
}

// Time, as a share, that a source of velocity v spends on the pixel at an offset from it; the same in both directions.
fn time_on(v: vec2<f32>, offset: vec2<f32>) -> f32 {
    let wide = abs(v.x) >= abs(v.y);
    let axes = select(v.yx, v, wide);
    let place = select(offset.yx, offset, wide);
    let column = column_of(place.x, axes.x);
    let apart = abs(place.y - column.middle * slope_of(axes.x, axes.y));
    return column.share * max(1.0 - apart, 0.0);
}
