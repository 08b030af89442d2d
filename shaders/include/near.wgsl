// Near rays. Needs frame.wgsl. Host twin: pass::near_points.

// Each pass sends near rays from a third of the classes of pixels, others in the next passes.
fn near_classes() -> u32 {
    return (frame.pattern.z + 2u) / 3u;
}

fn has_near_ray(slot: u32) -> bool {
    let turn = (2u * frame.size.w + frame.keys.w) % frame.pattern.z;
    return (class_of(slot) + turn * near_classes()) % frame.pattern.z < near_classes();
}

// Number of pixels that a near ray stands for.
fn near_ray_weight() -> f32 {
    return f32(frame.pattern.z) / f32(near_classes());
}

// Search for the pixel that shows a point.
const NEAR_COSINE: f32 = 0.9;   // of the angle between the two normals, at least
const NEAR_HEIGHT: f32 = 1.0;   // distance from the pixel's tangent plane, at most, in widths of a pixel
const NEAR_WIDTH: f32 = 2.0;    // distance between the points, at most, in widths of a pixel on the surface
const NEAR_MATTE: f32 = 0.5;    // kd over f0, at least

// Maximum number of near rays in a row.
const NEAR_LINKS: u32 = 3u;
