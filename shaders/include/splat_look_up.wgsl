// Look-ups in the grid of hits. Needs splats.wgsl and an array `splat_buckets`. CPU twin: pass::splat_light.

// A disc around a point, of one cell's radius, meets three cells along each axis.
const SPLAT_CELLS: u32 = 27u;

struct SplatLookUp {
    at: vec3<f32>,      // the point in cells
    lower: vec3<i32>,   // the first cell
    surface: u32,
}

// Hits in one of the cells.
struct SplatCell {
    code: u32,
    first: u32,
    count: u32,
}

fn splat_look_up(position: vec3<f32>, surface: u32, width: f32) -> SplatLookUp {
    let at = splat_cells(position, width);
    return SplatLookUp(at, vec3<i32>(floor(at)) - 1, surface);
}

// Number `k` of its cells: empty if the disc does not reach it.
fn splat_cell(look_up: SplatLookUp, k: u32) -> SplatCell {
    let cell = look_up.lower + vec3<i32>(vec3<u32>(k % 3u, k / 3u % 3u, k / 9u));
    let low = vec3<f32>(cell);
    let away = max(max(low - look_up.at, look_up.at - low - 1.0), vec3<f32>(0.0));
    let code = splat_code(cell, look_up.surface);
    let bucket = splat_bucket(code);
    let ends = splat_buckets[bucket];
    // Hits lie in their cells but for rounding.
    return SplatCell(code, ends.x, select(0u, ends.y - ends.x, dot(away, away) <= 1.001));
}
