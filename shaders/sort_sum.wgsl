// A level of the scan: sums up each stretch of the level below. See pass/sort.rs.
#include "work.wgsl"
#include "sort.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> steps: array<Step>;
@group(0) @binding(2) var<storage, read> below: array<u32>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let stretch = (group.x + group.y * groups.x) * 64u + lane;
    let level = steps[push.step].level;
    let total = work.total;
    if stretch >= level_length(level, total) {
        return;
    }
    let end = min((stretch + 1u) * DIGITS, level_length(level - 1u, total));
    var sum = 0u;
    for (var i = stretch * DIGITS; i < end; i += 1u) {
        sum += below[i];
    }
    sums[stretch] = sum;
}
