// Moves keys to their places by the present digit. See pass/sort.rs.
#include "work.wgsl"
#include "sort.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> steps: array<Step>;
@group(0) @binding(2) var<storage, read> keys: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> list: array<u32>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let run = (group.x + group.y * groups.x) * 64u + lane;
    let total = work.total;
    let runs = ceil_div(total, RUN);
    if run >= runs {
        return;
    }
    let step = steps[push.step];
    let end = min((run + 1u) * RUN, total);
    for (var i = run * RUN; i < end; i += 1u) {
        let key = keys[i];
        let slot = ((key.x >> step.shift) & (DIGITS - 1u)) * runs + run;
        let place = counts[slot];
        counts[slot] = place + 1u;
        sorted[place] = key;
        // After the last digit the list itself is in order.
        list[select(i, place, step.last == 1u)] = key.y;
    }
}
