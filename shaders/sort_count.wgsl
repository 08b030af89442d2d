// Counts the occurrences of each digit in each run. See pass/sort.rs.
#include "work.wgsl"
#include "sort.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> steps: array<Step>;
@group(0) @binding(2) var<storage, read> keys: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;     // digit * runs + run
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let run = (group.x + group.y * groups.x) * 64u + lane;
    let total = work.total;
    let runs = ceil_div(total, RUN);
    if run >= runs {
        return;
    }
    let shift = steps[push.step].shift;
    for (var digit = 0u; digit < DIGITS; digit += 1u) {
        counts[digit * runs + run] = 0u;
    }
    let end = min((run + 1u) * RUN, total);
    for (var i = run * RUN; i < end; i += 1u) {
        let digit = (keys[i].x >> shift) & (DIGITS - 1u);
        counts[digit * runs + run] += 1u;
    }
}
