// Adds the light that gathered points reflect to their pixels. See pass/collect.rs.
#include "work.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> list: array<u32>;
@group(0) @binding(2) var<storage, read> steps: array<Step>;
@group(0) @binding(3) var<storage, read> beta: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> pixel_direct: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> pixel_indirect: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> pixel_specular: array<vec4<f32>>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[place];
    let b = beta[slot];
    let e = emitted[slot].xyz;
    let l = b.xyz * reflected_radiance(point_kd[slot].xyz, lighting_of(slot));
    // An emitter hit by the first gather ray is direct light; all other light was reflected before.
    let first = step.bounce == 1u;
    let diffuse = b.w == 0.0;
    let as_direct = select(vec3<f32>(0.0), e, first && diffuse);
    let as_indirect = select(vec3<f32>(0.0), l + select(e, vec3<f32>(0.0), first), diffuse);
    let as_specular = select(l + e, vec3<f32>(0.0), diffuse);
    pixel_direct[slot] += vec4<f32>(as_direct, 0.0);
    pixel_indirect[slot] += vec4<f32>(as_indirect, 0.0);
    pixel_specular[slot] += vec4<f32>(as_specular, 0.0);
}
