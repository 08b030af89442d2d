// Sums that lose nothing to rounding, so that their order does not matter: two sums of disjoint passes add up to that of all.
// Needs frame.wgsl. CPU twin: film::ExactSum.

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

// high + middle + low is the sum. Exact as long as the addends of a component span less than about 2^40.
struct ExactSum {
    high: vec4<f32>,
    middle: vec4<f32>,
    low: vec4<f32>,
}

fn sum_with(s: ExactSum, v: vec4<f32>) -> ExactSum {
    let high = two_sum(s.high, v);
    let middle = two_sum(s.middle, high.error);
    return ExactSum(high.sum, middle.sum, s.low + middle.error);
}

// The same with two floats, for addends that are multiples of a unit and less than 2^24 of them: exact up to 2^47 units.
fn sum_of_units(s: RoundedSum, v: vec4<f32>) -> RoundedSum {
    let high = two_sum(s.sum, v);
    return two_sum(high.sum, s.error + high.error);
}

// v rounded to multiples of `unit`, a power of two.
fn in_units(v: vec4<f32>, unit: vec4<f32>) -> vec4<f32> {
    return round(v / unit) * unit;
}
