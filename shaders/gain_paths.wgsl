// Radiance that the filter adds to pixels by their second components. See pass/gain.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "raw_lighting.wgsl"

@group(0) @binding(1) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> raw_direct: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> raw_indirect: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> raw_specular: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(11) var<storage, read> tiles: array<u32>;
@group(0) @binding(12) var<storage, read> region: array<u32>;
@group(0) @binding(13) var<storage, read_write> path_gain: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    // Mirror images are spread over their planes, and their gain with them.
    let mirrors = frame.superposition.x > 0u;
    if mirrors && region[select(0u, pixel, mirrors)] != 0u {
        return;
    }
    let slot = pixel + frame.size.z;
    let gain = throughput[slot].xyz * diffuse_radiance(point_kd[slot].xyz, gained_irradiance(slot));
    path_gain[pixel] = vec4<f32>(gain, 0.0);
}
