// Writes the sorted hits, and the first and the end of each bucket. See pass/splat_grid.rs.
#include "work.wgsl"
#include "math.wgsl"
#include "splats.wgsl"

@group(0) @binding(1) var<storage, read> keys: array<vec2<u32>>;            // sorted
@group(0) @binding(2) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(3) var<storage, read> splat_hits: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> surface_width: array<f32>;
@group(0) @binding(5) var sorted_hits: texture_storage_2d<rgba32uint, write>;    // in place of the surface the code of the cell
@group(0) @binding(6) var<storage, read_write> splat_buckets: array<u32>;   // first, end of each; cleared before

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    let live = atomicLoad(&work.live);
    if i >= live {
        return;
    }
    let bucket = keys[i].x;
    let place = 2u * keys[i].y;
    let hit = splat_hits[place];
    let width = surface_width[max(hit.w, 1u) - 1u];
    let code = splat_code(vec3<i32>(floor(splat_cells(bitcast<vec3<f32>>(hit.xyz), width))), hit.w);
    textureStore(sorted_hits, sorted_place(2u * i), vec4<u32>(hit.xyz, code));
    textureStore(sorted_hits, sorted_place(2u * i + 1u), splat_hits[place + 1u]);
    if i == 0u || keys[max(i, 1u) - 1u].x != bucket {
        splat_buckets[2u * bucket] = i;
    }
    if i + 1u == live || keys[min(i + 1u, live - 1u)].x != bucket {
        splat_buckets[2u * bucket + 1u] = i + 1u;
    }
}
