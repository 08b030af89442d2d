// Turns counts found by the device into indirect dispatches. See pass/schedule.rs.
#include "work.wgsl"

@group(0) @binding(0) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(1) var<storage, read> steps: array<Step>;
@group(0) @binding(2) var<storage, read_write> status: array<u32>;    // [0]: rays that a last round left over
var<immediate> push: Push;

// Groups of 64 for `count` invocations and `more` if there are any, spread over two dimensions: one holds at most 65,535.
fn spread(count: u32, more: u32) -> vec4<u32> {
    let groups = count / 64u + select(0u, 1u, count % 64u != 0u) + select(0u, more, count > 0u);
    let x = min(groups, 32768u);
    let y = select(0u, (groups + x - 1u) / max(x, 1u), x > 0u);
    return vec4<u32>(x, y, 1u, more);
}

@compute @workgroup_size(1)
fn main() {
    let step = steps[push.step];
    let live = atomicLoad(&work.live);
    let list = spread(live, work.list_groups.w);
    work.list_groups = list;
    work.total_groups = spread(work.total, 0u);
    // The rounds of a batch without a list run over all its rays.
    let all = spread(step.end, 0u);
    let groups_again = select(all, list, step.indirect != 0u);
    let unfinished = atomicExchange(&work.unfinished, 0u);
    work.round_groups = select(vec4<u32>(0u, 1u, 1u, 0u), groups_again, unfinished > 0u);
    work.once_if_live = vec4<u32>(min(live, 1u), 1u, 1u, 0u);
    work.once_if_unfinished = vec4<u32>(min(unfinished, 1u), 1u, 1u, 0u);
    status[0] += select(0u, unfinished, step.last == 1u);
}
