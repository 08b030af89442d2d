// Lists the marked clusters in order, each with its class. See pass/clusters.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "stretches.wgsl"

@group(0) @binding(1) var<storage, read> marks: array<u32>;
@group(0) @binding(2) var<storage, read_write> clusters: array<vec2<u32>>;     // class, number among all
@group(0) @binding(3) var<storage, read_write> work: DispatchCounts;

// One workgroup.
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    let count = arrayLength(&marks);
    let stretch = stretch_of(lane, count);
    var marked = 0u;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        marked += marks[i];
    }
    var place = sum_before(lane, marked);
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        if marks[i] != 0u {
            clusters[place] = vec2<u32>(i % frame.pattern.z, i);
            place += 1u;
        }
    }
    // The last lane knows the number of listed clusters. Each takes a workgroup, even if few of its places hold a shading point.
    if lane == 63u {
        let live = atomicLoad(&work.live);
        work.total = 64u * place;
        work.list_groups.w = place - (live + 63u) / 64u;
    }
}
