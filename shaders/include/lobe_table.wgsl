// Lobes by tabulated values. Needs math.wgsl. CPU twin: bsdf::table, which says what the function is, how directions are chosen, and what the number
// that stands for a table holds.
#include "lobe_width.wgsl"

// For each material where its table and its widened table begin, then the tables; layout as bsdf::table::words has it.
@group(0) @binding(66) var<storage, read> lobe_tables: array<u32>;

struct LobeTable {
    cosines: u32,           // where parts begin
    azimuths: u32,
    values: u32,
    partial: u32,
    reflected: u32,
    n: u32,                 // cosines
    m: u32,                 // azimuths
}

// An interval of an axis and the weight of its end.
struct TablePlace {
    cell: u32,
    t: f32,
}

fn lobe_table(alpha: f32) -> LobeTable {
    let word = bitcast<u32>(alpha) - TABLE_BASE;
    let at = lobe_tables[2u * ((word >> 10u) - 1u) + (word & 1u)];
    let n = lobe_tables[at];
    let m = lobe_tables[at + 1u];
    let values = at + 2u + n + m;
    return LobeTable(at + 2u, at + 2u + n, values, values + n * n * m, values + 2u * n * n * m, n, m);
}

fn table_at(place: u32) -> f32 {
    return bitcast<f32>(lobe_tables[place]);
}

// Eight such steps find one of 255 intervals; not a loop, because shading loops are bounded together.
fn table_step(nodes: u32, last: u32, low: u32, step: u32, x: f32) -> u32 {
    let next = low + step;
    return select(low, next, next <= last && table_at(nodes + min(next, last)) <= x);
}

// The last of `count` - 1 intervals that begins at x or before, or else the first.
fn table_cell(nodes: u32, count: u32, x: f32) -> u32 {
    let last = count - 2u;
    var k = table_step(nodes, last, 0u, 128u, x);
    k = table_step(nodes, last, k, 64u, x);
    k = table_step(nodes, last, k, 32u, x);
    k = table_step(nodes, last, k, 16u, x);
    k = table_step(nodes, last, k, 8u, x);
    k = table_step(nodes, last, k, 4u, x);
    k = table_step(nodes, last, k, 2u, x);
    return table_step(nodes, last, k, 1u, x);
}

fn table_place(nodes: u32, count: u32, x: f32) -> TablePlace {
    let k = table_cell(nodes, count, x);
    let low = table_at(nodes + k);
    return TablePlace(k, clamp((x - low) / (table_at(nodes + k + 1u) - low), 0.0, 1.0));
}

// Of nodes mixed from two places.
fn table_mixed(first: u32, second: u32, t: f32) -> f32 {
    let a = table_at(first);
    return a + (table_at(second) - a) * t;
}

fn table_mixed_step(first: u32, second: u32, t: f32, last: u32, low: u32, step: u32, x: f32) -> u32 {
    let next = low + step;
    let k = min(next, last);
    return select(low, next, next <= last && table_mixed(first + k, second + k, t) <= x);
}

fn table_mixed_cell(first: u32, second: u32, t: f32, count: u32, x: f32) -> u32 {
    let last = count - 2u;
    var k = table_mixed_step(first, second, t, last, 0u, 128u, x);
    k = table_mixed_step(first, second, t, last, k, 64u, x);
    k = table_mixed_step(first, second, t, last, k, 32u, x);
    k = table_mixed_step(first, second, t, last, k, 16u, x);
    k = table_mixed_step(first, second, t, last, k, 8u, x);
    k = table_mixed_step(first, second, t, last, k, 4u, x);
    k = table_mixed_step(first, second, t, last, k, 2u, x);
    return table_mixed_step(first, second, t, last, k, 1u, x);
}

// The albedo.
fn table_albedo(table: LobeTable, o: TablePlace) -> f32 {
    let at = table.reflected + (o.cell + 1u) * table.n - 1u;
    return table_mixed(at, at + table.n, o.t);
}

// f.
fn table_value(table: LobeTable, n: vec3<f32>, wi: vec3<f32>, wo: vec3<f32>, i: TablePlace, o: TablePlace) -> f32 {
    let across = abs(dot(n, cross(wi, wo)));
    let along = dot(wi, wo) - dot(n, wi) * dot(n, wo);
    // Along the normal there is no azimuth, and f is the same for all.
    let nowhere = across == 0.0 && along == 0.0;
    let azimuth = atan2(across, select(along, 1.0, nowhere));
    let l = table_place(table.azimuths, table.m, azimuth);
    let at = table.values + (o.cell * table.n + i.cell) * table.m + l.cell;
    let beside = at + table.m;
    let next = at + table.n * table.m;
    let here = mix(table_mixed(at, at + 1u, l.t), table_mixed(beside, beside + 1u, l.t), i.t);
    let there = mix(table_mixed(next, next + 1u, l.t), table_mixed(next + table.m, next + table.m + 1u, l.t), i.t);
    return mix(here, there, o.t);
}

// The lobe without its Fresnel term, for unit directions above the surface.
fn table_lobe(alpha: f32, n: vec3<f32>, wi: vec3<f32>, wo: vec3<f32>) -> f32 {
    let table = lobe_table(alpha);
    let i = table_place(table.cosines, table.n, dot(n, wi));
    let o = table_place(table.cosines, table.n, dot(n, wo));
    return table_value(table, n, wi, wo, i, o);
}

// Density over solid angle of the directions of table_sample.
fn table_density(alpha: f32, n: vec3<f32>, wi: vec3<f32>, wo: vec3<f32>) -> f32 {
    let table = lobe_table(alpha);
    let i = table_place(table.cosines, table.n, dot(n, wi));
    let o = table_place(table.cosines, table.n, dot(n, wo));
    let albedo = table_albedo(table, o);
    return select(0.0, table_value(table, n, wi, wo, i, o) * dot(n, wi) / max(albedo, 1e-37), albedo > 0.0);
}

// Position in [0, 1] for a uniform number, of a density that goes linearly from a to b.
fn sample_linear(a: f32, b: f32, u: f32) -> f32 {
    let root = sqrt(max(a * a + (b * b - a * a) * u, 0.0));
    return clamp(u * (a + b) / max(a + root, 1e-37), 0.0, 1.0);
}

// The same of a density that is the product of two functions that go linearly from x to y, a and b.
fn sample_product(a: vec2<f32>, b: vec2<f32>, u: f32) -> f32 {
    // Six times the integrals of the three parts.
    let parts = vec3<f32>(2.0 * a.x * b.x, a.x * b.y + a.y * b.x, 2.0 * a.y * b.y);
    let whole = u * (parts.x + parts.y + parts.z);
    let both = parts.x + parts.y;
    let within = clamp((vec3<f32>(whole) - vec3<f32>(0.0, parts.x, both)) / max(parts, vec3<f32>(1e-37)), vec3<f32>(0.0), vec3<f32>(1.0));
    let low = 1.0 - pow(1.0 - within.x, 1.0 / 3.0);
    let middle = 0.5 - sin(asin(1.0 - 2.0 * within.y) * (1.0 / 3.0));
    let high = pow(within.z, 1.0 / 3.0);
    return select(select(high, middle, whole < both), low, whole < parts.x);
}

// A direction above the surface; w: the lobe without its Fresnel term, times the cosine, over the density: the albedo.
fn table_sample(alpha: f32, n: vec3<f32>, wo: vec3<f32>, u: f32, v: f32) -> vec4<f32> {
    let table = lobe_table(alpha);
    let o = table_place(table.cosines, table.n, dot(n, wo));
    // One of both rows.
    let totals = table.reflected + (o.cell + 1u) * table.n - 1u;
    let one = (1.0 - o.t) * table_at(totals);
    let both = one + o.t * table_at(totals + table.n);
    let share = one / max(both, 1e-37);
    let takes_one = u < share;
    let row = o.cell + select(1u, 0u, takes_one);
    let along = select((u - share) / max(1.0 - share, 1e-7), u / max(share, 1e-37), takes_one);
    // The cosine.
    let sums = table.reflected + row * table.n;
    let of_cosine = along * table_at(sums + table.n - 1u);
    let i = table_cell(sums, table.n, of_cosine);
    let before = table_at(sums + i);
    let rest = clamp((of_cosine - before) / max(table_at(sums + i + 1u) - before, 1e-37), 0.0, 1.0);
    let low = (row * table.n + i) * table.m;
    let part = table.partial + low;
    let whole = vec2<f32>(table_at(part + table.m - 1u), table_at(part + 2u * table.m - 1u));
    let ends = vec2<f32>(table_at(table.cosines + i), table_at(table.cosines + i + 1u));
    let t = sample_product(whole, ends, rest);
    let cosine = ends.x + (ends.y - ends.x) * t;
    // The azimuth, of either sign.
    let of_azimuth = abs(2.0 * v - 1.0) * table_mixed(part + table.m - 1u, part + 2u * table.m - 1u, t);
    let l = table_mixed_cell(part, part + table.m, t, table.m, of_azimuth);
    let sum = table_mixed(part + l, part + table.m + l, t);
    let width = table_mixed(part + l + 1u, part + table.m + l + 1u, t) - sum;
    let at = table.values + low + l;
    let z = sample_linear(table_mixed(at, at + table.m, t), table_mixed(at + 1u, at + table.m + 1u, t), clamp((of_azimuth - sum) / max(width, 1e-37), 0.0, 1.0));
    let azimuth = table_mixed(table.azimuths + l, table.azimuths + l + 1u, z);
    let flat = wo - n * dot(n, wo);
    let length2 = dot(flat, flat);
    let frame_n = basis(n);
    let x = select(frame_n[0], flat / sqrt(max(length2, 1e-37)), length2 > 1e-12);
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    let side = select(sin(azimuth), -sin(azimuth), v < 0.5);
    let wi = x * (sine * cos(azimuth)) + cross(n, x) * (sine * side) + n * cosine;
    return vec4<f32>(wi, both);
}
