// Finds how near the pixels of a tile must be to pass in front of others. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "motion_tiles.wgsl"

@group(0) @binding(1) var<storage, read> motion_tiles: array<MotionTile>;
@group(0) @binding(2) var<storage, read> motion_reach: array<MotionReach>;
@group(0) @binding(3) var<storage, read_write> sends: array<f32>;        // greatest depth that they reach, or -1

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = vec2<i32>((frame.size.xy + 7u) / 8u);
    if tile >= u32(tiles.x * tiles.y) {
        return;
    }
    let at = vec2<i32>(i32(tile) % tiles.x, i32(tile) / tiles.x);
    let own = motion_tiles[tile];
    let far = vec2<i32>(reach_of(own) + 7.0) / 8;
    let low = max(at - far, vec2<i32>(0));
    let high = min(at + far, tiles - 1);
    var deepest = -1.0;
    for (var y = low.y; y <= high.y; y += 1) {
        for (var x = low.x; x <= high.x; x += 1) {
            let other = y * tiles.x + x;
            let reach = motion_reach[other];
            let counts = reach.reached != 0u && reach.even == 0u;
            deepest = max(deepest, select(-1.0, motion_tiles[other].deepest, counts));
        }
    }
    sends[tile] = select(-1.0, deepest, (own.kinds & MOVES) != 0u);
}
