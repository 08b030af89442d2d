// Compensated summation (Kahan 1965). Needs frame.wgsl.

// Optimisation barrier: returns v, but no compiler can prove it. Otherwise (a + b) - a may become b, and the compensation zero.
fn opaque(v: vec4<f32>) -> vec4<f32> {
    return bitcast<vec4<f32>>(bitcast<vec4<u32>>(v) ^ vec4<u32>(frame.scene.w));
}

struct CompensatedSum {
    sum: vec4<f32>,
    rest: vec4<f32>,        // compensation: the exact sum is about sum - rest
}

fn sum_with(s: CompensatedSum, v: vec4<f32>) -> CompensatedSum {
    let y = v - s.rest;
    let t = opaque(s.sum + y);
    return CompensatedSum(t, (t - s.sum) - y);
}
