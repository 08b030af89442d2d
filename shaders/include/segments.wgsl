// Segments that points cover in the image while the shutter is open. See pass/motion_blur.rs.

// A source is in front of a pixel if its depth is less by more than this share. Host twin: pass::motion_blur::DEPTH_TOLERANCE.
const DEPTH_TOLERANCE: f32 = 0.01;

// Part of a segment that lies in a column, counted along its longer side.
fn share_of(column: f32, major: f32) -> f32 {
    let length = max(abs(major), 1.0);
    return max(min(column + 0.5, 0.5 * length) - max(column - 0.5, -0.5 * length), 0.0) / length;
}

// Slope of a segment against its longer side.
fn slope_of(major: f32, minor: f32) -> f32 {
    return minor / select(1.0, major, abs(major) > 1.0);
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

// Time, as a share, that a source of velocity v spends on the pixel at an offset from it.
fn time_on(v: vec2<f32>, offset: vec2<i32>, dither: u32) -> f32 {
    let wide = abs(v.x) >= abs(v.y);
    let axes = select(v.yx, v, wide);
    let place = select(offset.yx, offset, wide);
    let share = share_of(f32(place.x), axes.x);
    return select(0.0, share, row_of(place.x, slope_of(axes.x, axes.y), dither) == place.y);
}
