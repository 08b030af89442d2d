// Writes a ray towards a near emitter for each shading point that has one. See pass/near_aim.rs.
// HITS: of the hits of near rays that are lit. GATHER: of those from which gather rays leave; GAPS: listed in screen order.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "near.wgsl"
#include "emitters.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_kd: array<vec4<f32>>;
#if HITS
@group(0) @binding(13) var<storage, read> point_f0: array<vec4<f32>>;
#else
#if GATHER
@group(0) @binding(14) var<storage, read> steps: array<Step>;
#else
@group(0) @binding(7) var<storage, read> point_wo: array<vec4<f32>>;
#endif
#endif
@group(0) @binding(8) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(9) var<storage, read_write> ray_origin: array<vec4<f32>>;
// w: irradiance by a radiance of 1 from there.
@group(0) @binding(10) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(12) var<storage, read_write> work_out: DispatchCounts;
#include "aim.wgsl"
#if GATHER
#include "gather.wgsl"
var<immediate> push: Push;
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
#if GAPS
    // A list in screen order has gaps.
    if place >= max(atomicLoad(&work.live), work.total) || aim_emitters() == 0u {
        return;
    }
    let slot = list[place];
    if slot == NO_POINT {
        return;
    }
#else
    if place >= atomicLoad(&work.live) || aim_emitters() == 0u {
        return;
    }
    let slot = list[place];
#endif
    let kd = point_kd[slot];
#if HITS
    let reach = NEAR_CLOSER * frame.up.w;
    let point = near_hit_point(slot);
    let has_light = is_matte(kd.xyz, point_f0[slot].xyz) && frame.scene.z > 3u;
#else
    let reach = frame.up.w;
    let has_light = mean3(kd.xyz) > 0.0;
#if GATHER
    let step = steps[push.step];
    let point = gather_point(slot, step.bounce, STREAM_AIM);
#else
    let point = near_aim_point(slot);
#endif
#endif
    let position = point_position[slot].xyz;
    let normal = point_shading[slot].xyz;
    // One number chooses among the emitters, and is stretched each time.
    var along = point.x;
    var total = 0.0;
    var chosen = Aim();
    for (var i = 0u; i < aim_emitters(); i += 1u) {
        let aim = aim_at(i, position, normal, reach);
        let before = total;
        total += aim.weight;
        let at = along * total;
        if aim.weight > 0.0 && at >= before {
            chosen = aim;
            along = (at - before) / aim.weight;
        } else if aim.weight > 0.0 {
            along = at / before;
        }
    }
    if total <= 0.0 || !has_light {
        return;
    }
    let wi = aim_direction(chosen, min(along, ONE_MINUS_EPSILON), point.y);
    let cosine = dot(wi, normal);
    let above = cosine > 0.0 && dot(wi, point_geometric[slot].xyz) > 0.0;
    let by_aim = aimed_density(position, normal, reach, wi);
#if HITS
    let weights = onward_weights(cosine, by_aim);
#else
#if GATHER
    let survival = gather_survival(kd.xyz / max(kd.w, 1e-6), step.bounce);
    let weights = gather_weights(kd.w, survival, cosine, by_aim);
#else
    let weights = near_weights(slot, kd.w, point_wo[slot].w, cosine, by_aim);
#endif
#endif
    if !above || weights.aimed <= 0.0 {
        return;
    }
    ray_origin[slot] = vec4<f32>(position, reach);
    ray_direction[slot] = vec4<f32>(wi, cosine * weights.aimed);
    list_out[atomicAdd(&work_out.live, 1u)] = slot;
}
