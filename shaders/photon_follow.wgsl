// Continues photons at mirrors and glass and stores them where they hit another surface. See pass/photon_follow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "ideal.wgsl"
#include "photons.wgsl"

@group(0) @binding(9) var<storage, read_write> work_in: DispatchCounts;
@group(0) @binding(10) var<storage, read> list_in: array<u32>;
@group(0) @binding(11) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(12) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(13) var<storage, read> steps: array<Step>;
@group(0) @binding(14) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> flux: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> media: array<vec4<u32>>;
@group(0) @binding(19) var<storage, read_write> photon_position: array<vec4<f32>>;
@group(0) @binding(20) var<storage, read_write> photon_normal: array<vec4<f32>>;
@group(0) @binding(21) var<storage, read> target_of: array<u32>;
@group(0) @binding(22) var<storage, read> mirror_of: array<u32>;   // number of a planar mirror + 1, or 0
var<immediate> push: Push;

// In place of the target's number: the first hit was a planar mirror, whose reflection is left to mirrored lights.
const OFF_A_PLANE: f32 = -1.0;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let first_hit = step.bounce == 0u;
    // The first hits are those of all photons, later hits those of a list.
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let count = select(atomicLoad(&work_in.live), photon_count(), first_hit);
    if index >= count {
        return;
    }
    let photon = select(list_in[select(index, 0u, first_hit)], index, first_hit);
    let hit = hits[photon];
    let triangle = bitcast<u32>(hit.w);
    let carried = flux[photon];
    let found = triangle != 0xffffffffu && mean3(carried.xyz) > 0.0;
    let at = select(0u, triangle, found);
    let ideal = materials[material_of(triangle_normals[at])].flags.z != SURFACE_OPAQUE;
    let aimed = !first_hit || meets_aim(at, target_of[at], bitcast<u32>(carried.w));
    let mirrored_lights = step.mirrored_lights == 1u;
    let off_a_plane = mirrored_lights && first_hit && mirror_of[at] > 0u && mirror_of[at] <= frame.mirrors.z;
    let ray = ray_direction[photon];
    let d = ray.xyz;
    let s = surface_at(at, hit.y, hit.z, d, frame.cones.y * hit.x);

    var stored = found && !ideal && !first_hit;
    var after = carried.xyz;
    // A loop, because it runs zero times if no photon of the subgroup hit a mirror or glass.
    for (var i = select(0u, 1u, found && ideal && aimed && step.last == 0u); i > 0u; i -= 1u) {
        let inside = select(media[photon], vec4<u32>(0u), first_hit);
        let split = specular_split(s, -d, relative_index(inside, s));
        // Light that reaches the base of a mirror straight from the emitter is direct light; photons leave it out.
        let by_mirror = first_hit && split.stays;
        let xi = random(key(frame.keys.x, STREAM_PHOTON_COMPONENT, photon, step.bounce));
        let takes_first = xi < split.probability && !by_mirror;
        let stays = takes_first && split.stays;
        let wi = select(split.second_wi, split.first_wi, takes_first);
        let chance = select(select(1.0 - split.probability, split.probability, takes_first), 1.0, by_mirror);
        let first_factor = select(split.first_weight * split.first_adjoint, vec3<f32>(1.0), stays);
        let factor = select(split.second_weight * split.second_adjoint, first_factor, takes_first);
        after = carried.xyz * factor / chance;
        stored = stays;
        let goes_on = !stays && mean3(after) > 0.0;
        media[photon] = select(inside, crossed(inside, s.material + 1u, s.front), takes_first && split.crosses);
        if goes_on {
            let side = select(-s.geometric, s.geometric, dot(wi, s.geometric) > 0.0);
            ray_origin[photon] = vec4<f32>(offset_origin(s.position, side, frame.eye.w), 3.0e38);
            ray_direction[photon] = vec4<f32>(wi, ray.w);
            list_out[atomicAdd(&work_out.live, 1u)] = photon;
        }
    }
    flux[photon] = vec4<f32>(after, select(carried.w, OFF_A_PLANE, off_a_plane));
    // The eye's segment, those of the photon, and those of the light that it left.
    let fits = step.bounce + 2u + u32(ray.w) <= frame.scene.z;
    if stored && fits && !(mirrored_lights && step.bounce == 1u && carried.w == OFF_A_PLANE) {
        photon_position[photon] = vec4<f32>(s.position, 1.0);
        photon_normal[photon] = vec4<f32>(s.geometric, 0.0);
    }
}
