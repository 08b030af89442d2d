// Lists the shading points that splats show. See pass/splat_find.rs.
// ROUNDS: then finds how many dispatches have candidates for some point.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "splats.wgsl"
#if ROUNDS
#else
#include "splat_look_up.wgsl"
#include "flags.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> surface_of: array<u32>;
@group(0) @binding(7) var<storage, read> surface_width: array<f32>;
@group(0) @binding(8) var<storage, read> splat_buckets: array<vec2<u32>>;
@group(0) @binding(9) var<storage, read_write> found: array<vec2<u32>>;     // slot, surface + 1
#endif
@group(0) @binding(10) var<storage, read_write> found_work: DispatchCounts;     // unfinished: most candidates of a point
@group(0) @binding(11) var<storage, read_write> round_groups: array<vec4<u32>>; // indirect dispatches
@group(0) @binding(12) var<storage, read_write> status: array<u32>;     // [0]: rays that were lost in this pass
@group(0) @binding(13) var<storage, read> particle_status: array<u32>;  // the same of the particles

#if ROUNDS
@compute @workgroup_size(1)
fn main() {
    let count = atomicLoad(&found_work.live);
    let most = atomicLoad(&found_work.unfinished);
    let groups = (count + 63u) / 64u;
    let x = min(groups, 32768u);
    let all = vec4<u32>(x, (groups + x - 1u) / max(x, 1u), 1u, 0u);
    for (var round = 0u; round < splat_parameters.rounds; round += 1u) {
        round_groups[round] = select(vec4<u32>(0u, 1u, 1u, 0u), all, round * splat_parameters.chunk < most && count > 0u);
    }
    status[0] += particle_status[0];
}
#else
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    // A sorted list, or one in the order of the screen, may have places without a shading point.
    if place >= max(atomicLoad(&work.live), work.total) {
        return;
    }
    let slot = list[place];
    if slot == NO_POINT {
        return;
    }
    // One class of pixels takes splats in each pass, and counts for the others.
    let takes = class_of(slot) == frame.size.w % frame.pattern.z;
    if !takes || !has_flag(point_wo[slot].w, SPLATS) {
        return;
    }
    let surface = surface_of[bitcast<u32>(hits[slot].w)];
    let width = surface_width[max(surface, 1u) - 1u];
    if surface == 0u || width == 0.0 {
        return;
    }
    let look_up = splat_look_up(point_position[slot].xyz, surface, width);
    var candidates = 0u;
    for (var c = 0u; c < SPLAT_CELLS; c += 1u) {
        candidates += splat_cell(look_up, c).count;
    }
    if candidates > 0u {
        atomicMax(&found_work.unfinished, candidates);
        found[atomicAdd(&found_work.live, 1u)] = vec2<u32>(slot, surface);
    }
}
#endif
