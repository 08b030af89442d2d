// Finds the velocities in each tile. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "motion_tiles.wgsl"

@group(0) @binding(1) var<storage, read> velocity: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> motion_tiles: array<MotionTile>;
@group(0) @binding(3) var<storage, read_write> farthest: atomic<u32>;   // reach of any source, in tiles

// Difference between the velocities of neighbours that are none of one surface, pixels. Host twin: pass::motion_blur::VELOCITY_JUMP.
const VELOCITY_JUMP: f32 = 0.25;

fn jumps(a: vec2<f32>, b: vec2<f32>) -> bool {
    let change = abs(a - b);
    return max(change.x, change.y) > VELOCITY_JUMP;
}

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
        let row = y * frame.size.x;
        let above = row - select(0u, frame.size.x, y > 0u);
        var left = velocity[row + max(part.x, 1u) - 1u].xy;
        for (var x = part.x; x < part.x + part.z; x += 1u) {
            let own = velocity[row + x];
            let v = own.xy;
            found.deepest = max(found.deepest, own.z);
            let jump = jumps(v, left) || jumps(v, velocity[above + x].xy);
            left = v;
            // Within a pixel nothing is spread.
            let moves = max(abs(v.x), abs(v.y)) > 1.0;
            let low = min(found.range.xz, v);
            let high = max(found.range.yw, v);
            found.range = select(found.range, vec4<f32>(low.x, high.x, low.y, high.y), moves);
            greatest = max(greatest, select(0.0, length(v), moves));
            found.kinds |= select(RESTS, MOVES, moves) | select(0u, JUMPS, jump);
        }
    }
    found.longest = greatest;
    motion_tiles[tile] = found;
    if (found.kinds & MOVES) != 0u {
        let reach = reach_of(found);
        atomicMax(&farthest, (u32(max(reach.x, reach.y)) + 7u) / 8u);
    }
}
