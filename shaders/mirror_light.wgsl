// Lights the shading points that see a mirrored light. See pass/mirror_lights.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "lights.wgsl"
#include "light_at.wgsl"
#include "point.wgsl"
#include "mirror_lights.wgsl"
#include "near.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> steps: array<Step>;
@group(0) @binding(4) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> mirrored: array<PointLight>;
@group(0) @binding(10) var<storage, read> reflectances: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> specular: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> direct: array<vec4<f32>>;
var<immediate> push: Push;

// Host twins: pass::mirror_lights::{MOST, FULL_PASSES}.
const MOST: f32 = 8.0;
const FULL_PASSES: f32 = 4.0;

// Irradiance by a mirrored light at a point that has this much already: a light that few points see stands out.
fn bounded(e: vec3<f32>, already: f32) -> vec3<f32> {
    let weight = select(0.0, min(1.0, FULL_PASSES * frame.shift.w), already > 0.0 && frame.mirrors.w > 1u);
    return e * (1.0 - weight * max(1.0 - MOST * already / max(mean3(e), 1e-30), 0.0));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[place];
    let reflected = reflectances[slot].xyz;
    let free = bitcast<u32>(hits[slot].w) == 0xffffffffu;
    let l = mirrored[mirrored_index(slot, steps[push.step].first)];
    let d = to_light(l.position, l.normal, point_position[slot].xyz);
    let r2 = dot(d, d);
    let wi = d / sqrt(max(r2, 1e-37));
    let shading = point_shading[slot];
    let geometric = point_geometric[slot];
    let falloff = falloff_of(bitcast<u32>(l.position.w), r2);
    let f0 = point_f0[slot];
    let wo = point_wo[slot];
    // Classes of pixels take turns, as those with near rays do.
    let times = max(dot(wi, shading.xyz), 0.0) * falloff * near_ray_weight(slot, wo.w);
    let e = bounded(intensity_of(l, wi) * reflected * times, mean3(direct[slot].xyz + indirect[slot].xyz));
    let lobe = point_lobe(geometric, shading, f0);
    let seen = free && mean3(reflected) > 0.0;
    // A path along the lobe brings the light of surfaces, but meets no light without area.
    let glossy = has_flag(wo.w, GLOSSY) && !has_flag(wo.w, SPLATS) && !(has_flag(wo.w, LOBE_SAMPLED) && (bitcast<u32>(l.position.w) & LIGHT_SURFACE) != 0u);
    let gloss = select(vec3<f32>(0.0), e * eval_specular(lobe, shading.xyz, wo.xyz, wi), glossy);
    indirect[slot] += vec4<f32>(select(vec3<f32>(0.0), e, seen), 0.0);
    specular[slot] += vec4<f32>(select(vec3<f32>(0.0), gloss, seen), 0.0);
}
