// Finds how far the sources of each tile of 8 x 8 texels reach, and whether the tile has pixels of a region. See pass/convolve.rs.
// FINE: the level is the image itself.
#include "convolve.wgsl"

@group(0) @binding(6) var<storage, read> masses: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> shapes: array<vec4<f32>>;
#if FINE
@group(0) @binding(4) var<storage, read> region: array<u32>;
#else
@group(0) @binding(9) var<storage, read> members: array<u32>;
#endif
@group(0) @binding(12) var<storage, read> marks: array<u32>;       // 1: the tile has texels of a region
@group(0) @binding(11) var<storage, read_write> tiles: array<vec4<i32>>;   // texels that either plane's sources reach, -1: none; 1: has pixels

// Reach of a source in texels.
fn reach_of(shape: vec4<f32>, ratio: f32) -> i32 {
    let radius = max(1.0, 1.0 / ratio) / sqrt(shape.x * shape.x + shape.y * shape.y);
    return i32(SUPPORT * radius);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let here = steps[push.step];
    let tile = (group.x + group.y * groups.x) * 64u + lane;
    if tile >= here.tiles.x * here.tiles.y {
        return;
    }
    let low = 8u * vec2<u32>(tile % here.tiles.x, tile / here.tiles.x);
    let high = min(low + vec2<u32>(8u), here.size);
    let plane = here.size.x * here.size.y;
    var reach0 = -1;
    var reach1 = -1;
    var busy = 0;
    let end = select(low.y, high.y, marks[here.first_tile + tile] != 0u);
    for (var y = low.y; y < end; y += 1u) {
        for (var x = low.x; x < high.x; x += 1u) {
            let at = here.first + y * here.size.x + x;
#if FINE
            let here0 = (region[at] & 0xffffu) != 0u;
            busy |= select(0, 1, here0);
            reach0 = max(reach0, select(-1, reach_of(shapes[at], 1.0), here0 && masses[at].w > 0.0));
#else
            let other = at + plane;
            let here0 = (members[at] & 0xffffu) != 0u;
            busy |= select(0, 1, here0);
            let shape0 = shapes[at];
            let shape1 = shapes[other];
            let live0 = here0 && masses[at].w > 0.0;
            let live1 = (members[other] & 0xffffu) != 0u && masses[other].w > 0.0;
            reach0 = max(reach0, select(-1, reach_of(shape0, shape0.z), live0));
            reach1 = max(reach1, select(-1, reach_of(shape1, shape1.z), live1));
#endif
        }
    }
    tiles[here.first_tile + tile] = vec4<i32>(reach0, reach1, busy, 0);
}
