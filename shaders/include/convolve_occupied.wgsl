// Kernels over the listed tiles of a level, a workgroup for each. Needs convolve.wgsl. See pass/convolve/occupied.rs.

@group(0) @binding(14) var<storage, read> occupied: array<u32>;        // listed tiles of each level, from its first tile on
@group(0) @binding(15) var<storage, read> occupied_counts: array<vec4<u32>>;   // two for each level; w of the first: tiles in its list

// No tile.
const NO_TILE: u32 = 0xffffffffu;

// Tile of a workgroup, permuted.
fn occupied_tile(level: ConvolveStep, group: vec3<u32>, groups: vec3<u32>) -> u32 {
    let count = occupied_counts[2u * level.level].w;
    let index = group.x + group.y * groups.x;
    let listed = index < count;
    let tile = occupied[level.first_tile + select(0u, spread_out(index, max(count, 1u)), listed)];
    return select(NO_TILE, tile, listed);
}

// Texel of a lane in a tile.
fn texel_of(level: ConvolveStep, tile: u32, lane: u32) -> vec2<u32> {
    return 8u * vec2<u32>(tile % level.tiles.x, tile / level.tiles.x) + vec2<u32>(lane & 7u, lane / 8u);
}
