// Sums that lose nothing to rounding, so that their order does not matter: two sums of disjoint passes add up to that of all.
// Needs frame.wgsl. CPU twin: pass::accumulate::sum_with.

// Optimisation barrier: returns v, but no compiler can prove it. Otherwise (a + b) - a may become b, and the error of a sum zero.
fn opaque(v: vec4<f32>) -> vec4<f32> {
    return bitcast<vec4<f32>>(bitcast<vec4<u32>>(v) ^ vec4<u32>(frame.scene.w));
}

// A rounded sum and its error: a + b = sum + error exactly (Knuth 1969).
struct RoundedSum {
    sum: vec4<f32>,
    error: vec4<f32>,
}

fn two_sum(a: vec4<f32>, b: vec4<f32>) -> RoundedSum {
    let sum = opaque(a + b);
    let of_b = opaque(sum - a);
    return RoundedSum(sum, (a - (sum - of_b)) + (b - of_b));
}

// A sum in three floats, high + middle + low, plus one more addend. `error` belongs to low, and is zero unless the addends of a
// component span more than about 2^24: low is rarely touched. Exact as long as they span less than about 2^72.
struct ExactSum {
    high: vec4<f32>,
    middle: vec4<f32>,
    error: vec4<f32>,
}

fn sum_with(high: vec4<f32>, middle: vec4<f32>, v: vec4<f32>) -> ExactSum {
    // A product that a compiler adds unrounded here, but not below, would leave a wrong error.
    let upper = two_sum(high, opaque(v));
    let lower = two_sum(middle, upper.error);
    return ExactSum(upper.sum, lower.sum, lower.error);
}

// v rounded to the unit of guides, film::GUIDE_UNIT.
fn in_guide_units(v: vec3<f32>) -> vec4<f32> {
    return vec4<f32>(round(v * 65536.0) / 65536.0, 0.0);
}
