// Averages the specular radiance of neighbours that reflect alike. See pass/discontinuity_lobes.rs.
#include "lobe_width.wgsl"
#include "frame.wgsl"
#include "work.wgsl"
#include "flags.wgsl"
#include "discontinuity.wgsl"

@group(0) @binding(1) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> filtered_specular: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(9) var<storage, read> tiles: array<u32>;

// Host twins: pass::discontinuity_lobes::{SLOPE, TINT}.
const SLOPE: f32 = 0.1;
const TINT: f32 = 0.05;

struct Gloss {
    position: vec3<f32>,
    geometric: vec3<f32>,
    mirrored: vec3<f32>,    // direction of ideal reflection
    f0: vec3<f32>,
    alpha: f32,             // of a GGX lobe about as wide
    takes_part: bool,
}

fn gloss_at(slot: u32) -> Gloss {
    let wo = point_wo[slot];
    let shading = point_shading[slot];
    let mirrored = shading.xyz * (2.0 * dot(shading.xyz, wo.xyz)) - wo.xyz;
    let takes_part = has_flag(wo.w, GLOSSY) && has_flag(wo.w, LIT);
    return Gloss(point_position[slot].xyz, point_geometric[slot].xyz, mirrored, point_f0[slot].xyz, width_of(shading.w), takes_part);
}

// Whether two shading points reflect alike: on one smooth surface, of one finish, mirrored directions within the lobe. Symmetric.
fn alike(a: Gloss, b: Gloss) -> bool {
    let chord = b.position - a.position;
    let length2 = dot(chord, chord);
    let rise = dot(chord, a.geometric + b.geometric);
    let turn = max(2.0 - 2.0 * dot(a.geometric, b.geometric), 0.0);
    let apart = a.mirrored - b.mirrored;
    let tint = abs(a.f0 - b.f0);
    let width = min(a.alpha, b.alpha);
    return a.takes_part && b.takes_part
        && rise * rise <= length2 * (turn + SLOPE * SLOPE)
        && max(a.alpha, b.alpha) <= 1.25 * width
        && dot(apart, apart) <= width * width
        && max(tint.x, max(tint.y, tint.z)) <= TINT;
}

fn share_of(shares: vec4<f32>, offset: i32) -> f32 {
    return select(shares[min(max(abs(offset), 1), 4) - 1], 1.0, offset == 0);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let second = window.component == 1u;
    let all_tiles = ((frame.size.x + 7u) / 8u) * ((frame.size.y + 7u) / 8u);
    if index >= select(all_tiles, atomicLoad(&work.live), second) {
        return;
    }
    let at = vec2<i32>(pixel_of_tile(select(index, tiles[select(0u, index, second)], second), lane));
    let size = vec2<i32>(frame.size.xy);
    if any(at >= size) {
        return;
    }
    let slot = u32(slot_at(at));
    let own = gloss_at(slot);
    let l = specular[slot].xyz;
    var gain = vec3<f32>(0.0);
    // Neighbours of second components may never have been written.
    let reach = select(vec2<i32>(-1), window.reach, own.takes_part && !second);
    for (var dy = -reach.y; dy <= reach.y; dy += 1) {
        for (var dx = -reach.x; dx <= reach.x; dx += 1) {
            let to = at + vec2<i32>(dx, dy);
            let inside = all(to >= vec2<i32>(0)) && all(to < size);
            let other = select(slot, u32(slot_at(to)), inside);
            let share = share_of(window.shares_x, dx) * share_of(window.shares_y, dy);
            let taken = inside && alike(own, gloss_at(other));
            gain += select(vec3<f32>(0.0), share * (specular[other].xyz - l), taken);
        }
    }
    filtered_specular[slot] = vec4<f32>(l + frame.lens.z * window.middle * gain, 0.0);
}
