// Near rays. Needs frame.wgsl and math.wgsl. Host twin: pass::near_points.

// Each pass sends near rays from a quarter of the classes of pixels, others in the next passes.
fn near_classes() -> u32 {
    return max(frame.pattern.z / 4u, 1u);
}

fn has_near_ray(slot: u32) -> bool {
    let turn = (2u * frame.size.w + frame.keys.w) % frame.pattern.z;
    return (class_of(slot) + turn * near_classes()) % frame.pattern.z < near_classes();
}

// Point that gives the near rays of a class their direction, all the same: a Kronecker sequence over passes and classes, whose
// steps are the powers 1/p and 1/p^2 of the plastic number p (Roberts 2018), in units of 2^-32.
fn near_point(slot: u32) -> vec2<f32> {
    let n = frame.size.w * frame.pattern.z + class_of(slot);
    let start = vec2<u32>(key(frame.keys.y, STREAM_GATHER, 0u, 0u), key(frame.keys.y, STREAM_GATHER, 0u, 1u));
    return unit(n * vec2<u32>(3242174889u, 2447445414u) + start);
}

// Number of pixels that a near ray stands for.
fn near_ray_weight() -> f32 {
    return f32(frame.pattern.z) / f32(near_classes());
}

// Search for the pixel that shows a point.
const NEAR_COSINE: f32 = 0.9;   // of the angle between the two normals, at least
const NEAR_HEIGHT: f32 = 1.0;   // distance from the pixel's tangent plane, at most, in widths of a pixel
const NEAR_WIDTH: f32 = 1.0;    // distance between the points beyond the width of the pattern, at most, in widths of a pixel on the surface
const NEAR_MATTE: f32 = 0.5;    // kd over f0, at least

// Maximum number of near rays in a row.
const NEAR_LINKS: u32 = 3u;
