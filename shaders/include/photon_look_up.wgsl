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

// Of the cell at `corner`, the photons from `first` to `end`: code of the cell, first photon, one past the last.
fn in_cell(lower: vec3<i32>, corner: vec3<i32>, of_class: u32, first: u32, end: u32) -> vec3<u32> {
    let code = code_of(lower + corner, of_class);
    let bucket = bucket_of(code);
    let begin = max(buckets[2u * bucket], first);
    return vec3<u32>(code, begin, max(min(buckets[2u * bucket + 1u], end), begin));
}

// A dispatch takes only the photons of its own stretch, so its loop is bounded.
// Straight-line code: loops over such arrays take a fifth longer on lavapipe, and count against the bound of a dispatch.
fn look_up(position: vec3<f32>, of_class: u32, first: u32, end: u32) -> LookUp {
    let lower = first_cell(position);
    var cells: LookUp;
    let cell0 = in_cell(lower, vec3<i32>(0, 0, 0), of_class, first, end);
    let cell1 = in_cell(lower, vec3<i32>(1, 0, 0), of_class, first, end);
    let cell2 = in_cell(lower, vec3<i32>(0, 1, 0), of_class, first, end);
    let cell3 = in_cell(lower, vec3<i32>(1, 1, 0), of_class, first, end);
    let cell4 = in_cell(lower, vec3<i32>(0, 0, 1), of_class, first, end);
    let cell5 = in_cell(lower, vec3<i32>(1, 0, 1), of_class, first, end);
    let cell6 = in_cell(lower, vec3<i32>(0, 1, 1), of_class, first, end);
    let cell7 = in_cell(lower, vec3<i32>(1, 1, 1), of_class, first, end);
    cells.codes = array<u32, 8>(cell0.x, cell1.x, cell2.x, cell3.x, cell4.x, cell5.x, cell6.x, cell7.x);
    let after0 = cell0.z - cell0.y;
    let after1 = after0 + (cell1.z - cell1.y);
    let after2 = after1 + (cell2.z - cell2.y);
    let after3 = after2 + (cell3.z - cell3.y);
    let after4 = after3 + (cell4.z - cell4.y);
    let after5 = after4 + (cell5.z - cell5.y);
    let after6 = after5 + (cell6.z - cell6.y);
    cells.total = after6 + (cell7.z - cell7.y);
    cells.after = array<u32, 8>(after0, after1, after2, after3, after4, after5, after6, cells.total);
    cells.add = array<u32, 8>(
        cell0.y, cell1.y - after0, cell2.y - after1, cell3.y - after2,
        cell4.y - after3, cell5.y - after4, cell6.y - after5, cell7.y - after6,
    );
    return cells;
}

// Code of the cell of photon j of a look-up, and its place in the grid.
fn looked_up(cells: LookUp, j: u32) -> vec2<u32> {
    var found = vec2<u32>(cells.codes[0], cells.add[0]);
    found = select(found, vec2<u32>(cells.codes[1], cells.add[1]), j >= cells.after[0]);
    found = select(found, vec2<u32>(cells.codes[2], cells.add[2]), j >= cells.after[1]);
    found = select(found, vec2<u32>(cells.codes[3], cells.add[3]), j >= cells.after[2]);
    found = select(found, vec2<u32>(cells.codes[4], cells.add[4]), j >= cells.after[3]);
    found = select(found, vec2<u32>(cells.codes[5], cells.add[5]), j >= cells.after[4]);
    found = select(found, vec2<u32>(cells.codes[6], cells.add[6]), j >= cells.after[5]);
    found = select(found, vec2<u32>(cells.codes[7], cells.add[7]), j >= cells.after[6]);
    return found + vec2<u32>(0u, j);
}
