// Lists the marked tiles in order. See pass/tiles.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "stretches.wgsl"

@group(0) @binding(1) var<storage, read> marks: array<u32>;
@group(0) @binding(2) var<storage, read_write> list: array<u32>;
@group(0) @binding(3) var<storage, read_write> work: DispatchCounts;

// One workgroup.
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    let tiles = (frame.size.xy + 7u) / 8u;
    let count = tiles.x * tiles.y;
    let stretch = stretch_of(lane, count);
    var marked = 0u;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        marked += marks[i];
    }
    var place = sum_before(lane, marked);
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        if marks[i] != 0u {
            list[place] = i;
            place += 1u;
        }
    }
    // The last lane knows the number of listed tiles. One workgroup for each, spread over two dimensions.
    if lane == 63u {
        atomicStore(&work.live, place);
        work.once_if_live = vec4<u32>(min(place, 1u), 1u, 1u, 0u);
        let x = min(place, 32768u);
        work.list_groups = vec4<u32>(x, select(0u, (place + x - 1u) / max(x, 1u), x > 0u), 1u, 0u);
    }
}
