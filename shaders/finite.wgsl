// Counts the pixels whose values are no numbers, so that the sums leave the pass out. See pass/finite.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "addends.wgsl"
#include "left_out.wgsl"

@group(0) @binding(1) var<storage, read_write> status: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> shown: array<vec4<f32>>;  // light of second components, or `emitted` again

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let added = addends_of(pixel);
    let color = max(magnitude(added.color), magnitude(vec4<f32>(shown[pixel].xyz, 0.0)));
    let light = max(magnitude(added.direct), magnitude(vec4<f32>(added.indirect, 0.0)));
    let guides = max(magnitude(vec4<f32>(added.albedo, 0.0)), magnitude(vec4<f32>(added.normal, 0.0)));
    // A loop, because SIMD processors run both sides of a branch: these atomics cost more than all the rest, and are hardly ever needed.
    for (var bad = select(0u, 1u, max(max(color, light), guides) >= LIMIT); bad > 0u; bad -= 1u) {
        atomicAdd(&status[1], 1u);
        atomicMax(&status[2], pixel + 1u);
    }
}
