// Rays through points of the image. Needs frame.wgsl.

// Direction towards a point of the whole image, in pixels from its upper left corner; not normalised.
fn towards(x: f32, y: f32) -> vec3<f32> {
    let s = 2.0 * x / f32(frame.within.z) - 1.0 + frame.shift.x;
    let t = 1.0 - 2.0 * y / f32(frame.within.w) + frame.shift.y;
    return frame.forward.xyz + s * frame.right.xyz + t * frame.up.xyz;
}
