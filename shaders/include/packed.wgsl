// Words of packed points. Host twin: cluster::points::words.
@group(0) @binding(0) var<storage, read> packed: array<u32>;

// Words of a grid: column and row of a task's first pixel, steps from one to the next, pixels of a row.
const GRID: u32 = 5u;

// Column and row of the i-th pixel of a task. `grid`: the first word of the task's grid.
fn pixel_of(grid: u32, i: u32) -> vec2<u32> {
    let of_row = max(packed[grid + 4u], 1u);
    let first = vec2<u32>(packed[grid], packed[grid + 1u]);
    return first + vec2<u32>(packed[grid + 2u], packed[grid + 3u]) * vec2<u32>(i % of_row, i / of_row);
}
