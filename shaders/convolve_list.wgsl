// Lists the marked tiles of a level in order; those above the image are marked if a tile below them is. See
// pass/convolve/occupied.rs.
#include "convolve.wgsl"
#include "stretches.wgsl"

@group(0) @binding(1) var<storage, read_write> marks: array<u32>;
@group(0) @binding(2) var<storage, read_write> occupied: array<u32>;
@group(0) @binding(3) var<storage, read_write> counts: array<vec4<u32>>;

// One workgroup.
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    let here = steps[push.step];
    let below = steps[max(push.step, 1u) - 1u];
    let count = here.tiles.x * here.tiles.y;
    let stretch = stretch_of(lane, count);
    var marked = 0u;
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        if here.level > 0u {
            let at = min(2u * vec2<u32>(i % here.tiles.x, i / here.tiles.x), below.tiles - 1u);
            let next = min(at + 1u, below.tiles - 1u);
            let upper = marks[below.first_tile + at.x + at.y * below.tiles.x] | marks[below.first_tile + next.x + at.y * below.tiles.x];
            let lower = marks[below.first_tile + at.x + next.y * below.tiles.x] | marks[below.first_tile + next.x + next.y * below.tiles.x];
            marks[here.first_tile + i] = upper | lower;
        }
        marked += marks[here.first_tile + i];
    }
    var place = sum_before(lane, marked);
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        if marks[here.first_tile + i] != 0u {
            occupied[here.first_tile + place] = i;
            place += 1u;
        }
    }
    // The last lane knows the number of listed tiles: one workgroup for each, spread over two dimensions. And one invocation for each
    // tile of the level, if there are any.
    if lane == 63u {
        let x = min(place, 32768u);
        counts[2u * here.level] = vec4<u32>(x, select(0u, (place + x - 1u) / max(x, 1u), x > 0u), 1u, place);
        let all = select(0u, (count + 63u) / 64u, place > 0u);
        let across = min(all, 32768u);
        counts[2u * here.level + 1u] = vec4<u32>(across, select(0u, (all + across - 1u) / max(across, 1u), across > 0u), 1u, 0u);
    }
}
