// One pass's image added to the running sums. See pass/accumulate.rs.
#include "frame.wgsl"
#include "math.wgsl"

@group(0) @binding(1) var<storage, read> status: array<u32>;
@group(0) @binding(2) var<storage, read> receiver_position: array<vec4<f32>>;
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
@group(0) @binding(20) var<storage, read> throughput: array<vec4<f32>>; // of mirrors and glass before the receiver; w: depth

// The value itself, past what a compiler knows of it: it takes (a + b) - a for b otherwise, and the compensation for nothing.
fn opaque(v: vec4<f32>) -> vec4<f32> {
    return bitcast<vec4<f32>>(bitcast<vec4<u32>>(v) ^ vec4<u32>(frame.scene.w));
}

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
    let hit = select(0.0, 1.0, through.w >= 0.0);
    let ends = select(0.0, 1.0, receiver_position[pixel].w >= 0.0);
    let lit = receiver_wo[pixel].w > 0.0;
    let zero = vec3<f32>(0.0);
    let e_direct = select(zero, direct[pixel].xyz, lit);
    let e_indirect = select(zero, indirect[pixel].xyz, lit);
    let l_specular = select(zero, specular[pixel].xyz, lit);
    let kd = receiver_kd[pixel].xyz;
    let color = emitted[pixel].xyz + through.xyz * (kd * INV_PI * (e_direct + e_indirect) + l_specular);

    // Compensated sums (Kahan): `rest` is what rounding took from the sum.
    let y0 = vec4<f32>(color, hit) - rest_color[pixel];
    let t0 = opaque(sum_color[pixel] + y0);
    rest_color[pixel] = (t0 - sum_color[pixel]) - y0;
    sum_color[pixel] = t0;
    let y1 = vec4<f32>(e_direct, 0.0) - rest_direct[pixel];
    let t1 = opaque(sum_direct[pixel] + y1);
    rest_direct[pixel] = (t1 - sum_direct[pixel]) - y1;
    sum_direct[pixel] = t1;
    let y2 = vec4<f32>(e_indirect, 0.0) - rest_indirect[pixel];
    let t2 = opaque(sum_indirect[pixel] + y2);
    rest_indirect[pixel] = (t2 - sum_indirect[pixel]) - y2;
    sum_indirect[pixel] = t2;
    // Guides for filters; plain sums are exact enough.
    sum_albedo[pixel] += vec4<f32>(through.xyz * (kd + receiver_f0[pixel].xyz), hit);
    sum_normal[pixel] += vec4<f32>(ends * receiver_shading[pixel].xyz, hit * through.w);
}
