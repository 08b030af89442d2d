// Aims rays at a mirrored light: from each shading point to the plane of the mirror. See pass/mirror_lights.rs.
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
@group(0) @binding(7) var<storage, read> mirrored: array<PointLight>;
@group(0) @binding(8) var<storage, read> mirror_number: array<u32>;
@group(0) @binding(9) var<storage, read> mirrors: array<MirrorRecord>;
@group(0) @binding(10) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(13) var<storage, read_write> work_out: DispatchCounts;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    // A list in screen order has gaps.
    if place >= max(atomicLoad(&work.live), work.total) {
        return;
    }
    let slot = list[place];
    if slot == NO_POINT || !has_near_ray(slot, point_wo[slot].w) {
        return;
    }
    let chosen = mirrored_index(slot, steps[push.step].first);
    let number = mirror_number[chosen];
    let mirror = mirrors[max(number, 1u) - 1u];
    let l = mirrored[chosen];
    let x = point_position[slot].xyz;
    let d = to_light(l.position, l.normal, x);
    let r2 = dot(d, d);
    let wi = d / sqrt(max(r2, 1e-37));
    // The mirror's plane must separate the shading point and the mirrored light.
    let height = height_of(mirror, x);
    let fall = dot(d, mirror.plane.xyz);
    let crosses = height * fall < 0.0 && abs(height) < abs(fall);
    let faces = dot(wi, point_shading[slot].xyz) > 0.0 && dot(wi, point_geometric[slot].xyz) > 0.0;
    // The mirror lies within a disc around its centre.
    let off = x + wi * (abs(height) / max(abs(dot(wi, mirror.plane.xyz)), 1e-20)) - mirror.middle.xyz;
    let within = dot(off, off) <= 1.01 * mirror.ideal.w * mirror.ideal.w;
    let lit = number > 0u && crosses && faces && within && r2 > 0.0 && mean3(intensity_of(l, wi)) > 0.0;
    if !lit {
        return;
    }
    list_out[atomicAdd(&work_out.live, 1u)] = slot;
    // A little beyond the plane, because of rounding. A hit there is not on the mirror.
    let reach = abs(height) / max(abs(dot(wi, mirror.plane.xyz)), 1e-20) * 1.001 + frame.eye.w * 1e-4;
    ray_origin[slot] = vec4<f32>(x, reach);
    ray_direction[slot] = vec4<f32>(wi, 0.0);
}
