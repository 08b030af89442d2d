// values[i] = values[i] * scale + i for the first `count` elements.
// BROKEN: without a look at the number of elements: the checks must notice.
#include "linear_index.wgsl"

struct FillPush { count: u32, scale: u32 }
var<immediate> push: FillPush;

@group(0) @binding(0) var<storage, read_write> values: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = linear_group(group, groups) * 64u + lane;
#if BROKEN
    if i >= arrayLength(&values) { return; }
#else
    if i >= push.count { return; }
#endif
    values[i] = values[i] * push.scale + i;
}
