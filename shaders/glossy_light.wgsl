// Adds the light of paths along lobes to the specular radiance of their pixels. See pass/glossy_light.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"

@group(0) @binding(1) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> specular: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(9) var<storage, read> tiles: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let word = point_wo[pixel].w;
    if !has_flag(word, LOBE_SAMPLED) || has_flag(word, SEEN_BY_SPECULAR) {
        return;
    }
    let slot = pixel + frame.size.z;
    let through = throughput[slot];
    specular[pixel] += vec4<f32>(emitted[slot].xyz + through.xyz * reflected_radiance(point_kd[slot].xyz, lighting_of(slot)), 0.0);
    // `merge` must not add it again.
    throughput[slot] = vec4<f32>(0.0, 0.0, 0.0, through.w);
    emitted[slot] = vec4<f32>(0.0);
}
