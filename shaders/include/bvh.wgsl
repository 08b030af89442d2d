// The threaded BVH (accel.rs) and one step of its traversal.
//
// node_min[i] = box minimum, bits of the skip index; node_max[i] = box maximum, bits of the leaf word
// (0: inner node, else first triangle << 3 | count). Nodes lie in depth-first order: a hit inner node continues at i + 1,
// everything else at its skip index, and the traversal's whole state is that index.

@group(0) @binding(1) var<storage, read> node_min: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> node_max: array<vec4<f32>>;

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
