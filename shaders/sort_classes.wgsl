// Finds the first shading point and the first cluster of each class of pixels on the sorted list. See pass/sort.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "sort.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> counts: array<u32>;           // prefix sums of the digit whose upper bits are the class
@group(0) @binding(3) var<storage, read_write> classes: array<vec2<u32>>;  // first cluster, first shading point; one past the last: all

@compute @workgroup_size(1)
fn main() {
    let runs = ceil_div(work.total, RUN);
    var cluster = 0u;
    let count = frame.pattern.z;
    let shift = 8u - class_bits(count);
    for (var k = 0u; k < count; k += 1u) {
        let begin = counts[(k << shift) * runs];
        classes[k] = vec2<u32>(cluster, begin);
        cluster += ceil_div(counts[((k + 1u) << shift) * runs] - begin, 64u);
    }
    classes[count] = vec2<u32>(cluster, counts[(count << shift) * runs]);
}
