// Adds near light to the light of its pixels. See pass/near_collect.rs.
#include "work.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> list: array<u32>;
@group(0) @binding(2) var<storage, read> near_direct: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> near_indirect: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> specular: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[place];
    let near = near_direct[slot];
    let more = near_indirect[slot].xyz;
    // Light through the specular lobe is radiance.
    if near.w == 0.0 {
        direct[slot] += vec4<f32>(near.xyz, 0.0);
        indirect[slot] += vec4<f32>(more, 0.0);
    } else {
        specular[slot] += vec4<f32>(near.xyz + more, 0.0);
    }
}
