// Exchanges irradiance around pixels whose windows found few that agree. See pass/sparse_windows.rs. Two kernels.
// FIRST: with the pixels beside. Without: with those three steps away. DIRECT: and spreads the surplus of direct light.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "discontinuity.wgsl"

@group(0) @binding(1) var guide_points: texture_storage_2d<rgba32float, read>;
@group(0) @binding(2) var guide_normals: texture_storage_2d<rgba32float, read>;
@group(0) @binding(3) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(4) var<storage, read> tiles: array<u32>;
#if FIRST
@group(0) @binding(5) var<storage, read> filtered_indirect: array<vec4<f32>>;       // w: lack of the window
@group(0) @binding(6) var<storage, read_write> moved_indirect: array<vec4<f32>>;    // w: the same
#if DIRECT
@group(0) @binding(7) var<storage, read> filtered_direct: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> surplus: array<vec4<f32>>;           // part of each of the pixels that share it; their number
#endif
#else
@group(0) @binding(5) var<storage, read_write> filtered_indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> moved_indirect: array<vec4<f32>>;
#if DIRECT
@group(0) @binding(7) var<storage, read_write> filtered_direct: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> surplus: array<vec4<f32>>;
#endif
#endif

// Host twins: pass::sparse_windows::{MIN_COSINE, ABOVE}.
const MIN_COSINE: f32 = 0.0;
const ABOVE: f32 = 1.2;

struct Place {
    point: vec3<f32>,
    shading: vec3<f32>,
    extent: f32,        // squared double footprint; 0: it takes no part
}

fn clamped(at: vec2<i32>) -> vec2<i32> {
    return clamp(at, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
}

fn place_at(at: vec2<i32>) -> Place {
    let inside = clamped(at);
    let texel = texel_at(inside);
    let normal = textureLoad(guide_normals, texel);
    return Place(textureLoad(guide_points, texel).xyz, normal.xyz, select(0.0, normal.w, all(at == inside)));
}

// Whether two points are near each other and do not face away from each other; `apart` is their squared distance in pixels.
fn alike(a: Place, b: Place, apart: f32) -> bool {
    let chord = b.point - a.point;
    let near = dot(chord, chord) <= apart * max(a.extent, b.extent);
    return near && min(a.extent, b.extent) > 0.0 && dot(a.shading, b.shading) >= MIN_COSINE;
}

fn indirect_at(at: vec2<i32>) -> vec4<f32> {
#if FIRST
    return filtered_indirect[slot_at(clamped(at))];
#else
    return moved_indirect[slot_at(clamped(at))];
#endif
}

// Gain of a pixel from one a number of steps away.
fn exchanged(place: Place, own: vec4<f32>, at: vec2<i32>, offset: vec2<i32>, steps: i32) -> vec3<f32> {
    let there = at + steps * offset;
    let other = indirect_at(there);
    let apart = f32(steps * steps * (offset.x * offset.x + offset.y * offset.y));
    // Slots that are not lit may hold any value: they are left out, not multiplied by 0.
    return select(vec3<f32>(0.0), max(own.w, other.w) * (other.xyz - own.xyz), alike(place, place_at(there), apart));
}

fn exchange(place: Place, own: vec4<f32>, at: vec2<i32>, steps: i32) -> vec3<f32> {
    var gain = exchanged(place, own, at, vec2<i32>(-1, -1), steps);
    gain += exchanged(place, own, at, vec2<i32>(0, -1), steps);
    gain += exchanged(place, own, at, vec2<i32>(1, -1), steps);
    gain += exchanged(place, own, at, vec2<i32>(-1, 0), steps);
    gain += exchanged(place, own, at, vec2<i32>(1, 0), steps);
    gain += exchanged(place, own, at, vec2<i32>(-1, 1), steps);
    gain += exchanged(place, own, at, vec2<i32>(0, 1), steps);
    gain += exchanged(place, own, at, vec2<i32>(1, 1), steps);
    return gain / 9.0;
}

// Greatest lack among a pixel and those a number of steps away. A value of a slot that nothing has written costs time, no more.
fn lack_around(at: vec2<i32>, steps: i32) -> f32 {
    var lack = 0.0;
    for (var i = 0; i < 9; i += 1) {
        lack = max(lack, indirect_at(at + steps * vec2<i32>(i % 3 - 1, i / 3 - 1)).w);
    }
    return lack;
}

#if DIRECT
#if FIRST
// Two greatest greys of direct irradiance among alike pixels beside, and their number.
fn ranked(sum: vec3<f32>, place: Place, at: vec2<i32>, offset: vec2<i32>) -> vec3<f32> {
    let there = at + offset;
    let other = alike(place, place_at(there), f32(offset.x * offset.x + offset.y * offset.y));
    let grey = select(0.0, mean3(filtered_direct[slot_at(clamped(there))].xyz), other);
    return vec3<f32>(max(sum.x, grey), max(sum.y, min(sum.x, grey)), sum.z + select(0.0, 1.0, other));
}

// The surplus of direct irradiance of a pixel over the pixels beside it: xyz the part of each pixel that shares it, w their number.
fn surplus_of(place: Place, e: vec3<f32>, at: vec2<i32>) -> vec4<f32> {
    var sum = ranked(vec3<f32>(0.0), place, at, vec2<i32>(-1, -1));
    sum = ranked(sum, place, at, vec2<i32>(0, -1));
    sum = ranked(sum, place, at, vec2<i32>(1, -1));
    sum = ranked(sum, place, at, vec2<i32>(-1, 0));
    sum = ranked(sum, place, at, vec2<i32>(1, 0));
    sum = ranked(sum, place, at, vec2<i32>(-1, 1));
    sum = ranked(sum, place, at, vec2<i32>(0, 1));
    sum = ranked(sum, place, at, vec2<i32>(1, 1));
    let grey = mean3(e);
    let share = select(0.0, frame.shift.w * max(grey - ABOVE * sum.y, 0.0) / max(grey, 1e-30), sum.z > 1.5);
    let count = 1.0 + sum.z;
    return select(vec4<f32>(0.0), vec4<f32>(share / count * e, count), share > 0.0);
}
#else
// Whether a pixel or one beside has a surplus.
fn has_surplus(at: vec2<i32>) -> bool {
    var any_count = 0.0;
    for (var i = 0; i < 9; i += 1) {
        any_count = max(any_count, surplus[slot_at(clamped(at + vec2<i32>(i % 3 - 1, i / 3 - 1)))].w);
    }
    return any_count > 0.0;
}

// Change of the direct irradiance of a pixel.
fn received(place: Place, at: vec2<i32>) -> vec3<f32> {
    let own = surplus[slot_at(at)];
    var sum = (1.0 - own.w) * own.xyz;
    for (var i = 0; i < 9; i += 1) {
        let offset = vec2<i32>(i % 3 - 1, i / 3 - 1);
        let there = at + offset;
        let takes = i != 4 && alike(place, place_at(there), f32(offset.x * offset.x + offset.y * offset.y));
        sum += select(vec3<f32>(0.0), surplus[slot_at(clamped(there))].xyz, takes);
    }
    return sum;
}
#endif
#endif

fn update(at: vec2<i32>) {
    let slot = slot_at(at);
    let place = place_at(at);
    let takes_part = place.extent > 0.0;
#if FIRST
    let steps = 1;
#else
    let steps = 3;
#endif
    let own = indirect_at(at);
    var gain = vec3<f32>(0.0);
    // A loop, because it runs zero times where all windows around are full.
    for (var i = select(0u, 1u, takes_part && lack_around(at, steps) > 0.0); i > 0u; i -= 1u) {
        gain = exchange(place, own, at, steps);
    }
    let indirect = vec4<f32>(own.xyz + frame.shift.w * gain, own.w);
#if FIRST
    moved_indirect[slot] = indirect;
#if DIRECT
    var parts = vec4<f32>(0.0);
    for (var i = select(0u, 1u, takes_part && own.w > 0.0); i > 0u; i -= 1u) {
        parts = surplus_of(place, filtered_direct[slot].xyz, at);
    }
    surplus[slot] = parts;
#endif
#else
    filtered_indirect[slot] = indirect;
#if DIRECT
    var change = vec3<f32>(0.0);
    for (var i = select(0u, 1u, takes_part && has_surplus(at)); i > 0u; i -= 1u) {
        change = received(place, at);
    }
    let direct = filtered_direct[slot];
    filtered_direct[slot] = vec4<f32>(direct.xyz + change, direct.w);
#endif
#endif
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let second = window.component == 1u;
    let all_tiles = ((frame.size.x + 7u) / 8u) * ((frame.size.y + 7u) / 8u);
    if index >= select(all_tiles, atomicLoad(&work.live), second) {
        return;
    }
    // Pixels are taken row by row, as in discontinuity_guides.wgsl.
    let across = 8u * ((frame.size.x + 7u) / 8u);
    let in_rows = vec2<i32>(divided(64u * index + lane, across).yx);
    let in_tile = tile_corner(tiles[select(0u, index, second)]) + vec2<i32>(vec2<u32>(lane & 7u, lane / 8u));
    let at = select(in_rows, in_tile, second);
    if all(at < vec2<i32>(frame.size.xy)) {
        update(at);
    }
}
