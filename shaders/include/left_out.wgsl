// Passes that the sums leave out, and values that no sum may meet. CPU twin: pass::finite::reference. Needs the frame's status bound as
// `status`: [0] rays lost, [1] pixels whose values are no numbers, [2] 1 + the last of these pixels.

// Bits of 2^100. Sums of all the passes that a counter can count stay finite below it. Host twin: pass::finite::LIMIT.
const LIMIT: u32 = 0x71800000u;

// Bits of the largest magnitude: unlike comparisons of floats, those of their bits may not be compiled as if there were no NaN.
fn magnitude(v: vec4<f32>) -> u32 {
    let bits = bitcast<vec4<u32>>(v) & vec4<u32>(0x7fffffffu);
    return max(max(bits.x, bits.y), max(bits.z, bits.w));
}

// Zero in place of a vector that is no number.
fn if_number(v: vec3<f32>) -> vec3<f32> {
    return select(vec3<f32>(0.0), v, magnitude(vec4<f32>(v, 0.0)) < LIMIT);
}
