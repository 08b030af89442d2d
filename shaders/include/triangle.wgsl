// Triangles and rays.

@group(0) @binding(3) var<storage, read> triangle_v0: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> triangle_e2: array<vec4<f32>>;

struct Hit {
    t: f32,
    u: f32,
    v: f32,
    ok: bool,
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
