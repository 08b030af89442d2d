// Surfaces that let rays pass. Needs triangle.wgsl and math.wgsl. CPU twin: accel::alpha.
#include "material.wgsl"
#include "texture.wgsl"

@group(0) @binding(21) var<storage, read> triangle_uvs: array<vec4<f32>>;
@group(0) @binding(22) var<storage, read> materials: array<MaterialRecord>;

const NO_TRIANGLE: u32 = 0xffffffffu;

fn has_alpha(triangle: u32) -> bool {
    return (materials[bitcast<u32>(triangle_v0[triangle].w)].flags.w & MATERIAL_ALPHA) != 0u;
}

// Whether a texture says where rays may pass.
fn is_patterned(triangle: u32) -> bool {
    let flags = materials[bitcast<u32>(triangle_v0[triangle].w)].flags;
    return (flags.w & MATERIAL_ALPHA) != 0u && flags.x != 0u;
}

// Share of rays that a triangle stops at barycentric coordinates u and v of its second and third corner.
fn coverage_at(triangle: u32, u: f32, v: f32) -> f32 {
    let material = materials[bitcast<u32>(triangle_v0[triangle].w)];
    var alpha = bitcast<f32>(material.normal.z);
    for (var j = select(0u, 1u, is_patterned(triangle)); j > 0u; j -= 1u) {
        let uvs = triangle_uvs[2u * triangle];
        let more = triangle_uvs[2u * triangle + 1u];
        alpha *= sample_finest(material.flags.x - 1u, (1.0 - u - v) * uvs.xy + u * uvs.zw + v * more.xy).w;
    }
    let cutoff = bitcast<f32>(material.normal.w);
    return select(alpha, select(0.0, 1.0, alpha >= cutoff), cutoff >= 0.0);
}

// Whether a triangle stops a ray: chosen anew for each pass, direction and triangle, as often as the triangle covers.
fn is_stopped(triangle: u32, u: f32, v: f32, d: vec3<f32>) -> bool {
    let coverage = coverage_at(triangle, u, v);
    let bits = bitcast<vec3<u32>>(d);
    return coverage >= 1.0 || random(key(frame.keys.x, STREAM_ALPHA, triangle, hash(bits.x ^ hash(bits.y ^ hash(bits.z))))) < coverage;
}
