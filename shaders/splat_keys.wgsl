// Writes the keys by which hits are sorted: their buckets of the hash table. See pass/splat_grid.rs.
#include "work.wgsl"
#include "math.wgsl"
#include "splats.wgsl"

@group(0) @binding(1) var<storage, read> splat_state: array<u32>;
@group(0) @binding(2) var<storage, read> splat_hits: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> surface_width: array<f32>;
@group(0) @binding(4) var<storage, read_write> keys: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> work: DispatchCounts;

// Places without a hit go to the end; buckets have 22 bits at most.
const DEAD_KEY: u32 = 0xffffffu;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    if i >= splat_parameters.capacity {
        return;
    }
    let count = splat_state[SPLAT_HITS];
    let hit = splat_hits[2u * min(i, max(count, 1u) - 1u)];
    let width = surface_width[max(hit.w, 1u) - 1u];
    let code = splat_code(vec3<i32>(floor(splat_cells(bitcast<vec3<f32>>(hit.xyz), width))), hit.w);
    keys[i] = vec2<u32>(select(DEAD_KEY, splat_bucket(code), i < count), i);
    if i == 0u {
        atomicStore(&work.live, count);
    }
}
