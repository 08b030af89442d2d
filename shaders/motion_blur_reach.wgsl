// Finds the window of the sources that reach each tile. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "motion_tiles.wgsl"

@group(0) @binding(1) var<storage, read> motion_tiles: array<MotionTile>;
@group(0) @binding(2) var<storage, read> farthest: u32;
@group(0) @binding(3) var<storage, read_write> motion_windows: array<MotionWindow>;

// Samples of a window. Host twin: pass::motion_blur::SAMPLES.
const SAMPLES: f32 = 12000.0;
// Velocities are alike that differ by less, in pixels or as a share of the longest. Host twins: pass::motion_blur::{ALIKE, ALIKE_SHARE}.
const ALIKE: f32 = 0.25;
const ALIKE_SHARE: f32 = 0.0625;

// Reach of a tile's sources along rows and columns.
fn reach_of(tile: MotionTile) -> vec2<f32> {
    let reach = 0.5 * vec2<f32>(max(-tile.range.x, tile.range.y), max(-tile.range.z, tile.range.w)) + 1.0;
    return select(vec2<f32>(-1.0), reach, (tile.kinds & MOVES) != 0u);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = vec2<i32>((frame.size.xy + 7u) / 8u);
    if tile >= u32(tiles.x * tiles.y) {
        return;
    }
    let own = motion_tiles[tile];
    let own_reach = reach_of(own);
    let at = vec2<i32>(i32(tile) % tiles.x, i32(tile) / tiles.x);
    let far = i32(min(farthest, 128u));
    let low = max(at - far, vec2<i32>(0));
    let high = min(at + far, tiles - 1);
    // Velocities of all sources that matter, those at rest included; and of those that move.
    var moving = vec4<f32>(1e9, -1e9, 1e9, -1e9);
    var every = select(moving, vec4<f32>(0.0), (own.kinds & RESTS) != 0u);
    var longest = vec2<f32>(0.0);
    var reach = own_reach;
    var nearest = own.nearest;
    for (var y = low.y; y <= high.y; y += 1) {
        for (var x = low.x; x <= high.x; x += 1) {
            let other = motion_tiles[y * tiles.x + x];
            let apart = max(8.0 * vec2<f32>(abs(vec2<i32>(x, y) - at)) - 7.0, vec2<f32>(0.0));
            let reaches = all(max(reach_of(other), own_reach) >= apart);
            let sends = reaches && (other.kinds & MOVES) != 0u;
            let joined = vec4<f32>(max(moving.yw, other.range.yw), min(moving.xz, other.range.xz));
            moving = select(moving, vec4<f32>(joined.z, joined.x, joined.w, joined.y), sends);
            let rests = reaches && (other.kinds & RESTS) != 0u;
            every = select(every, vec4<f32>(min(every.x, 0.0), max(every.y, 0.0), min(every.z, 0.0), max(every.w, 0.0)), rests);
            nearest = select(nearest, min(nearest, other.nearest), sends);
            reach = select(reach, max(reach, reach_of(other)), sends);
            longest = select(longest, other.longest, sends && dot(other.longest, other.longest) > dot(longest, longest));
        }
    }
    var window: MotionWindow;
    window.along = -1.0;
    // A loop that runs zero times skips work on every device.
    for (var once = select(0u, 1u, moving.y >= moving.x); once > 0u; once -= 1u) {
        every = vec4<f32>(min(every.x, moving.x), max(every.y, moving.y), min(every.z, moving.z), max(every.w, moving.w));
        let wide = abs(longest.x) >= abs(longest.y);
        let major = select(moving.zw, moving.xy, wide);
        let minor = select(moving.xy, moving.zw, wide);
        let axes = select(longest.yx, longest, wide);
        let slope = axes.y / axes.x;
        let steepest = max(abs(minor.x), abs(minor.y));
        let crosses = major.x <= 0.0 && major.y >= 0.0;
        let least = min(abs(major.x), abs(major.y));
        // The corners of the box bound what is linear in the velocity.
        let ends = vec4<f32>(major.x, major.x, major.y, major.y);
        let apart = abs(vec4<f32>(minor, minor) - slope * ends);
        let ratio = apart / max(abs(ends), vec4<f32>(1e-6));
        window.slope = slope;
        window.wide = select(0u, 1u, wide);
        window.along = ceil(0.5 * max(abs(major.x), abs(major.y)) + 1.0);
        window.across = 0.5 * max(max(apart.x, apart.y), max(apart.z, apart.w));
        // Segments of any direction are bounded by their ends alone. Those whose longer side is the other one stray from their line
        // by a pixel along it, and by one across.
        let others = crosses || steepest > least;
        window.spread = select(max(max(ratio.x, ratio.y), max(ratio.z, ratio.w)), 1e9, crosses);
        window.margin = select(0.01, 2.0, others);
        // The last column of a segment reaches half a pixel beyond its end.
        window.across += select(0.5 * window.spread, 0.0, others);
        let range = max(every.y - every.x, every.w - every.z);
        // Sources come from between this tile and those that reach it.
        var kinds = 0u;
        for (var y = low.y; y <= high.y; y += 1) {
            for (var x = low.x; x <= high.x; x += 1) {
                let apart = max(8.0 * vec2<f32>(abs(vec2<i32>(x, y) - at)) - 7.0, vec2<f32>(0.0));
                kinds |= select(0u, motion_tiles[y * tiles.x + x].kinds, all(reach >= apart));
            }
        }
        let alike = range <= max(ALIKE, ALIKE_SHARE * sqrt(dot(longest, longest)));
        window.even = select(0u, 1u, alike || (kinds & JUMPS) == 0u);
        let samples = (2.0 * window.along + 1.0) * (2.0 * (window.across + window.margin) + 1.0);
        window.stride = u32(ceil(sqrt(max(samples / SAMPLES, 1.0))));
    }
    window.nearest = nearest;
    motion_windows[tile] = window;
}
