// Finds the blockers that reach each tile. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "soft_shadows.wgsl"

@group(0) @binding(2) var<storage, read> soft_tiles: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> farthest: u32;
@group(0) @binding(4) var<storage, read_write> soft_windows: array<f32>;    // greatest ratio of blockers that reach the tile; 0: nothing to convolve

// Pixels between a tile and the nearest pixels of another.
fn apart(at: vec2<i32>, x: i32, y: i32) -> f32 {
    let between = f32(SOFT_TILE) * vec2<f32>(abs(vec2<i32>(x, y) - at)) - f32(SOFT_TILE - 1u);
    return max(max(between.x, between.y), 0.0);
}

// One invocation for each tile.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    let tiles = vec2<i32>((frame.size.xy + SOFT_TILE - 1u) / SOFT_TILE);
    if tile >= u32(tiles.x * tiles.y) {
        return;
    }
    let at = vec2<i32>(i32(tile) % tiles.x, i32(tile) / tiles.x);
    // Kernels are at most WIDEST wide to either side.
    let far = i32(min(farthest, 17u));
    let low = max(at - far, vec2<i32>(0));
    let high = min(at + far, tiles - 1);
    var ratio = 0.0;
    var reach = -1.0;
    for (var y = low.y; y <= high.y; y += 1) {
        for (var x = low.x; x <= high.x; x += 1) {
            let other = soft_tiles[y * tiles.x + x];
            let reaches = (other.z & SHOWS_BLOCKED) != 0u && bitcast<f32>(other.x) >= apart(at, x, y);
            ratio = select(ratio, max(ratio, bitcast<f32>(other.y)), reaches);
            reach = select(reach, max(reach, bitcast<f32>(other.x)), reaches);
        }
    }
    var shows = 0u;
    for (var y = low.y; y <= high.y; y += 1) {
        for (var x = low.x; x <= high.x; x += 1) {
            shows |= select(0u, soft_tiles[y * tiles.x + x].z, reach >= apart(at, x, y));
        }
    }
    soft_windows[tile] = select(0.0, ratio, (shows & SHOWS_LIT) != 0u);
}
