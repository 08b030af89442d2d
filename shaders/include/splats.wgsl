// Hits of particles on glossy surfaces, and the hash grid that they are found in. Needs math.wgsl. CPU twins: pass::splat_grid,
// pass::splat_light.

struct SplatParameters {
    capacity: u32,      // maximum number of hits
    buckets: u32,       // buckets of the hash table - 1 (a power of 2)
    particles: u32,     // of a batch
    slots: u32,         // for hits of a batch: `particles` for each number of bounces
    chunk: u32,         // candidates of a point that one dispatch takes
    rounds: u32,        // dispatches for all candidates that a point may have
    width: f32,         // C of h = C sqrt(A / n)
    alpha: f32,         // splats show lobes with a greater alpha
}

@group(0) @binding(30) var<storage, read> splat_parameters: SplatParameters;

// Entries of `splat_state`.
const SPLAT_HITS: u32 = 0u;         // hits stored
const SPLAT_PARTICLES: u32 = 1u;    // particles of the batches that are stored
const SPLAT_FIRST: u32 = 2u;        // first particle of the present batch
const SPLAT_COUNT: u32 = 3u;        // particles of the present batch
const SPLAT_BASE: u32 = 4u;         // place of its first hit; NO_PLACE: they do not fit
const SPLAT_FULL: u32 = 5u;         // 1: a batch did not fit, and no more are traced

const NO_PLACE: u32 = 0xffffffffu;

// A hit is two vectors: position and surface + 1 (0: none); flux, and direction and bounces.
struct SplatHit {
    position: vec3<f32>,
    surface: u32,
    flux: vec3<f32>,
    wi: vec3<f32>,      // back along the last ray
    bounces: u32,
}

// Texels of a row of the image of sorted hits. Host twin: pass::splat_grid::ACROSS.
const ACROSS_BITS: u32 = 12u;

// Place of a number in it.
fn sorted_place(i: u32) -> vec2<i32> {
    return vec2<i32>(vec2<u32>(i & ((1u << ACROSS_BITS) - 1u), i >> ACROSS_BITS));
}

// Direction by octahedral encoding in 2 x 14 bits, bounces in 4.
fn pack_arrival(wi: vec3<f32>, bounces: u32) -> u32 {
    let p = wi.xy / (abs(wi.x) + abs(wi.y) + abs(wi.z));
    let folded = (1.0 - abs(p.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), p >= vec2<f32>(0.0));
    let e = select(folded, p, wi.z >= 0.0);
    let q = vec2<u32>(clamp(e, vec2<f32>(-1.0), vec2<f32>(1.0)) * 8191.0 + 8192.0 + 0.5);
    return q.x | q.y << 14u | bounces << 28u;
}

fn arrival_of(word: u32) -> vec3<f32> {
    let q = vec2<u32>(word, word >> 14u) & vec2<u32>(16383u);
    let e = (vec2<f32>(q) - 8192.0) / 8191.0;
    let z = 1.0 - abs(e.x) - abs(e.y);
    let fold = max(-z, 0.0);
    let n = vec3<f32>(e - select(vec2<f32>(-fold), vec2<f32>(fold), e >= vec2<f32>(0.0)), z);
    return n / sqrt(dot(n, n));
}

// Code of a cell of a surface; cells are half as wide as the surface's kernels. Codes of the 27 cells around a point differ.
fn splat_code(cell: vec3<i32>, surface: u32) -> u32 {
    let c = bitcast<vec3<u32>>(cell);
    return c.x * 0x9e3779b1u + c.y * 0x85ebca77u + c.z * 0xc2b2ae3du + surface * 0x27d4eb2fu;
}

// A position in cells of a surface with kernels of this width, clamped to the range of integers.
fn splat_cells(p: vec3<f32>, width: f32) -> vec3<f32> {
    return clamp(p / max(0.5 * width, 1e-37), vec3<f32>(-1e9), vec3<f32>(1e9));
}

fn splat_bucket(code: u32) -> u32 {
    return hash(code) & splat_parameters.buckets;
}
