// Finds whether sources reach each tile, and whether they count as one surface. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "motion_tiles.wgsl"

@group(0) @binding(1) var<storage, read> motion_tiles: array<MotionTile>;
@group(0) @binding(2) var<storage, read> farthest: u32;
@group(0) @binding(3) var<storage, read_write> motion_reach: array<MotionReach>;

// Velocities are alike that differ by less, in pixels or as a share of the longest. Host twins: pass::motion_blur::{ALIKE, ALIKE_SHARE}.
const ALIKE: f32 = 0.25;
const ALIKE_SHARE: f32 = 0.0625;

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
    var longest = 0.0;
    var reach = own_reach;
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
            reach = select(reach, max(reach, reach_of(other)), sends);
            longest = max(longest, select(0.0, other.longest, sends));
        }
    }
    var found: MotionReach;
    // A loop that runs zero times skips work on every device.
    for (var once = select(0u, 1u, moving.y >= moving.x); once > 0u; once -= 1u) {
        every = vec4<f32>(min(every.x, moving.x), max(every.y, moving.y), min(every.z, moving.z), max(every.w, moving.w));
        let range = max(every.y - every.x, every.w - every.z);
        // Sources come from between this tile and those that reach it.
        var kinds = 0u;
        for (var y = low.y; y <= high.y; y += 1) {
            for (var x = low.x; x <= high.x; x += 1) {
                let apart = max(8.0 * vec2<f32>(abs(vec2<i32>(x, y) - at)) - 7.0, vec2<f32>(0.0));
                kinds |= select(0u, motion_tiles[y * tiles.x + x].kinds, all(reach >= apart));
            }
        }
        let alike = range <= max(ALIKE, ALIKE_SHARE * longest);
        found = MotionReach(1u, select(0u, 1u, alike || (kinds & JUMPS) == 0u));
    }
    motion_reach[tile] = found;
}
