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
#if SUMMANDS
@group(0) @binding(11) var<storage, read> shown: array<vec4<f32>>;  // light of second components
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    // Lanes beyond the image look at its last pixel: after a return SIMD processors would read lane by lane.
    let at = min(pixel, frame.size.z - 1u);
    let added = addends_of(at);
    var largest = max(magnitude(added.color), max(magnitude(added.direct), magnitude(vec4<f32>(added.indirect, 0.0))));
#if SUMMANDS
    largest = max(largest, magnitude(vec4<f32>(shown[at].xyz, 0.0)));
#endif
    // A loop, because SIMD processors run both sides of a branch: these atomics cost more than all the rest, and are hardly ever needed.
    let is_bad = pixel < frame.size.z && largest >= LIMIT;
    for (var bad = select(0u, 1u, is_bad); bad > 0u; bad -= 1u) {
        atomicAdd(&status[1], 1u);
        atomicMax(&status[2], pixel + 1u);
    }
}
