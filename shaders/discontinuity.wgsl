// Averages irradiance over neighbours on the same surface. See pass/discontinuity.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "octahedral.wgsl"
#include "discontinuity.wgsl"

@group(0) @binding(1) var guide_points: texture_storage_2d<rgba32float, read>;
@group(0) @binding(2) var guide_normals: texture_storage_2d<rgba32float, read>;
@group(0) @binding(3) var guide_indirect: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var<storage, read_write> filtered_indirect: array<vec4<f32>>;
#if DIRECT
@group(0) @binding(5) var guide_direct: texture_storage_2d<rgba32float, read>;
@group(0) @binding(6) var<storage, read_write> filtered_direct: array<vec4<f32>>;
#endif
@group(0) @binding(7) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(8) var<storage, read> tiles: array<u32>;

// Host twins: pass::discontinuity::{MIN_COSINE, PLANE_TOLERANCE, PAPER_TOLERANCE, LEAST_LACK}.
const MIN_COSINE: f32 = 0.9;
const PLANE_TOLERANCE: f32 = 0.05;
const PAPER_TOLERANCE: f32 = 0.02;
const LEAST_LACK: f32 = 1e-4;

// A shading point with its irradiance.
struct Cell {
    point: vec3<f32>,
    geometric: vec3<f32>,
    shading: vec3<f32>,
    extent: f32,            // its footprint, or depth, see discontinuity_guides.wgsl; 0: it takes no part
    indirect: vec3<f32>,
#if DIRECT
    direct: vec3<f32>,
#endif
}

// Sums over the neighbours of a pixel: shares times the differences from the pixel.
struct Gain {
    indirect: vec3<f32>,
#if DIRECT
    direct: vec3<f32>,
#endif
    shares: f32,            // shares of those that agree
}

fn load(at: vec2<i32>) -> Cell {
    let inside = clamp(at, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
    let texel = texel_at(inside);
    let point = textureLoad(guide_points, texel);
    let normal = textureLoad(guide_normals, texel);
    var cell: Cell;
    cell.point = point.xyz;
    cell.geometric = decode_normal(bitcast<u32>(point.w));
    cell.shading = normal.xyz;
    cell.extent = select(0.0, normal.w, all(at == inside));
    cell.indirect = textureLoad(guide_indirect, texel).xyz;
#if DIRECT
    cell.direct = textureLoad(guide_direct, texel).xyz;
#endif
    return cell;
}

// Whether two shading points lie on one smooth surface; `apart` is their squared distance in pixels. Symmetric in a and b.
fn agree(a: Cell, b: Cell, apart: f32) -> bool {
    let alike = min(a.extent, b.extent) > 0.0 && dot(a.shading, b.shading) >= MIN_COSINE;
#if PAPER
    return alike && abs(a.extent - b.extent) <= PAPER_TOLERANCE * min(a.extent, b.extent);
#else
    let chord = b.point - a.point;
    let length = dot(chord, chord);
    let rise = dot(chord, a.geometric + b.geometric);
    let turn = max(2.0 - 2.0 * dot(a.geometric, b.geometric), 0.0);
    let rounding = frame.eye.w * (1.0 / 524288.0);
    let flat_enough = rise * rise <= length * (turn + 4.0 * PLANE_TOLERANCE * PLANE_TOLERANCE) + rounding * rounding;
    return alike && flat_enough && length <= apart * max(a.extent, b.extent);
#endif
}

// Share of a neighbour `offset` columns or rows away.
fn axis_share(shares: vec4<f32>, offset: i32) -> f32 {
    let away = abs(offset);
    if away == 0 {
        return 1.0;
    }
    return select(shares[min(away, 4) - 1], 0.0, away > 4);
}

// Adds the neighbour at an offset from the pixel.
fn gained(gain: Gain, own: Cell, other: Cell, dx: i32, dy: i32) -> Gain {
    let share = axis_share(window.shares_x, dx) * axis_share(window.shares_y, dy);
    let taken = agree(own, other, f32(dx * dx + dy * dy)) && share > 0.0;
    // Slots that are not lit may hold any value, NaN too: they are left out, not multiplied by 0.
    var sum = gain;
    sum.indirect += select(vec3<f32>(0.0), share * (other.indirect - own.indirect), taken);
#if DIRECT
    sum.direct += select(vec3<f32>(0.0), share * (other.direct - own.direct), taken);
#endif
    sum.shares += select(0.0, share, taken);
    return sum;
}

fn finish(at: vec2<i32>, own: Cell, gain: Gain) {
#if PAPER
    // Normalised by the shares found, the own one included.
    let weight = frame.lens.z / (1.0 + gain.shares);
    let lack = 0.0;
#else
    let weight = frame.lens.z * window.middle;
#if WIDE
    // A pixel agrees with itself.
    let found = gain.shares;
#else
    let found = 1.0 + gain.shares;
#endif
    let missing = 1.0 - window.middle * found;
    let lack = select(0.0, missing, own.extent > 0.0 && missing > LEAST_LACK);
#endif
    if at.y < i32(frame.size.y) {
        let slot = slot_at(at);
        filtered_indirect[slot] = vec4<f32>(own.indirect + weight * gain.indirect, lack);
#if DIRECT
        filtered_direct[slot] = vec4<f32>(own.direct + weight * gain.direct, 0.0);
#endif
    }
}

#if WIDE
// Filters a strip of four pixels.
fn strip(first: vec2<i32>) {
    let down = vec2<i32>(0, 1);
    let own0 = load(first);
    let own1 = load(first + down);
    let own2 = load(first + 2 * down);
    let own3 = load(first + 3 * down);
    var gain0: Gain;
    var gain1: Gain;
    var gain2: Gain;
    var gain3: Gain;
    for (var dy = -window.reach.y; dy < 4 + window.reach.y; dy += 1) {
        for (var dx = -window.reach.x; dx <= window.reach.x; dx += 1) {
            let other = load(first + vec2<i32>(dx, dy));
            gain0 = gained(gain0, own0, other, dx, dy);
            gain1 = gained(gain1, own1, other, dx, dy - 1);
            gain2 = gained(gain2, own2, other, dx, dy - 2);
            gain3 = gained(gain3, own3, other, dx, dy - 3);
        }
    }
#if PAPER
    // A pixel agrees with itself if it takes part.
    gain0.shares = max(gain0.shares - 1.0, 0.0);
    gain1.shares = max(gain1.shares - 1.0, 0.0);
    gain2.shares = max(gain2.shares - 1.0, 0.0);
    gain3.shares = max(gain3.shares - 1.0, 0.0);
#endif
    finish(first, own0, gain0);
    finish(first + down, own1, gain1);
    finish(first + 2 * down, own2, gain2);
    finish(first + 3 * down, own3, gain3);
}
#else
// Adds three neighbours in column dx, from top to bottom.
fn gained_three(gain: Gain, own: Cell, above: Cell, beside: Cell, below: Cell, dx: i32) -> Gain {
    return gained(gained(gained(gain, own, above, dx, -1), own, beside, dx, 0), own, below, dx, 1);
}

// Straight-line code: loops and arrays are much slower on some devices.
fn strip(first: vec2<i32>) {
    let down = vec2<i32>(0, 1);
    let right = vec2<i32>(1, 0);
    let above = load(first - down);
    let own0 = load(first);
    let own1 = load(first + down);
    let own2 = load(first + 2 * down);
    let own3 = load(first + 3 * down);
    let below = load(first + 4 * down);
    var gain0: Gain;
    var gain1: Gain;
    var gain2: Gain;
    var gain3: Gain;
    gain0 = gained(gained(gain0, own0, above, 0, -1), own0, own1, 0, 1);
    gain1 = gained(gained(gain1, own1, own0, 0, -1), own1, own2, 0, 1);
    gain2 = gained(gained(gain2, own2, own1, 0, -1), own2, own3, 0, 1);
    gain3 = gained(gained(gain3, own3, own2, 0, -1), own3, below, 0, 1);

    let left0 = load(first - right - down);
    let left1 = load(first - right);
    let left2 = load(first - right + down);
    let left3 = load(first - right + 2 * down);
    let left4 = load(first - right + 3 * down);
    let left5 = load(first - right + 4 * down);
    gain0 = gained_three(gain0, own0, left0, left1, left2, -1);
    gain1 = gained_three(gain1, own1, left1, left2, left3, -1);
    gain2 = gained_three(gain2, own2, left2, left3, left4, -1);
    gain3 = gained_three(gain3, own3, left3, left4, left5, -1);

    let right0 = load(first + right - down);
    let right1 = load(first + right);
    let right2 = load(first + right + down);
    let right3 = load(first + right + 2 * down);
    let right4 = load(first + right + 3 * down);
    let right5 = load(first + right + 4 * down);
    gain0 = gained_three(gain0, own0, right0, right1, right2, 1);
    gain1 = gained_three(gain1, own1, right1, right2, right3, 1);
    gain2 = gained_three(gain2, own2, right2, right3, right4, 1);
    gain3 = gained_three(gain3, own3, right3, right4, right5, 1);

    finish(first, own0, gain0);
    finish(first + down, own1, gain1);
    finish(first + 2 * down, own2, gain2);
    finish(first + 3 * down, own3, gain3);
}
#endif

@compute @workgroup_size(16)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let second = window.component == 1u;
    let all_tiles = ((frame.size.x + 7u) / 8u) * ((frame.size.y + 7u) / 8u);
    if index >= select(all_tiles, atomicLoad(&work.live), second) {
        return;
    }
    // An invocation filters four pixels of a column, which share the neighbours that it loads.
    // Pixels are taken row by row, as in discontinuity_guides.wgsl.
    let across = 8u * ((frame.size.x + 7u) / 8u);
    let place = 16u * index + lane;
    let in_rows = divided(place, across).yx;
    let in_tile = vec2<u32>(tile_corner(tiles[select(0u, index, second)])) + vec2<u32>(lane & 7u, 4u * (lane / 8u));
    let first = vec2<i32>(select(in_rows * vec2<u32>(1u, 4u), in_tile, second));
    if all(first < vec2<i32>(frame.size.xy)) {
        strip(first);
    }
}
