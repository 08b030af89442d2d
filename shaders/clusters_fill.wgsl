// Fills the list of shading points with the places of the listed clusters, cluster by cluster. See pass/clusters.rs.
#include "work.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> clusters: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> places: array<u32>;
@group(0) @binding(3) var<storage, read_write> list: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    if 64u * index >= work.total {
        return;
    }
    list[64u * index + lane] = places[64u * clusters[index].y + lane];
}
