// A point on a surface for each texel, as if a ray had met it along its normal. See pass/atlas.rs.
#include "frame.wgsl"

@group(0) @binding(1) var<storage, read> texels: array<vec4<u32>>;         // triangle (none: all ones), bits of u and v, 1 from the back
@group(0) @binding(2) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> triangle_e2: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> hits: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> throughput: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let slot = (group.x + group.y * groups.x) * 64u + lane;
    if slot >= frame.size.z {
        return;
    }
    let texel = texels[slot];
    let covered = texel.x != 0xffffffffu;
    let triangle = select(0u, texel.x, covered);
    let face = cross(triangle_e1[triangle].xyz, triangle_e2[triangle].xyz);
    // The largest component first: squares of small faces would underflow.
    let scaled = face / max(max(abs(face.x), abs(face.y)), max(abs(face.z), 1e-37));
    let normal = scaled / sqrt(dot(scaled, scaled));
    hits[slot] = vec4<f32>(select(0.0, 1.0, covered), bitcast<f32>(texel.y), bitcast<f32>(texel.z), bitcast<f32>(texel.x));
    ray_direction[slot] = vec4<f32>(select(-normal, normal, texel.w != 0u), 1.0);
    throughput[slot] = vec4<f32>(1.0, 1.0, 1.0, 0.0);
    emitted[slot] = vec4<f32>(0.0);
}
