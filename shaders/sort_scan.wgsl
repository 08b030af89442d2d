// A level of the scan: turns counts into exclusive prefix sums, each stretch from its base. See pass/sort.rs.
#include "work.wgsl"
#include "sort.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> steps: array<Step>;
@group(0) @binding(2) var<storage, read_write> values: array<u32>;
@group(0) @binding(3) var<storage, read> bases: array<u32>;            // prefix sums of the level above; unused at the top
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let stretch = (group.x + group.y * groups.x) * 64u + lane;
    let level = steps[push.step].level;
    let length = level_length(level, work.total);
    let reach = select(DIGITS, TOP, level == 2u);
    if stretch * reach >= length {
        return;
    }
    var running = select(bases[stretch], 0u, level == 2u);
    let end = min((stretch + 1u) * reach, length);
    for (var i = stretch * reach; i < end; i += 1u) {
        let value = values[i];
        values[i] = running;
        running += value;
    }
}
