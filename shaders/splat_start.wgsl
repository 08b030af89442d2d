// Starts the particles of a batch on the emitters. See pass/splat_start.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "emitter_start.wgsl"
#include "splats.wgsl"
#include "splat_numbers.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> flux: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> steps: array<Step>;
@group(0) @binding(6) var<storage, read_write> splat_state: array<u32>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= splat_parameters.particles {
        return;
    }
    let step = steps[push.step];
    let particle = step.first + place;
    if place == 0u {
        splat_state[SPLAT_FIRST] = step.first;
        splat_state[SPLAT_COUNT] = step.end - step.first;
    }
    // The last batch may be smaller; nothing starts once the hits of a batch did not fit.
    let flies = particle < step.end && splat_state[SPLAT_FULL] == 0u;
    let start = start_at(splat_numbers(0u, particle), random(key(frame.keys.y, STREAM_SPLAT_SIDE, particle, 0u)));
    let leave = splat_numbers(1u, particle);
    flux[place] = vec4<f32>(select(vec3<f32>(0.0), start.flux, flies), 0.0);
    ray_origin[place] = vec4<f32>(ray_origin_from(start, leave), select(0.0, 3.0e38, flies));
    ray_direction[place] = vec4<f32>(direction_from(start, leave), 0.0);
}
