// Turns contributions and powers into the distribution by which particles choose emitters. See pass/importance.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "stretches.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> contributions: array<f32>;
@group(0) @binding(3) var<storage, read_write> chosen: array<EmitterRecord>;

var<workgroup> sums: array<f32, 64>;

// Sum over the lanes before `end`, in order.
fn sum_to(end: u32) -> f32 {
    var sum = 0.0;
    for (var k = 0u; k < end; k += 1u) {
        sum += sums[k];
    }
    return sum;
}

// Share of an emitter before normalisation.
fn mixed(i: u32, total: f32) -> f32 {
    let by_power = emitters[i].normal.w;
    let by_contribution = select(by_power, contributions[i] / max(total, 1e-37), total > 0.0);
    return frame.choice.x * by_power + (1.0 - frame.choice.x) * by_contribution;
}

// Upper end of the interval of emitter i. Emitters that the distribution by power never chooses stay out.
fn upper_end(i: u32, sum: f32, whole: f32) -> f32 {
    return select(min(sum / whole, 1.0), 1.0, emitters[i].radiance.w >= 1.0);
}

@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    let count = frame.scene.y;
    let stretch = stretch_of(lane, count);

    var partial = 0.0;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        partial += contributions[i];
    }
    sums[lane] = partial;
    workgroupBarrier();
    let total = sum_to(64u);
    workgroupBarrier();

    partial = 0.0;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        partial += mixed(i, total);
    }
    sums[lane] = partial;
    workgroupBarrier();
    let base = sum_to(lane);
    let whole = sum_to(64u);

    var lower = 0.0;
    if stretch.first > 0u {
        lower = upper_end(stretch.first - 1u, base, whole);
    }
    partial = 0.0;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        partial += mixed(i, total);
        let upper = upper_end(i, base + partial, whole);
        var e = emitters[i];
        let power = e.flux.xyz * e.normal.w;
        let probability = upper - lower;
        e.flux = vec4<f32>(select(vec3<f32>(0.0), power / probability, probability > 0.0), e.flux.w);
        e.normal.w = probability;
        e.radiance.w = upper;
        chosen[i] = e;
        lower = upper;
    }
}
