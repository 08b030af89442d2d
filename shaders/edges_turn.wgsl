// Reflects the rays at edges that met a flat mirror. See pass/edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "camera.wgsl"
#include "edges.wgsl"

@group(0) @binding(9) var<storage, read> list: array<u32>;
@group(0) @binding(10) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(11) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> mirror_hits: array<vec2<u32>>;  // of each ray: triangle (NO_MIRROR: none), bits of t
@group(0) @binding(15) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(16) var<storage, read_write> work_out: DispatchCounts;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= atomicLoad(&work.live) {
        return;
    }
    let ray = list[index];
    let hit = hits[ray];
    let triangle = bitcast<u32>(hit.w);
    let turns = is_plain_mirror(triangle);
    mirror_hits[ray] = select(vec2<u32>(NO_MIRROR, 0u), vec2<u32>(triangle, bitcast<u32>(hit.x)), turns);
    // Zero times for most rays.
    for (var i = select(0u, 1u, turns); i > 0u; i -= 1u) {
        let d = ray_direction[ray].xyz;
        let normal = first_hit(triangle, hit.x, EyeRay(vec3<f32>(0.0), d)).normal;
        let position = triangle_v0[triangle].xyz + hit.y * triangle_e1[triangle].xyz + hit.z * triangle_e2[triangle].xyz;
        ray_origin[ray] = vec4<f32>(offset_origin(position, normal, frame.eye.w), 3.0e38);
        ray_direction[ray] = vec4<f32>(mirrored_direction(d, normal), 0.0);
        list_out[atomicAdd(&work_out.live, 1u)] = ray;
    }
}
