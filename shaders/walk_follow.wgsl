// Continues particles at mirrors and glass until they meet another surface. See pass/walk_follow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "ideal.wgsl"
#include "walk.wgsl"

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
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let j = step.bounce;
    // The first step takes all particles, later ones those of a list.
    let all = step.indirect == 0u;
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let count = select(atomicLoad(&work_in.live), frame.depths[j].x * frame.pattern.z, all);
    if index >= count {
        return;
    }
    let particle = select(list_in[select(index, 0u, all)], index, all);
    let hit = hits[particle];
    let triangle = bitcast<u32>(hit.w);
    let carried = flux[particle];
    let found = triangle != 0xffffffffu && mean3(carried.xyz) > 0.0 && begins(particle);
    let at = select(0u, triangle, found);
    let ideal = found && materials[material_of(triangle_normals[at])].flags.z != SURFACE_OPAQUE;
    let d = ray_direction[particle].xyz;
    let s = surface_at(at, hit.y, hit.z, d, frame.cones.y * hit.x);
    // Particles start outside all bodies of glass.
    let inside = select(media[particle], vec4<u32>(0u), step.clears == 1u);
    var beyond = inside;
    // A loop, because it runs zero times if no particle of the subgroup hit a mirror or glass.
    for (var i = select(0u, 1u, ideal); i > 0u; i -= 1u) {
        let split = specular_split(s, -d, relative_index(inside, s));
        // From the eye over a point that is lit to the light after this step and j reflections.
        let allowed = f32(j) + carried.w + 3.0 <= f32(frame.scene.z);
        let xi = random(key(frame.keys.x, STREAM_WALK_COMPONENT, particle, 16u * j + u32(carried.w)));
        let takes_first = xi < split.probability || (split.stays && !allowed);
        let stays = takes_first && split.stays;
        let wi = select(split.second_wi, split.first_wi, takes_first);
        let chance = select(select(1.0 - split.probability, split.probability, takes_first), 1.0, stays && !allowed);
        let first_factor = select(split.first_weight * split.first_adjoint, vec3<f32>(1.0), stays);
        let factor = select(split.second_weight * split.second_adjoint, first_factor, takes_first);
        let after = select(vec3<f32>(0.0), carried.xyz * factor / chance, stays || allowed);
        beyond = select(inside, crossed(inside, s.material + 1u, s.front), takes_first && split.crosses);
        flux[particle] = vec4<f32>(after, carried.w + select(1.0, 0.0, stays));
        if !stays && mean3(after) > 0.0 {
            let side = select(-s.geometric, s.geometric, dot(wi, s.geometric) > 0.0);
            ray_origin[particle] = vec4<f32>(offset_origin(s.position, side, frame.eye.w), 3.0e38);
            ray_direction[particle] = vec4<f32>(wi, 0.0);
            list_out[atomicAdd(&work_out.live, 1u)] = particle;
        }
    }
    media[particle] = beyond;
}
