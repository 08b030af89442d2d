// Turns hits into receivers: looks up surface, material and textures, and adds emission. See pass/receivers.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "receiver.wgsl"
#include "surface.wgsl"
#include "clusters.wgsl"

@group(0) @binding(12) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read> list_in: array<u32>;
@group(0) @binding(16) var<storage, read_write> list_out: array<u32>;
@group(0) @binding(17) var<storage, read_write> work_in: Work;
@group(0) @binding(18) var<storage, read_write> work_out: Work;
@group(0) @binding(19) var<storage, read> steps: array<Step>;
@group(0) @binding(20) var<storage, read_write> beta: array<vec4<f32>>;
@group(0) @binding(21) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(22) var<storage, read_write> receiver_position: array<vec4<f32>>;
@group(0) @binding(23) var<storage, read_write> receiver_geometric: array<vec4<f32>>;
@group(0) @binding(24) var<storage, read_write> receiver_shading: array<vec4<f32>>;
@group(0) @binding(25) var<storage, read_write> receiver_kd: array<vec4<f32>>;
@group(0) @binding(26) var<storage, read_write> receiver_f0: array<vec4<f32>>;
@group(0) @binding(27) var<storage, read_write> receiver_wo: array<vec4<f32>>;
@group(0) @binding(28) var<storage, read_write> throughput: array<vec4<f32>>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let eye = step.bounce == 0u;
    // The list takes the eye's pixels in tiles of 8 x 8, so that neighbours on it are neighbours in the scene. One step takes all
    // tiles; another takes those with second components, whose slots begin at `step.first`.
    let second = eye && step.first > 0u;
    let group_index = group.x + group.y * groups.x;
    let tiles = (frame.size.xy + 7u) / 8u;
    let tile_count = tiles.x * tiles.y;
    let count = atomicLoad(&work_in.live);
    let index = (group_index + select(0u, tile_count, second)) * 64u + lane;
    let total = select(count, 64u * (tile_count + select(0u, count, second)), eye);
    if index >= total {
        return;
    }
    let ordered = step.fresh != 0u;
    let by_screen = step.fresh == 2u;
    if ordered && group_index == 0u && lane == 0u {
        work_out.total = total;
    }
    // Places of eye paths may lie beyond the other list, and select evaluates both operands.
    let listed = list_in[select(select(index, 0u, eye), group_index, second)];
    // Pixels are taken row by row, in the order of memory, which processors prefetch.
    let row = index / (8u * tiles.x);
    let in_rows = vec2<u32>(index - row * 8u * tiles.x, row);
    let in_tile = vec2<u32>(8u * (listed % tiles.x) + (lane & 7u), 8u * (listed / tiles.x) + lane / 8u);
    let at = select(in_rows, in_tile, second);
    let tiled = 64u * (at.x / 8u + at.y / 8u * tiles.x) + 8u * (at.y & 7u) + (at.x & 7u);
    let on_screen = place_of(at) + select(0u, place_count(), second);
    let place_in = select(select(index, tiled, eye && !second), on_screen, by_screen);
    if eye && (at.x >= frame.size.x || at.y >= frame.size.y) {
        if ordered && !by_screen {
            list_out[place_in] = NO_RECEIVER;
        }
        return;
    }
    let slot = select(listed, at.x + at.y * frame.size.x + select(0u, step.first, second), eye);
    let through = throughput[slot];
    // Second components of paths that did not split have no ray.
    let carries = max(max(through.x, through.y), through.z) > 0.0;
    let has_ray = carries || !second;
    let hit = select(vec4<f32>(0.0, 0.0, 0.0, bitcast<f32>(0xffffffffu)), hits[slot], has_ray);
    let triangle = bitcast<u32>(hit.w);
    let ray = select(vec4<f32>(0.0), ray_direction[slot], has_ray);
    let d = ray.xyz;
    let found = triangle != 0xffffffffu;
    let at_triangle = select(0u, triangle, found);
    let s = surface_at(at_triangle, hit.y, hit.z, d);
    // A glossy plane seen directly shows only its base here; the lobe comes with the mirror image.
    let direct = !second && through.w == 0.0 && glossy_plane(triangle_normals[at_triangle]) > 0u;
    let met = emitted[slot];
    let mirrors = eye && (direct || met.w == LOBE_FOLLOWED);

    // Points that the eye sees have weight 1, gathered points the share of light that clipping removed.
    let share = select(max(1.0 - hit.x * hit.x / max(frame.right.w, 1e-37), 0.0), 1.0, eye);
    let before = select(beta[slot], vec4<f32>(1.0, 1.0, 1.0, 0.0), eye);
    let weight = select(0.0, share, found);
    let seen_emission = met.xyz + select(vec3<f32>(0.0), through.xyz * s.emission, found);
    emitted[slot] = select(vec4<f32>(before.xyz * s.emission * weight, before.w), vec4<f32>(seen_emission, select(0.0, 1.0, through.w > 0.0)), eye);
    if eye {
        // The depth of a mirror that shows nothing is its own.
        let end = select(select(-1.0, through.w, through.w > 0.0), through.w + ray.w * hit.x, found);
        throughput[slot] = vec4<f32>(through.xyz, end);
    }

    let lobe = select(mean3(s.reflectance.f0), 0.0, mirrors);
    let reflects = mean3(s.reflectance.kd) + lobe > 0.0;
    // The last gathered points only emit: light that they reflect would exceed the greatest path length.
    let lit = weight > 0.0 && reflects && step.last == 0u && (carries || !eye);
    let glossy = s.reflectance.f90 > 0.0 && !mirrors;
    let depth = select(-1.0, hit.x, found);
    receiver_position[slot] = vec4<f32>(offset_origin(s.position, s.geometric, frame.eye.w), depth);
    receiver_geometric[slot] = vec4<f32>(s.geometric, s.reflectance.f90);
    receiver_shading[slot] = vec4<f32>(s.shading, s.reflectance.alpha);
    receiver_kd[slot] = vec4<f32>(select(vec3<f32>(0.0), s.reflectance.kd, found), select(diffuse_probability(s.reflectance), 1.0, mirrors));
    receiver_f0[slot] = vec4<f32>(select(vec3<f32>(0.0), s.reflectance.f0, found), select(0.0, 1.0, glossy));
    receiver_wo[slot] = vec4<f32>(-d, select(0.0, 1.0, lit));
    beta[slot] = vec4<f32>(before.xyz * weight, before.w);
    // The count does not depend on the order of the invocations; a list that is appended to does.
    var place = place_in;
    if lit {
        let appended = atomicAdd(&work_out.live, 1u);
        place = select(appended, place_in, ordered);
    }
    if lit || ordered {
        list_out[place] = select(NO_RECEIVER, slot, lit);
    }
}
