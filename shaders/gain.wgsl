// Sums the radiance that the filter adds to each pixel. See pass/gain.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "raw_lighting.wgsl"
#include "exact_sum.wgsl"
#include "left_out.wgsl"

@group(0) @binding(1) var<storage, read> status: array<u32>;
@group(0) @binding(2) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> raw_direct: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> raw_indirect: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> raw_specular: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> path_gain: array<vec4<f32>>;   // by second components and edge rays
@group(0) @binding(12) var<storage, read_write> sum_gain: array<vec4<f32>>; // w: squares
@group(0) @binding(13) var<storage, read_write> rest_gain: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> tail_gain: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let own = diffuse_radiance(point_kd[pixel].xyz, gained_irradiance(pixel)) + gained_specular(pixel);
    let found = throughput[pixel].xyz * own + path_gain[pixel].xyz;
    path_gain[pixel] = vec4<f32>(0.0);
    if (status[0] | status[1]) != 0u {
        return;
    }
    // The light before the filter may be no number where that after it is one.
    let gain = if_number(found);
    // Bounded by 2^50, whose square is the limit.
    let grey = clamp(mean3(gain), -1125899906842624.0, 1125899906842624.0);
    let sum = sum_with(sum_gain[pixel], rest_gain[pixel], vec4<f32>(gain, grey * grey));
    sum_gain[pixel] = sum.high;
    rest_gain[pixel] = sum.middle;
    if any(sum.error != vec4<f32>(0.0)) {
        tail_gain[pixel] += sum.error;
    }
}
