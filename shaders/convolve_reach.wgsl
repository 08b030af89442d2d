// Longest reach among the sources of a row of tiles that reach a tile. DOWN: of a column of tiles. See pass/convolve.rs.
#include "convolve.wgsl"

@group(0) @binding(2) var<storage, read> from_tiles: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read_write> to_tiles: array<vec4<i32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let here = steps[push.step];
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    if tile >= here.tiles.x * here.tiles.y {
        return;
    }
#if DOWN
    let at = i32(tile / here.tiles.x);
    let end = i32(here.tiles.y) - 1;
    let stride = i32(here.tiles.x);
#else
    let at = i32(tile % here.tiles.x);
    let end = i32(here.tiles.x) - 1;
    let stride = 1;
#endif
    let own = i32(here.first_tile + tile);
    var found = from_tiles[own];
    let low = max(-i32(here.reach), -at);
    let high = min(i32(here.reach), end - at);
    for (var d = low; d <= high; d += 1) {
        let other = from_tiles[own + d * stride];
        // Distance between the nearest texels of the two tiles.
        let apart = max(8 * abs(d) - 7, 0);
        found.x = max(found.x, select(-1, other.x, other.x >= apart));
        found.y = max(found.y, select(-1, other.y, other.y >= apart));
    }
    to_tiles[own] = found;
}
