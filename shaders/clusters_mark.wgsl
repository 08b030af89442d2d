// Marks the clusters of the screen that hold a shading point. See pass/clusters.rs.
#include "work.wgsl"

@group(0) @binding(0) var<storage, read> places: array<u32>;
@group(0) @binding(1) var<storage, read_write> marks: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let cluster = (group.x + group.y * groups.x) * 64u + lane;
    if cluster >= arrayLength(&marks) {
        return;
    }
    var mark = 0u;
    for (var i = 0u; i < 64u && mark == 0u; i += 1u) {
        mark = select(0u, 1u, places[64u * cluster + i] != NO_POINT);
    }
    marks[cluster] = mark;
}
