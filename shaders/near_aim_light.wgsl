// Adds the light that rays towards near emitters found to the direct light of their points. See pass/near_aim.rs.
// HITS: these are hits of near rays.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "flags.wgsl"
#include "near.wgsl"

@group(0) @binding(7) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(8) var<storage, read> list: array<u32>;
@group(0) @binding(9) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> direct: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[index];
    let hit = hits[slot];
    let triangle = bitcast<u32>(hit.w);
    if triangle == 0xffffffffu {
        return;
    }
    let ray = ray_direction[slot];
    let met = surface_at(triangle, hit.y, hit.z, ray.xyz, frame.cones.z * hit.x);
    // The share of light that clipping removed.
#if HITS
    let clip2 = NEAR_CLOSER * NEAR_CLOSER * frame.right.w;
#else
    let clip2 = frame.right.w;
#endif
    let share = max(1.0 - hit.x * hit.x / max(clip2, 1e-37), 0.0);
    direct[slot] += vec4<f32>(ray.w * share * met.emission, 0.0);
}
