// Lights without area are chosen for a pass, for each class of pixels so many. See pass/delta_choice.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "lights.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> candidates: array<PointLight>;
@group(0) @binding(3) var<storage, read> candidate_emitters: array<u32>;
@group(0) @binding(4) var<storage, read_write> lights: array<PointLight>;

// Probability 1; a light of probability 1 takes a whole slot.
const ONE: u32 = 1u << 20u;
// After so many rounds lights that may still rise to probability 1 stay below it.
const ROUNDS: u32 = 16u;

// Each lane has a run of candidates, one after the other.
var<workgroup> sums: array<vec2<f32>, 64>;
var<workgroup> shares: array<u32, 64>;

fn weight_of(i: u32) -> f32 {
    return emitters[candidate_emitters[i]].normal.w;
}

// Probability of candidate i in units of 1 / ONE. No light is without, whatever the rounding.
fn share_of(i: u32, scale: f32) -> u32 {
    return 1u + u32(min(scale * weight_of(i), f32(ONE - 1u)));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let class_number = group.x;
    let slots = frame.walk.w;
    let count = arrayLength(&candidate_emitters);
    let run = (count + 63u) / 64u;
    let first = min(lane * run, count);
    let end = min(first + run, count);
    let first_slot = class_number * frame.pattern.w;

    // Slots that nobody takes send nothing.
    for (var k = lane; k < slots; k += 64u) {
        lights[first_slot + k] = PointLight(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0));
    }

    // The scale at which the shares fill the slots, a little less for the rounding of the sums. Each share may be rounded up by 1.
    let room = slots * ONE - count;
    var scale = 0.0;
    for (var round = 0u; round < ROUNDS; round += 1u) {
        // Weights below probability 1, number of those at it.
        var partial = vec2<f32>(0.0);
        for (var i = first; i < end; i += 1u) {
            let weight = weight_of(i);
            partial += select(vec2<f32>(weight, 0.0), vec2<f32>(0.0, 1.0), scale * weight >= f32(ONE));
        }
        sums[lane] = partial;
        workgroupBarrier();
        var whole = vec2<f32>(0.0);
        for (var k = 0u; k < 64u; k += 1u) {
            whole += sums[k];
        }
        workgroupBarrier();
        // Those at probability 1 were scaled to fit into the slots with others, so they are fewer.
        let left = f32(room - ONE * u32(whole.y)) * (1.0 - 1.0 / 1024.0);
        scale = select(scale, max(scale, left / whole.x), whole.x > 0.0);
    }

    var share_sum = 0u;
    for (var i = first; i < end; i += 1u) {
        share_sum += share_of(i, scale);
    }
    shares[lane] = share_sum;
    storageBarrier();
    workgroupBarrier();
    var lower = 0u;
    for (var k = 0u; k < lane; k += 1u) {
        lower += shares[k];
    }

    // The shares stand one after the other, and the light is chosen in whose share a point lies; the points are one apart.
    let start = hash(key(frame.keys.y, STREAM_DELTA, 0u, 0u));
    let turn = start + frame.size.w * 0x9e3779b9u + class_number * (0xffffffffu / frame.pattern.z);
    let offset = turn >> 12u;
    for (var i = first; i < end; i += 1u) {
        let share = share_of(i, scale);
        let slot = (lower + ONE - 1u - offset) / ONE;
        if slot * ONE + offset < lower + share {
            var light = candidates[i];
            light.emit = vec4<f32>(light.emit.xyz * (f32(ONE) / f32(share)), light.emit.w);
            lights[first_slot + slot] = light;
        }
        lower += share;
    }
}
