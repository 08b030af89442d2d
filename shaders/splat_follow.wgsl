// Stores the hits of particles on glossy surfaces, and reflects or absorbs the particles. See pass/splat_follow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "ideal.wgsl"
#include "splats.wgsl"
#include "splat_numbers.wgsl"

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
@group(0) @binding(19) var<storage, read_write> fresh: array<vec4<u32>>;    // hits of the batch; cleared before
@group(0) @binding(21) var<storage, read> surface_of: array<u32>;           // surface + 1 of a triangle that splats may show, or 0
@group(0) @binding(22) var<storage, read> splat_state: array<u32>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let bounces = step.bounce;
    // The first hits are those of all particles of the batch, later ones those of a list.
    let all = bounces == 0u;
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let count = select(atomicLoad(&work_in.live), splat_parameters.particles, all);
    if index >= count {
        return;
    }
    let place = select(list_in[select(index, 0u, all)], index, all);
    let particle = splat_state[SPLAT_FIRST] + place;
    let hit = hits[place];
    let triangle = bitcast<u32>(hit.w);
    let carried = flux[place].xyz;
    let found = triangle != 0xffffffffu && mean3(carried) > 0.0;
    let at = select(0u, triangle, found);
    let d = ray_direction[place].xyz;
    let s = surface_at(at, hit.y, hit.z, d, frame.cones.y * hit.x);
    let r = s.reflectance;
    let ideal = found && s.kind != SURFACE_OPAQUE;

    // Direct light is not stored. The eye's segment and those of the particle make a path that may be too long.
    let surface = surface_of[at];
    if found && !ideal && bounces > 0u && surface > 0u && r.f90 > 0.0 && bounces + 2u <= frame.scene.z {
        let slot = 2u * ((bounces - 1u) * splat_parameters.particles + place);
        fresh[slot] = vec4<u32>(bitcast<vec3<u32>>(s.position), surface);
        fresh[slot + 1u] = vec4<u32>(bitcast<vec3<u32>>(carried), pack_arrival(-d, bounces));
    }

    // Particles start outside all bodies of glass.
    let inside = select(media[place], vec4<u32>(0u), all);
    var beyond = inside;
    var by_base = found && !ideal;
    var weight = vec3<f32>(0.0);
    var wi = s.geometric;
    // A loop, because it runs zero times if no particle of the subgroup hit a mirror or glass.
    for (var i = select(0u, 1u, ideal); i > 0u; i -= 1u) {
        let split = specular_split(s, -d, relative_index(inside, s));
        let takes_first = random(key(frame.keys.y, STREAM_SPLAT_COMPONENT, particle, bounces)) < split.probability;
        by_base = takes_first && split.stays;
        wi = select(split.second_wi, split.first_wi, takes_first);
        let chance = select(1.0 - split.probability, split.probability, takes_first);
        let first_factor = select(split.first_weight * split.first_adjoint, vec3<f32>(1.0), by_base);
        weight = select(split.second_weight * split.second_adjoint, first_factor, takes_first) / max(chance, 1e-6);
        beyond = select(inside, crossed(inside, s.material + 1u, s.front), takes_first && split.crosses);
    }
    for (var i = select(0u, 1u, by_base); i > 0u; i -= 1u) {
        let p_diffuse = diffuse_probability(r);
        let diffuse = random(key(frame.keys.y, STREAM_SPLAT_LOBE, particle, bounces)) < p_diffuse;
        let numbers = splat_numbers(bounces + 2u, particle);
        let next = sample_lobe(r, diffuse, p_diffuse, s.shading, -d, numbers.x, numbers.y);
        let cos_geometric = dot(next.wi, s.geometric);
        let cos_shading = dot(next.wi, s.shading);
        // Flux is deposited by the geometric cosine and reflected by the shading one (Veach 1997, 5.3).
        let skew = min(dot(s.shading, d) / min(dot(s.geometric, d), -1e-7), 4.0);
        let leave = min(cos_geometric / max(cos_shading, 1e-7), 4.0);
        let leaves = cos_geometric > 0.0 && cos_shading > 0.0;
        weight = next.weight * select(0.0, skew * leave, leaves) * select(vec3<f32>(1.0), weight, ideal);
        wi = next.wi;
    }
    // Roulette keeps the greatest component of the flux.
    let after = carried * weight;
    let survival = clamp(max(max(after.x, after.y), after.z) / max(max(max(carried.x, carried.y), carried.z), 1e-37), 0.0, 1.0);
    let survives = random(key(frame.keys.y, STREAM_SPLAT_ROULETTE, particle, bounces)) < survival;
    if found && survives && step.last == 0u {
        let side = select(-s.geometric, s.geometric, dot(wi, s.geometric) > 0.0);
        flux[place] = vec4<f32>(after / survival, 0.0);
        ray_origin[place] = vec4<f32>(offset_origin(s.position, side, frame.eye.w), 3.0e38);
        ray_direction[place] = vec4<f32>(wi, 0.0);
        media[place] = beyond;
        list_out[atomicAdd(&work_out.live, 1u)] = place;
    }
}
