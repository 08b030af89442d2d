// Writes one short ray from each shading point, to gather the light that clipping removes. See pass/gather.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "point.wgsl"
#include "near.wgsl"
#include "gather.wgsl"
#include "emitters.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> steps: array<Step>;
@group(0) @binding(4) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> beta: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> ray_direction: array<vec4<f32>>;
#if GAPS
@group(0) @binding(13) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(14) var<storage, read_write> work_out: DispatchCounts;
#endif
@group(0) @binding(15) var<storage, read> emitters: array<EmitterRecord>;
#include "aim.wgsl"
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let place = (group.x + group.y * groups.x) * 64u + lane;
#if GAPS
    // A list in screen order has gaps.
    if place >= max(atomicLoad(&work.live), work.total) {
        return;
    }
    let slot = list[place];
    if slot == NO_POINT {
        return;
    }
#if NEAR
    if !has_near_ray(slot, point_wo[slot].w) {
        return;
    }
#endif
    list_out[atomicAdd(&work_out.live, 1u)] = slot;
#else
    if place >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[place];
#endif
    let geometric = point_geometric[slot];
    let shading = point_shading[slot];
    let kd = point_kd[slot];
    let f0 = point_f0[slot];
    let wo_flags = point_wo[slot];
    let wo = wo_flags.xyz;
    let sample = sample_of(slot);
#if NEAR
    let point = near_point(slot);
#else
    let point = gather_point(slot, step.bounce, STREAM_GATHER);
#endif
    let u = point.x;
    let v = point.y;
    // A pseudo-random number chooses the lobe.
    let lobe = random(key(frame.keys.x, STREAM_GATHER_LOBE, sample, step.bounce));

    let r = Reflectance(kd.xyz, geometric.w, f0.xyz, shading.w);
    let diffuse = lobe < kd.w;
    let s = sample_lobe(r, diffuse, kd.w, shading.xyz, wo, u, v);
    let above = dot(s.wi, geometric.xyz) > 0.0 && dot(s.wi, shading.xyz) > 0.0;
    var weight = select(vec3<f32>(0.0), s.weight, above);
    // The path starts here at the first bounce.
    let first = step.bounce == 0u;
    let before = select(beta[slot], vec4<f32>(1.0, 1.0, 1.0, 0.0), first);
    // Light that the first shading point reflects diffusely is kept as irradiance: pi times radiance, without the albedo.
    let irradiance = vec3<f32>(select(0.0, PI / max(kd.w, 1e-6), above));
    weight = select(weight, irradiance, first && diffuse);
#if NEAR
    weight *= near_ray_weight(slot, wo_flags.w);
#endif
    let survival = gather_survival(weight, step.bounce);
    let dies = random(key(frame.keys.x, STREAM_GATHER_ROULETTE, sample, step.bounce)) >= survival;
    weight = select(weight / max(survival, 1e-6), vec3<f32>(0.0), dies);
    beta[slot] = vec4<f32>(before.xyz * weight, select(before.w, select(1.0, 0.0, diffuse), first));
    let reach = select(0.0, frame.up.w, above && !dies && (mean3(kd.xyz) > 0.0 || !diffuse));
    let position = point_position[slot].xyz;
    ray_origin[slot] = vec4<f32>(position, reach);
    // Of the light of an emitter the share that rays aimed at it leave to this one.
    var of_emitters = 1.0;
    if diffuse && reach > 0.0 {
        let by_aim = aimed_density(position, shading.xyz, reach, s.wi);
        let cosine = dot(s.wi, shading.xyz);
#if NEAR
        of_emitters = near_weights(slot, kd.w, wo_flags.w, cosine, by_aim).along_lobe;
#else
        of_emitters = gather_weights(kd.w, survival, cosine, by_aim).along_lobe;
#endif
    }
    ray_direction[slot] = vec4<f32>(s.wi, of_emitters);
}
