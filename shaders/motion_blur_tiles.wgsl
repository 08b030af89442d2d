// Finds the velocities in each tile. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "motion_tiles.wgsl"

@group(0) @binding(1) var<storage, read> velocity: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> motion_tiles: array<MotionTile>;
@group(0) @binding(3) var<storage, read_write> farthest: atomic<u32>;   // reach of any source, in tiles

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = (frame.size.xy + 7u) / 8u;
    if tile >= tiles.x * tiles.y {
        return;
    }
    let part = part_of_tile(tile);
    var found: MotionTile;
    found.range = vec4<f32>(1e9, -1e9, 1e9, -1e9);
    var greatest = 0.0;
    for (var y = part.y; y < part.y + part.w; y += 1u) {
        for (var x = part.x; x < part.x + part.z; x += 1u) {
            let v = velocity[y * frame.size.x + x];
            let length = dot(v, v);
            let moves = length > 0.0;
            let low = min(found.range.xz, v);
            let high = max(found.range.yw, v);
            found.range = select(found.range, vec4<f32>(low.x, high.x, low.y, high.y), moves);
            found.longest = select(found.longest, v, length > greatest);
            greatest = max(greatest, length);
            found.moves |= select(0u, 1u, moves);
            found.rests |= select(1u, 0u, moves);
        }
    }
    motion_tiles[tile] = found;
    if found.moves != 0u {
        let reach = 0.5 * max(max(-found.range.x, found.range.y), max(-found.range.z, found.range.w)) + 1.0;
        atomicMax(&farthest, (u32(reach) + 7u) / 8u);
    }
}
