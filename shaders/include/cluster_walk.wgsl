// A subgroup walks the wide tree (accel::wide) for a cluster of 64 rays with a common origin. Needs subgroup.wgsl and triangle.wgsl.
// AREA: the rays start at points of an area light; its centre counts as the origin.

@group(0) @binding(1) var<storage, read> wide_nodes: array<vec4<f32>>;

// Rays that each lane holds.
const RAYS: u32 = 64u / LANES;
// Children of a node, or triangles of a leaf, that each lane holds: eight in all; the lanes from 8 on repeat them.
const PARTS: u32 = 8u / min(LANES, 8u);
// Registers that hold the sixteen words of the stack, lane by lane. The host takes these kernels only where that is enough
// (accel::wide::stack_bound).
const WORDS: u32 = 16u / min(LANES, 16u);
// Visits of triangles whose loops are as long as those over one more that lets rays pass. Host twin: plan::alpha_visits.
const ALPHA_VISITS: u32 = RAYS + 5u;
// Leaves whose triangles may wait to be looked up, one in each lane of the smallest subgroup.
const WAITING_LEAVES: u32 = 4u;

// Number of the child or triangle that a lane holds in a part.
fn number_of(part: u32, lane: u32) -> u32 {
    return part * LANES + (lane & 7u);
}

// The value of child or triangle k, for all lanes.
fn u32_of(values: ptr<function, array<u32, PARTS>>, k: u32) -> u32 {
    return subgroupShuffle(select((*values)[0], (*values)[PARTS - 1u], k >= LANES), k & (LANES - 1u));
}

fn vec3_of(values: ptr<function, array<vec3<f32>, PARTS>>, k: u32) -> vec3<f32> {
    return subgroupShuffle(select((*values)[0], (*values)[PARTS - 1u], k >= LANES), k & (LANES - 1u));
}

// Where the walk stands. Inner children of a node are consecutive nodes.
struct Walk {
    base: u32,                      // node of the first child
    pending: u32,                   // mask of the children still to visit
    // Each word holds the base of earlier nodes and, from bit 24, their pending mask. Lane i holds word i, and where there are
    // more words than lanes word i + LANES, and so on.
    stack: array<u32, WORDS>,
    top: u32,                       // number of words
}

// Puts the children `rest` of the present base on the stack, if there are any.
fn push_rest(walk: ptr<function, Walk>, rest: u32, lane: u32) {
    let push = rest != 0u;
    let word = (*walk).base | (rest << 24u);
    for (var w = 0u; w < WORDS; w += 1u) {
        (*walk).stack[w] = select((*walk).stack[w], word, push && lane + w * LANES == (*walk).top);
    }
    (*walk).top += select(0u, 1u, push);
}

// Goes back to the children on top of the stack if none is pending. Returns whether it did.
fn pop_if_done(walk: ptr<function, Walk>) -> bool {
    let pop = (*walk).pending == 0u && (*walk).top > 0u;
    (*walk).top -= select(0u, 1u, pop);
    let top = (*walk).top;
    var words = (*walk).stack[0];
    for (var w = 1u; w < WORDS; w += 1u) {
        words = select(words, (*walk).stack[w], top / LANES == w);
    }
    let popped = subgroupShuffle(words, top & (LANES - 1u));
    (*walk).base = select((*walk).base, popped & 0xffffffu, pop);
    (*walk).pending = select((*walk).pending, popped >> 24u, pop);
    return pop;
}

// A child of a node; its box is relative to the origin of the rays.
struct Child {
    lo: vec3<f32>,
    hi: vec3<f32>,
    entry: u32,             // of a leaf the first triangle and, from bit 28, the number of triangles; else a node
}

fn load_child(node: u32, k: u32, origin: vec3<f32>) -> Child {
    let a = wide_nodes[16u * node + 2u * k];
    let b = wide_nodes[16u * node + 2u * k + 1u];
    return Child(a.xyz - origin, b.xyz - origin, bitcast<u32>(a.w) | (bitcast<u32>(b.w) << 28u));
}

fn is_leaf_entry(entry: u32) -> bool {
    return entry >= 0x10000000u;
}

// Whether a ray meets a box before t_max, by its parameters at the two corners. Integers order like floats here: negative values
// need no order.
fn slabs_meet(t_lo: vec3<f32>, t_hi: vec3<f32>, t_max: f32) -> bool {
    let t0 = bitcast<vec3<i32>>(t_lo);
    let t1 = bitcast<vec3<i32>>(t_hi);
    let near3 = min(t0, t1);
    let far3 = max(t0, t1);
    let near = bitcast<f32>(max(max(near3.x, near3.y), max(near3.z, 0)));
    let far = bitcast<f32>(min(min(far3.x, far3.y), min(far3.z, bitcast<i32>(t_max)))) * 1.000001;
    return near <= far;
}

// A triangle as planes through the origin and each edge.
struct Planes {
    n0: vec3<f32>,
    n1: vec3<f32>,
    n_sum: vec3<f32>,       // sum of all three: twice the triangle's own normal
    reach: f32,             // n_sum . d of a ray that ends on the triangle's plane; 0: seen exactly edge on
#if AREA
    // To move the planes to another origin q, the sum b + c of corners becomes b + c - 2 q.
    edge0: vec3<f32>,
    edge1: vec3<f32>,
#endif
}

struct TriangleSetUp {
    planes: Planes,
    lo: vec3<f32>,          // box
    hi: vec3<f32>,
}

// The slack of a single ray's test makes each product larger by that share of their sum.
const SLACK: f32 = 1e-5;

fn set_up_triangle(i: u32, origin: vec3<f32>) -> TriangleSetUp {
    let a = triangle_v0[i].xyz - origin;
    let e1 = triangle_e1[i].xyz;
    let e2 = triangle_e2[i].xyz;
    let b = a + e1;
    let c = a + e2;
    // The planes are formed from differences: products of far corners would lose the depth of small triangles. All are turned so
    // that a ray inside has positive products, which are then proportional to barycentric coordinates.
    let face = cross(e1, e2);
    let depth = dot(face, a);
#if AREA
    // Rays from different points may come from different sides: each ray turns the planes itself.
    let side = 1.0;
#else
    let side = select(1.0, -1.0, depth < 0.0);
#endif
    let m0 = side * cross(e1 - e2, b + c);
    let m1 = side * cross(e2, c + a);
    let m2 = side * cross(-e1, a + b);
    let slack = SLACK * (m0 + m1 + m2);
    var t: TriangleSetUp;
    t.planes.n0 = m0 + slack;
    t.planes.n1 = m1 + slack;
    t.planes.n_sum = (side * 2.0 * (1.0 + 3.0 * SLACK)) * face;
#if AREA
    t.planes.reach = depth * (2.0 * (1.0 + 3.0 * SLACK));
    t.planes.edge0 = 2.0 * (e1 - e2);
    t.planes.edge1 = 2.0 * e2;
#else
    t.planes.reach = abs(depth) * (2.0 * (1.0 + 3.0 * SLACK));
#endif
    t.lo = min(a, min(b, c));
    t.hi = max(a, max(b, c));
    return t;
}

// The planes of triangle k, for all lanes.
fn planes_of(planes: ptr<function, array<Planes, PARTS>>, k: u32) -> Planes {
    let upper = k >= LANES;
    let at = k & (LANES - 1u);
    var found: Planes;
    found.n0 = subgroupShuffle(select((*planes)[0].n0, (*planes)[PARTS - 1u].n0, upper), at);
    found.n1 = subgroupShuffle(select((*planes)[0].n1, (*planes)[PARTS - 1u].n1, upper), at);
    found.n_sum = subgroupShuffle(select((*planes)[0].n_sum, (*planes)[PARTS - 1u].n_sum, upper), at);
    found.reach = subgroupShuffle(select((*planes)[0].reach, (*planes)[PARTS - 1u].reach, upper), at);
#if AREA
    found.edge0 = subgroupShuffle(select((*planes)[0].edge0, (*planes)[PARTS - 1u].edge0, upper), at);
    found.edge1 = subgroupShuffle(select((*planes)[0].edge1, (*planes)[PARTS - 1u].edge1, upper), at);
#endif
    return found;
}

// Products of a ray with n0, n1 and n_sum.
fn products(planes: Planes, d: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(planes.n0, d), dot(planes.n1, d), dot(planes.n_sum, d));
}

// Whether the ray passes between all three edges.
fn passes_inside(b: vec3<f32>) -> bool {
    return b.x >= 0.0 && b.y >= 0.0 && b.z - b.x >= b.y;
}
