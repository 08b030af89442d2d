// Packs the values that the discontinuity buffer compares, and those that it averages. See pass/discontinuity.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "octahedral.wgsl"
#include "flags.wgsl"
#include "discontinuity.wgsl"

@group(0) @binding(1) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> throughput: array<vec4<f32>>;      // w: depth along the whole path
// Second components lie below the first.
@group(0) @binding(7) var guide_points: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var guide_normals: texture_storage_2d<rgba32float, write>;
@group(0) @binding(9) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(10) var<storage, read> tiles: array<u32>;
@group(0) @binding(11) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(12) var guide_indirect: texture_storage_2d<rgba32float, write>;
#if DIRECT
@group(0) @binding(13) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(14) var guide_direct: texture_storage_2d<rgba32float, write>;
#endif

#if PAPER
#else
// Host twin: pass::discontinuity::MAX_SPREAD.
const MAX_SPREAD: f32 = 16.0;

// Squared distance to the nearer one of the neighbours before and after along an axis of a tile, 0 if none is lit. `place` is the
// pixel's place in its tile along the axis, `stride` the distance of slots. Tiles around this one may not be listed.
fn nearer_neighbour(slot: u32, place: u32, stride: u32, last: bool) -> f32 {
    let before = select(slot, slot - stride, place > 0u);
    let after = select(slot, slot + stride, place < 7u && !last);
    let p = point_position[slot].xyz;
    let to_before = point_position[before].xyz - p;
    let to_after = point_position[after].xyz - p;
    let of_before = select(3.0e38, dot(to_before, to_before), before != slot && has_flag(point_wo[before].w, LIT));
    let of_after = select(3.0e38, dot(to_after, to_after), after != slot && has_flag(point_wo[after].w, LIT));
    let nearer = min(of_before, of_after);
    return select(0.0, nearer, nearer < 3.0e38);
}
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let second = window.component == 1u;
    let all_tiles = ((frame.size.x + 7u) / 8u) * ((frame.size.y + 7u) / 8u);
    if index >= select(all_tiles, atomicLoad(&work.live), second) {
        return;
    }
    // Pixels are taken row by row, in the order of memory, which processors prefetch.
    let across = 8u * ((frame.size.x + 7u) / 8u);
    let place = 64u * index + lane;
    let in_rows = vec2<i32>(divided(place, across).yx);
    let in_tile = tile_corner(tiles[select(0u, index, second)]) + vec2<i32>(vec2<u32>(lane & 7u, lane / 8u));
    let at = select(in_rows, in_tile, second);
    if any(at >= vec2<i32>(frame.size.xy)) {
        return;
    }
    let slot = slot_at(at);
    let position = point_position[slot];
    let normal = point_geometric[slot].xyz;
    let wo = point_wo[slot];
    let depth = throughput[slot].w;
    let lit = has_flag(wo.w, LIT);
    let takes_part = lit && mean3(point_kd[slot].xyz) > 0.0;
#if PAPER
    let extent = depth;
#else
    // Square of twice the extent of a pixel on the surface, along the longer diagonal.
    let size = vec2<f32>(frame.within.zw);
    let pixel = 2.0 * max(sqrt(dot(frame.right.xyz, frame.right.xyz)) / size.x, sqrt(dot(frame.up.xyz, frame.up.xyz)) / size.y);
    let covered = 2.0 * depth_scale(depth) * pixel / max(dot(normal, wo.xyz), 0.02);
    // Behind curved mirrors and glass and along lobes neighbours tell how far apart pixels are.
    let right_end = at.x + 1 == i32(frame.size.x);
    let lower_end = at.y + 1 == i32(frame.size.y);
    var spread = 0.0;
    if (second || has_flag(wo.w, SEEN_BY_SPECULAR)) && takes_part {
        let across_tile = nearer_neighbour(u32(slot), u32(at.x) & 7u, 1u, right_end);
        spread = 4.0 * max(across_tile, nearer_neighbour(u32(slot), u32(at.y) & 7u, frame.size.x, lower_end));
    }
    let extent = clamp(spread, covered * covered, MAX_SPREAD * MAX_SPREAD * covered * covered);
#endif
    // Ray origins have an offset that changes along the surface; the comparison needs points on the surface.
    let point = offset_origin(position.xyz, -normal, frame.eye.w);
    let to = texel_at(at);
    textureStore(guide_points, to, vec4<f32>(point, bitcast<f32>(encode_normal(normal))));
    textureStore(guide_normals, to, vec4<f32>(point_shading[slot].xyz, select(0.0, extent, takes_part)));
    textureStore(guide_indirect, to, indirect[slot]);
#if DIRECT
    textureStore(guide_direct, to, direct[slot]);
#endif
    // Second components of tiles that are not listed take no part.
    if !second && textureDimensions(guide_normals).y > frame.size.y {
        textureStore(guide_normals, at + vec2<i32>(0, i32(frame.size.y)), vec4<f32>(0.0));
    }
}
