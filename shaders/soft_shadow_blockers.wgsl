// Writes the ratios of blockers, and how far their kernels reach. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "soft_shadows.wgsl"

@group(0) @binding(2) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> aimed: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> soft_tiles: array<atomic<u32>>;
@group(0) @binding(7) var blockers: texture_storage_2d<rgba32float, write>;   // blocked point; w: its word, 0: none
@group(0) @binding(6) var<storage, read_write> farthest: atomic<u32>;       // reach of any blocker, in tiles

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let quad = (group.x + group.y * groups.x) * 64u + lane;
    let quads = (frame.size.xy + 1u) / 2u;
    if quad >= quads.x * quads.y {
        return;
    }
    let place = divided(quad, quads.x).yx;
    let own = aimed[quad];
    let word = bitcast<u32>(own.w);
    if word == 0u {
        textureStore(blockers, vec2<i32>(place), vec4<f32>(0.0));
        return;
    }
    let hit = hits[quad];
    // The two kinds of rays may differ where a ray grazes an edge: such a blocker is at the point itself.
    let found = bitcast<u32>(hit.w) != 0xffffffffu;
    let t = clamp(select(0.0, hit.x, found), 0.0, 1.0);
    let extent = ray_direction[quad].w;
    let ratio = bounded_ratio(t / max(1.0 - t, 1e-4), extent);
    let known = (bitcast<u32>(ratio) & RATIO_BITS) | (word & ~RATIO_BITS);
    textureStore(blockers, vec2<i32>(place), vec4<f32>(own.xyz, select(0.0, bitcast<f32>(known), ratio > 1e-30)));
    // And the margin of the search.
    let reach = ratio * extent + 2.0;
    let tile = 4u * soft_tile_of(2u * place);
    // Bits of positive floats order like the floats.
    atomicMax(&soft_tiles[tile], bitcast<u32>(reach));
    atomicMax(&soft_tiles[tile + 1u], bitcast<u32>(ratio));
    atomicMax(&farthest, (u32(reach) + SOFT_TILE) / SOFT_TILE);
}
