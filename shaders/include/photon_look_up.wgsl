// Look-ups in the grid of photons. Needs photons.wgsl, work.wgsl and an array `buckets`.

// Minimum cosine between the normals of a photon and of the point that it lights. Host twin: pass::photon_light::MIN_COSINE.
const MIN_COSINE: f32 = 0.5;

// The photons of the eight cells around a point are counted through: `after` is one past the last of a cell, `add` the offset from the
// count to the place in the grid.
struct LookUp {
    codes: array<u32, 8>,
    after: array<u32, 8>,
    add: array<u32, 8>,
    total: u32,
}

// A dispatch takes only the photons of its own stretch, so its loop is bounded.
fn look_up(position: vec3<f32>, of_class: u32, first: u32, end: u32) -> LookUp {
    let lower = first_cell(position);
    var cells: LookUp;
    cells.total = 0u;
    for (var corner = 0u; corner < 8u; corner += 1u) {
        let cell = lower + vec3<i32>(vec3<u32>(corner & 1u, (corner >> 1u) & 1u, corner >> 2u));
        let code = code_of(cell, of_class);
        let bucket = bucket_of(code);
        let begin = max(buckets[2u * bucket], first);
        let close = max(min(buckets[2u * bucket + 1u], end), begin);
        cells.codes[corner] = code;
        cells.add[corner] = begin - cells.total;
        cells.total += close - begin;
        cells.after[corner] = cells.total;
    }
    return cells;
}

// Code of the cell of photon j of a look-up, and its place in the grid.
fn looked_up(cells: ptr<function, LookUp>, j: u32) -> vec2<u32> {
    var found = vec2<u32>((*cells).codes[0], j + (*cells).add[0]);
    for (var corner = 1u; corner < 8u; corner += 1u) {
        found = select(found, vec2<u32>((*cells).codes[corner], j + (*cells).add[corner]), vec2<bool>(j >= (*cells).after[corner - 1u]));
    }
    return found;
}
