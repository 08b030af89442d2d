// Adds the light of second components to their pixels. See pass/merge.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"

@group(0) @binding(1) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(9) var<storage, read> tiles: array<u32>;
@group(0) @binding(10) var<storage, read_write> shown: array<vec4<f32>>;   // may be `emitted`

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let slot = pixel + frame.size.z;
    let l = throughput[slot].xyz * reflected_radiance(point_kd[slot].xyz, lighting_of(slot));
    shown[pixel] += vec4<f32>(emitted[slot].xyz + l, 0.0);
}
