// Adds the image of one pass to the film. See pass/accumulate.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "exact_sum.wgsl"

@group(0) @binding(1) var<storage, read> status: array<u32>;
@group(0) @binding(3) var<storage, read> receiver_shading: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> receiver_kd: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> receiver_f0: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> receiver_wo: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> sum_color: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> rest_color: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> sum_direct: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> rest_direct: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> sum_indirect: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> rest_indirect: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> sum_albedo: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> sum_normal: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read_write> counts: array<u32>;     // passes in the sums of each instance
@group(0) @binding(21) var<storage, read_write> tail_color: array<vec4<f32>>;
@group(0) @binding(22) var<storage, read_write> tail_direct: array<vec4<f32>>;
@group(0) @binding(23) var<storage, read_write> tail_indirect: array<vec4<f32>>;
@group(0) @binding(24) var<storage, read_write> rest_albedo: array<vec4<f32>>;
@group(0) @binding(25) var<storage, read_write> rest_normal: array<vec4<f32>>;
@group(0) @binding(20) var<storage, read> throughput: array<vec4<f32>>; // of mirrors and glass before the receiver; w: depth

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    // A pass with lost rays leaves no trace; the host reports it or repeats it with more rounds.
    if pixel >= frame.size.z || status[0] != 0u {
        return;
    }
    if pixel == 0u {
        counts[frame.keys.w] += 1u;
    }
    let through = throughput[pixel];
    let flags = receiver_wo[pixel].w;
    let hit = select(0.0, 1.0, has_flag(flags, COVERED));
    let ends = select(0.0, 1.0, has_flag(flags, HIT));
    let light = lighting_of(pixel);
    let kd = receiver_kd[pixel].xyz;
    let radiance = emitted[pixel].xyz + through.xyz * reflected_radiance(kd, light);

    let color = sum_with(ExactSum(sum_color[pixel], rest_color[pixel], tail_color[pixel]), vec4<f32>(radiance, hit));
    sum_color[pixel] = color.high;
    rest_color[pixel] = color.middle;
    tail_color[pixel] = color.low;
    let e_direct = sum_with(ExactSum(sum_direct[pixel], rest_direct[pixel], tail_direct[pixel]), vec4<f32>(light.e_direct, 0.0));
    sum_direct[pixel] = e_direct.high;
    rest_direct[pixel] = e_direct.middle;
    tail_direct[pixel] = e_direct.low;
    let e_indirect = sum_with(ExactSum(sum_indirect[pixel], rest_indirect[pixel], tail_indirect[pixel]), vec4<f32>(light.e_indirect, 0.0));
    sum_indirect[pixel] = e_indirect.high;
    rest_indirect[pixel] = e_indirect.middle;
    tail_indirect[pixel] = e_indirect.low;
    // Guides for filters, in units far below what they are good for; the depth's is that of ray origins.
    let unit = 1.0 / 4194304.0;
    let albedo = in_units(vec4<f32>(through.xyz * (kd + receiver_f0[pixel].xyz), hit), vec4<f32>(unit));
    let normal = in_units(vec4<f32>(ends * receiver_shading[pixel].xyz, hit * through.w), vec4<f32>(vec3<f32>(unit), frame.lens.z));
    let sum_a = sum_of_units(RoundedSum(sum_albedo[pixel], rest_albedo[pixel]), albedo);
    sum_albedo[pixel] = sum_a.sum;
    rest_albedo[pixel] = sum_a.error;
    let sum_n = sum_of_units(RoundedSum(sum_normal[pixel], rest_normal[pixel]), normal);
    sum_normal[pixel] = sum_n.sum;
    rest_normal[pixel] = sum_n.error;
}
