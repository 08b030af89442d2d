// Marks the tiles of 8 x 8 pixels that have pixels of a region. See pass/convolve/occupied.rs.
#include "convolve.wgsl"

@group(0) @binding(1) var<storage, read> region: array<u32>;
@group(0) @binding(2) var<storage, read_write> marks: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let here = steps[push.step];
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    if tile >= here.tiles.x * here.tiles.y {
        return;
    }
    let low = 8u * vec2<u32>(tile % here.tiles.x, tile / here.tiles.x);
    let high = min(low + vec2<u32>(8u), here.size);
    var mark = select(0u, 1u, (here.flags & EVERYWHERE) != 0u);
    for (var y = low.y; y < high.y && mark == 0u; y += 1u) {
        for (var x = low.x; x < high.x && mark == 0u; x += 1u) {
            mark = select(0u, 1u, (region[y * here.size.x + x] & 0xffffu) != 0u);
        }
    }
    marks[here.first_tile + tile] = mark;
}
