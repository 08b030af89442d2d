// Sums and minima over a workgroup of 64, for all of its invocations.
var<workgroup> parts: array<vec4<f32>, 64>;

fn sum_of_all(part: vec4<f32>, lane: u32) -> vec4<f32> {
    parts[lane] = part;
    workgroupBarrier();
    for (var half = 32u; half > 0u; half >>= 1u) {
        if lane < half {
            parts[lane] += parts[lane + half];
        }
        workgroupBarrier();
    }
    let sum = parts[0];
    workgroupBarrier();
    return sum;
}

fn least_of_all(part: vec3<f32>, lane: u32) -> vec3<f32> {
    parts[lane] = vec4<f32>(part, 0.0);
    workgroupBarrier();
    for (var half = 32u; half > 0u; half >>= 1u) {
        if lane < half {
            parts[lane] = min(parts[lane], parts[lane + half]);
        }
        workgroupBarrier();
    }
    let least = parts[0].xyz;
    workgroupBarrier();
    return least;
}
