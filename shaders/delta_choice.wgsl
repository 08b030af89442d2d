// Chooses a number of lights without area for each class of pixels. See pass/delta_choice.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "lights.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> candidates: array<PointLight>;
@group(0) @binding(3) var<storage, read> candidate_emitters: array<u32>;
@group(0) @binding(4) var<storage, read_write> lights: array<PointLight>;

fn weight_of(i: u32) -> f32 {
    return emitters[candidate_emitters[i]].normal.w;
}

#include "systematic.wgsl"

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let class_number = group.x;
    let slots = frame.walk.w;
    let count = arrayLength(&candidate_emitters);
    let stretch = stretch_of(lane, count);
    let first_slot = class_number * frame.pattern.w;

    // Slots that no light takes emit nothing.
    for (var k = lane; k < slots; k += 64u) {
        lights[first_slot + k] = PointLight(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0));
    }

    let scale = scale_of(lane, stretch, count, slots);
    var share_sum = 0u;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        share_sum += share_of(weight_of(i), scale);
    }
    storageBarrier();
    var begin = sum_before(lane, share_sum);
    let offset = offset_of(STREAM_DELTA, class_number);
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        let share = share_of(weight_of(i), scale);
        let slot = slot_at(begin, offset);
        if slot * ONE + offset < begin + share {
            var light = candidates[i];
            light.emit = vec4<f32>(light.emit.xyz * (f32(ONE) / f32(share)), light.emit.w);
            lights[first_slot + slot] = light;
        }
        begin += share;
    }
}
