// Carries rays at edges of lamps on at mirrors and glass, and ends them elsewhere. See pass/lamp_edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "ideal.wgsl"
#include "environment.wgsl"
#include "edge_rays.wgsl"
#include "lamp_edges.wgsl"

@group(0) @binding(9) var<storage, read_write> work_in: DispatchCounts;
@group(0) @binding(10) var<storage, read> list_in: array<u32>;
@group(0) @binding(11) var<storage, read_write> work_out: DispatchCounts;
@group(0) @binding(12) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(13) var<storage, read> steps: array<Step>;
@group(0) @binding(14) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> media: array<vec4<u32>>;
@group(0) @binding(18) var<storage, read_write> lamp_beta: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read_write> lamp_light: array<vec4<f32>>;
@group(0) @binding(20) var<storage, read_write> lamp_way: array<u32>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= atomicLoad(&work_in.live) {
        return;
    }
    let step = steps[push.step];
    let ray = list_in[index];
    let hit = hits[ray];
    let d = ray_direction[ray];
    let beta = lamp_beta[ray];
    let way = way_of(lamp_way[ray]);
    let triangle = bitcast<u32>(hit.w);
    let found = triangle != 0xffffffffu;
    let at = select(0u, triangle, found);
    let normals = triangle_normals[at];
    let kind = materials[material_of(normals)].flags.z;
    let ideal = found && kind != SURFACE_OPAQUE;
    // At a narrow lobe, and at a reflector or pane of superposition, the ray ends without a result.
    let unlike = found && (is_shiny(normals) || glossy_plane(normals) > 0u || frosted_pane(normals) > 0u);
    let depth = beta.w + d.w * hit.x;
    let s = surface_at(at, hit.y, hit.z, d.xyz, frame.cones.x * depth_scale(depth));
    var l = lamp_light[ray].xyz;
    var next = way;
    var ends = !ideal;
    // A loop, because it runs zero times if no ray of the subgroup hit a mirror or glass.
    for (var i = select(0u, 1u, ideal && !unlike); i > 0u; i -= 1u) {
        let inside = media[ray];
        let split = specular_split(s, -d.xyz, relative_index(inside, s));
        let two = split.probability < 1.0;
        let splits = two && way.free > 0u && way.free < step.components;
        let turns_off = splits && way.seeks == way.free;
        // Where no slot is left, the likelier component.
        let takes_first = select(!two || split.probability >= 0.5, !turns_off, splits);
        let chance = select(1.0, select(1.0 - split.probability, split.probability, takes_first), two && !splits);
        let stays = takes_first && split.stays;
        l += select(beta.xyz * s.emission, vec3<f32>(0.0), split.stays);
        // The slot of another component begins here.
        l = select(l, vec3<f32>(0.0), turns_off);
        let left = select(0u, way.free + 1u, way.free + 1u < step.components && (!turns_off || split.stays));
        next.slot = select(way.slot, way.free, turns_off);
        next.free = select(way.free, left, splits);
        let flat_mirror = (normals.w & 1u) == 0u && kind == SURFACE_MIRROR && !split.stays;
        next.bends = way.bends || !flat_mirror;
        let weight = select(select(split.second_weight, split.first_weight, takes_first), vec3<f32>(1.0), stays);
        let after = beta.xyz * weight / chance;
        let goes_on = !stays && step.last == 0u && max(max(after.x, after.y), after.z) > 0.0;
        if stays {
            l += after * s.emission;
            ends = true;
        }
        if goes_on {
            let wi = select(split.second_wi, split.first_wi, takes_first);
            let beyond = crossed(inside, s.material + 1u, s.front);
            media[ray] = select(inside, beyond, takes_first && split.crosses);
            let side = select(-s.geometric, s.geometric, dot(wi, s.geometric) > 0.0);
            ray_origin[ray] = vec4<f32>(offset_origin(s.position, side, frame.eye.w), 3.0e38);
            ray_direction[ray] = vec4<f32>(wi, d.w);
            lamp_beta[ray] = vec4<f32>(after, depth);
            lamp_way[ray] = packed_way(next);
            list_out[atomicAdd(&work_out.live, 1u)] = ray;
        }
    }
    let leaves = !found && has_environment();
    for (var i = select(0u, 1u, leaves); i > 0u; i -= 1u) {
        l += beta.xyz * environment_seen(d.xyz);
    }
    l += select(vec3<f32>(0.0), beta.xyz * s.emission, found && !ideal);
    let counts = ends && !unlike && next.slot == next.seeks && next.bends;
    lamp_light[ray] = vec4<f32>(l, select(0.0, 1.0, counts));
}
