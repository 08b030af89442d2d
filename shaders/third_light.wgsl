// Adds the light of third components to the emission of second ones. See pass/third_light.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"

@group(0) @binding(1) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> point_wo: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(9) var<storage, read> tiles: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let second = pixel + frame.size.z;
    let third = second + frame.size.z;
    let l = throughput[third].xyz * reflected_radiance(point_kd[third].xyz, lighting_of(third));
    let found = emitted[third].xyz;
    emitted[second] += vec4<f32>(found + l, 0.0);
    // The lamp that a third component found may be an outlier among the second components.
    if mean3(found) > 0.0 {
        let word = bitcast<u32>(point_wo[second].w);
        point_wo[second].w = bitcast<f32>(word | flag_if(DEEP, has_flag(point_wo[third].w, UNLIKELY | DEEP)));
    }
}
