// Adds all values, and finds their largest: within subgroups by shuffles, within the workgroup in its memory, over all
// by atomics. Works for every subgroup size that is a power of two up to 64.
#include "linear_index.wgsl"

struct ReducePush { count: u32 }
var<immediate> push: ReducePush;

struct Totals { sum: atomic<u32>, largest: atomic<u32> }
@group(0) @binding(0) var<storage, read> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> totals: Totals;

var<workgroup> sums: array<u32, 64>;
var<workgroup> maxima: array<u32, 64>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(subgroup_size) subgroup_size: u32,
) {
    let i = linear_group(group, groups) * 64u + lane;
    var value = 0u;
    if i < push.count { value = values[i]; }
    var largest = value;
    for (var step = 1u; step < subgroup_size; step *= 2u) {
        largest = max(largest, subgroupShuffleXor(largest, step));
    }
    sums[lane] = value;
    maxima[lane] = largest;
    workgroupBarrier();
    if lane == 0u {
        var sum = 0u;
        for (var k = 0u; k < 64u; k++) {
            sum += sums[k];
            largest = max(largest, maxima[k]);
        }
        atomicAdd(&totals.sum, sum);
        atomicMax(&totals.largest, largest);
    }
}
