// Appends the hits of a batch to those stored, in the order of their slots. See pass/splat_pack.rs.
// COUNT: counts the hits of each block of slots. SCAN: sums them up, and decides whether they fit.
#include "math.wgsl"
#include "splats.wgsl"
#if SCAN
#include "stretches.wgsl"
#endif

// Slots of a block. Host twin: pass::splat_pack::BLOCK.
const BLOCK: u32 = 64u;

@group(0) @binding(0) var<storage, read> fresh: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> block_sums: array<u32>;  // hits of each block, then of those before it
@group(0) @binding(2) var<storage, read_write> splat_state: array<u32>;
@group(0) @binding(3) var<storage, read_write> splat_hits: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read_write> surface_hits: array<atomic<u32>>;

#if SCAN
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    let blocks = (splat_parameters.slots + BLOCK - 1u) / BLOCK;
    let own = stretch_of(lane, blocks);
    var sum = 0u;
    for (var i = own.first; i < own.end; i += 1u) {
        sum += block_sums[i];
    }
    var before = sum_before(lane, sum);
    for (var i = own.first; i < own.end; i += 1u) {
        let count = block_sums[i];
        block_sums[i] = before;
        before += count;
    }
    if lane == 63u {
        let base = splat_state[SPLAT_HITS];
        let fits = splat_state[SPLAT_FULL] == 0u && before <= splat_parameters.capacity - base;
        splat_state[SPLAT_BASE] = select(NO_PLACE, base, fits);
        splat_state[SPLAT_HITS] = select(base, base + before, fits);
        splat_state[SPLAT_PARTICLES] += select(0u, splat_state[SPLAT_COUNT], fits);
        splat_state[SPLAT_FULL] = select(1u, 0u, fits);
    }
}
#else
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = (group.x + group.y * groups.x) * 64u + lane;
    let first = block * BLOCK;
    let end = min(first + BLOCK, splat_parameters.slots);
#if COUNT
    if first >= splat_parameters.slots {
        return;
    }
    var count = 0u;
    for (var i = first; i < end; i += 1u) {
        count += select(0u, 1u, fresh[2u * i].w > 0u);
    }
    block_sums[block] = count;
#else
    let base = splat_state[SPLAT_BASE];
    if first >= splat_parameters.slots || base == NO_PLACE {
        return;
    }
    var place = base + block_sums[block];
    for (var i = first; i < end; i += 1u) {
        let hit = fresh[2u * i];
        if hit.w > 0u {
            splat_hits[2u * place] = hit;
            splat_hits[2u * place + 1u] = fresh[2u * i + 1u];
            atomicAdd(&surface_hits[hit.w - 1u], 1u);
            place += 1u;
        }
    }
#endif
}
#endif
