// Adds the image of one pass to the film. See pass/accumulate.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "exact_sum.wgsl"
#include "addends.wgsl"
#include "left_out.wgsl"

@group(0) @binding(1) var<storage, read> status: array<u32>;
@group(0) @binding(3) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_wo: array<vec4<f32>>;
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
@group(0) @binding(20) var<storage, read> throughput: array<vec4<f32>>; // of mirrors and glass before the shading point; w: depth

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    // A pass that lost rays, or with a value that is no number, leaves no trace; the host repeats it.
    if pixel >= frame.size.z || (status[0] | status[1]) != 0u {
        return;
    }
    if pixel == 0u {
        counts[frame.keys.w] += 1u;
    }
    let added = addends_of(pixel);

    // Layers that a pixel needs once stand where irradiance has no component: coverage after colour, depth after direct.
    let color = sum_with(sum_color[pixel], rest_color[pixel], added.color);
    sum_color[pixel] = color.high;
    rest_color[pixel] = color.middle;
    if any(color.error != vec4<f32>(0.0)) {
        tail_color[pixel] += color.error;
    }
    let e_direct = sum_with(sum_direct[pixel], rest_direct[pixel], added.direct);
    sum_direct[pixel] = e_direct.high;
    rest_direct[pixel] = e_direct.middle;
    if any(e_direct.error != vec4<f32>(0.0)) {
        tail_direct[pixel] += e_direct.error;
    }
    let e_indirect = sum_with(sum_indirect[pixel], rest_indirect[pixel], vec4<f32>(added.indirect, 0.0));
    sum_indirect[pixel] = e_indirect.high;
    rest_indirect[pixel] = e_indirect.middle;
    if any(e_indirect.error != vec4<f32>(0.0)) {
        tail_indirect[pixel] += e_indirect.error;
    }
    // Guides for filters, in units far below what they are good for: for 256 passes one float is exact.
    let albedo = two_sum(sum_albedo[pixel], in_guide_units(if_number(added.albedo)));
    if any(albedo.error != vec4<f32>(0.0)) {
        let whole = two_sum(albedo.sum, rest_albedo[pixel] + albedo.error);
        sum_albedo[pixel] = whole.sum;
        rest_albedo[pixel] = whole.error;
    } else {
        sum_albedo[pixel] = albedo.sum;
    }
    let normal = two_sum(sum_normal[pixel], in_guide_units(if_number(added.normal)));
    if any(normal.error != vec4<f32>(0.0)) {
        let whole = two_sum(normal.sum, rest_normal[pixel] + normal.error);
        sum_normal[pixel] = whole.sum;
        rest_normal[pixel] = whole.error;
    } else {
        sum_normal[pixel] = normal.sum;
    }
}
