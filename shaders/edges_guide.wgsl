// Keeps the first hits of eye rays. See pass/edges.rs.
#include "frame.wgsl"

@group(0) @binding(1) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> first_hits: array<vec2<u32>>;   // triangle (all ones: none), bits of t

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let hit = hits[pixel];
    first_hits[pixel] = vec2<u32>(bitcast<u32>(hit.w), bitcast<u32>(hit.x));
}
