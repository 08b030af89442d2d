// The threaded BVH (accel.rs) and one step of its traversal.
//
// node_min[i] = box minimum, bits of the skip index; node_max[i] = box maximum, bits of the leaf word
// (0: inner node, else first triangle << 3 | count). Nodes lie in depth-first order: a hit inner node continues at i + 1,
// everything else at its skip index, and the traversal's whole state is that index.

@group(0) @binding(1) var<storage, read> node_min: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> node_max: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> triangle_v0: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> triangle_e2: array<vec4<f32>>;

struct Hit {
    t: f32,
    u: f32,
    v: f32,
    ok: bool,
}

// 1/d without infinities: a component too small to divide by counts as a tiny one of the same sign, so that no product in
// the slab test is 0 * inf and no NaN reaches min or max.
fn safe_inverse(d: vec3<f32>) -> vec3<f32> {
    let tiny = vec3<f32>(1e-30);
    let guarded = select(d, select(tiny, -tiny, d < vec3<f32>(0.0)), abs(d) < tiny);
    return 1.0 / guarded;
}

// The part of the ray inside a box, as (near, far); empty when near > far. Far is widened by more than
// the rounding of the test: it may never lose a triangle.
fn slab(lo: vec3<f32>, hi: vec3<f32>, origin: vec3<f32>, inverse: vec3<f32>, t_max: f32) -> vec2<f32> {
    let a = (lo - origin) * inverse;
    let b = (hi - origin) * inverse;
    let near3 = min(a, b);
    let far3 = max(a, b);
    let near = max(max(near3.x, near3.y), max(near3.z, 0.0));
    let far = min(min(far3.x, far3.y), far3.z) * 1.000001;
    return vec2<f32>(near, min(far, t_max));
}

// Moeller and Trumbore 1997, both sides. The barycentric slack lets neighbours overlap along their common edge instead of
// leaving a crack. A triangle seen exactly edge on is missed.
fn intersect_triangle(i: u32, origin: vec3<f32>, d: vec3<f32>, t_max: f32) -> Hit {
    let v0 = triangle_v0[i].xyz;
    let e1 = triangle_e1[i].xyz;
    let e2 = triangle_e2[i].xyz;
    let p = cross(d, e2);
    let det = dot(e1, p);
    let inverse = 1.0 / select(det, 1.0, det == 0.0);
    let s = origin - v0;
    let u = dot(s, p) * inverse;
    let q = cross(s, e1);
    let v = dot(d, q) * inverse;
    let t = dot(e2, q) * inverse;
    let slack = 1e-5;
    let ok = det != 0.0 && u >= -slack && v >= -slack && u + v <= 1.0 + slack && t > 0.0 && t < t_max;
    return Hit(t, u, v, ok);
}
