// Reflects the rays that hit their mirror, towards the light. See pass/mirror_lights.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "mirror_reflectance.wgsl"
#include "lights.wgsl"
#include "light_at.wgsl"
#include "mirror_lights.wgsl"

@group(0) @binding(9) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(10) var<storage, read> list: array<u32>;
@group(0) @binding(11) var<storage, read> steps: array<Step>;
@group(0) @binding(12) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> mirrored: array<PointLight>;
@group(0) @binding(14) var<storage, read> mirror_number: array<u32>;
@group(0) @binding(15) var<storage, read> mirrors: array<MirrorRecord>;
@group(0) @binding(16) var<storage, read> mirror_of: array<u32>;
@group(0) @binding(17) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read_write> reflectances: array<vec4<f32>>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    if place >= atomicLoad(&work.live) {
        return;
    }
    let slot = list[place];
    let chosen = mirrored_index(slot, steps[push.step].first);
    let number = mirror_number[chosen];
    let mirror = mirrors[max(number, 1u) - 1u];
    let hit = hits[slot];
    let triangle = bitcast<u32>(hit.w);
    let found = triangle != 0xffffffffu;
    let at = select(0u, triangle, found);
    let by_mirror = found && number > 0u && mirror_of[at] == number;
    let d = ray_direction[slot].xyz;
    let s = surface_at(at, hit.y, hit.z, d, frame.cones.y * hit.x);
    let reflected = mirror_reflectance(s.ideal, -dot(s.shading, d));

    // The mirror image of the mirrored light is the light itself.
    let l = mirrored_light(mirror, mirrored[chosen]);
    let origin = offset_origin(s.position, s.geometric, frame.eye.w);
    ray_origin[slot] = vec4<f32>(origin, select(0.0, 1.0, by_mirror));
    ray_direction[slot] = vec4<f32>(to_light(l.position, l.normal, origin), 0.0);
    reflectances[slot] = vec4<f32>(select(vec3<f32>(0.0), reflected, by_mirror), 0.0);
}
