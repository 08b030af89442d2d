// Rays through points of the image. Needs frame.wgsl.

// An eye ray. All rays of a perspective camera start at the eye, those of an orthographic one are parallel.
struct EyeRay {
    start: vec3<f32>,   // origin less the eye
    d: vec3<f32>,       // direction
}

// The ray through a point of the whole image, in pixels from its upper left corner; its direction has length 1 along the view direction.
fn ray_through(x: f32, y: f32) -> EyeRay {
    let s = 2.0 * x / f32(frame.within.z) - 1.0 + frame.shift.x;
    let t = 1.0 - 2.0 * y / f32(frame.within.w) + frame.shift.y;
    let right = s * frame.right.xyz;
    let up = t * frame.up.xyz;
    let parallel = is_orthographic();
    return EyeRay(select(vec3<f32>(0.0), right + up, parallel), select(frame.forward.xyz + right + up, frame.forward.xyz, parallel));
}
