// Surface at a hit point. Needs math.wgsl and bsdf.wgsl. CPU twin: pass::surface::surface_at.
// UNTEXTURED: there are no textures and no vertex colours.
#include "octahedral.wgsl"

#include "cosine.wgsl"
#include "material.wgsl"
#if UNTEXTURED
#else
#include "texture.wgsl"
#endif

@group(0) @binding(1) var<storage, read> triangle_normals: array<vec4<u32>>;    // three octahedral normals; w: reflector << 24 | CURVED | material << 1 | smooth
@group(0) @binding(2) var<storage, read> triangle_uvs: array<vec4<f32>>;        // two for each triangle: uv0 uv1, uv2, bits of the places of its vertex colours in triangle_normals and of its second coordinates here, or 0
@group(0) @binding(3) var<storage, read> triangle_v0: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> triangle_e2: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> materials: array<MaterialRecord>;

struct Surface {
    position: vec3<f32>,
    geometric: vec3<f32>,   // on the side that the ray came from
    shading: vec3<f32>,     // on the same side
    emission: vec3<f32>,    // back along the ray
    exitance: f32,          // over pi on this side; mean of the channels
    kind: u32,              // SURFACE_...
    front: bool,            // seen from its front
    material: u32,
    reflectance: Reflectance,   // of mirrors the diffuse base, of glass nothing
    ideal: Reflectance,     // mirrors: f0 and f90; glass: f0 is the tint
}

// Its reflector is a curved surface. Host twin: device_scene::records::CURVED.
const CURVED: u32 = 0x800000u;

fn material_of(normals: vec4<u32>) -> u32 {
    return (normals.w & 0x7fffffu) >> 1u;
}

// Whether a triangle belongs to a curved reflector.
fn is_curved(normals: vec4<u32>) -> bool {
    return (normals.w & CURVED) != 0u;
}

// Number of the glossy reflector, flat or curved, that a triangle belongs to under superposition, or 0.
fn glossy_plane(normals: vec4<u32>) -> u32 {
    let number = normals.w >> 24u;
    let counts = number <= frame.superposition.x && materials[material_of(normals)].flags.z == SURFACE_OPAQUE;
    return select(0u, number, counts);
}

// Whether eye paths may follow the lobe of a triangle.
fn is_shiny(normals: vec4<u32>) -> bool {
    let flags = materials[material_of(normals)].flags;
    return frame.choice.w > 0.0 && flags.z == SURFACE_OPAQUE && (flags.w & MATERIAL_SHINY) != 0u;
}

// Number of the frosted pane that a triangle belongs to under superposition, or 0.
fn frosted_pane(normals: vec4<u32>) -> u32 {
    let number = normals.w >> 24u;
    let counts = number <= frame.superposition.x && materials[material_of(normals)].flags.z == SURFACE_PANE;
    return select(0u, number, counts);
}

// Colour of a vertex: the square root of each channel in 10 bits.
fn decode_color(bits: u32) -> vec3<f32> {
    let root = vec3<f32>(vec3<u32>(bits, bits >> 10u, bits >> 20u) & vec3<u32>(1023u)) / 1023.0;
    return root * root;
}

// Normal of a normal map about the unit normal of a triangle's front. CPU twin: bsdf::mapped_normal.
fn mapped_normal(texel: vec3<f32>, scale: f32, e1: vec3<f32>, e2: vec3<f32>, d1: vec2<f32>, d2: vec2<f32>, n: vec3<f32>) -> vec3<f32> {
    let sign = select(1.0, -1.0, d1.x * d2.y - d1.y * d2.x < 0.0);
    let along_u = (e1 * d2.y - e2 * d1.y) * sign;
    let against_v = (e1 * d2.x - e2 * d1.x) * sign;
    let flat_u = along_u - n * dot(n, along_u);
    let u2 = dot(flat_u, flat_u);
    let t = flat_u / sqrt(max(u2, 1e-37));
    let rest = against_v - n * dot(n, against_v);
    let flat_v = rest - t * dot(t, rest);
    let v2 = dot(flat_v, flat_v);
    let b = flat_v / sqrt(max(v2, 1e-37));
    let local = texel * 2.0 - 1.0;
    let mapped = t * (local.x * scale) + b * (local.y * scale) + n * local.z;
    let length2 = dot(mapped, mapped);
    return select(n, mapped / sqrt(max(length2, 1e-37)), u2 > 0.0 && v2 > 0.0 && length2 > 0.0);
}

// Width in texture coordinates of what a cone of this width covers: the root of the area, between those along and across the cone where
// it meets a surface aslant. `face`, d1, d2: edges of the triangle, multiplied, and in texture coordinates. CPU twin:
// scene::Scene::footprint.
fn footprint_of(width: f32, cosine: f32, face: vec3<f32>, d1: vec2<f32>, d2: vec2<f32>) -> f32 {
    let of_area = abs(d1.x * d2.y - d1.y * d2.x) / sqrt(max(dot(face, face), 1e-37));
    return min(width, 1e30) * sqrt(of_area / max(cosine, 0.01));
}

// `width`: that of the cone around the ray where it ends; textures are averaged over it. 0: a point.
fn surface_at(triangle: u32, u: f32, v: f32, d: vec3<f32>, width: f32) -> Surface {
    let e1 = triangle_e1[triangle].xyz;
    let e2 = triangle_e2[triangle].xyz;
    let normals = triangle_normals[triangle];
    let position = triangle_v0[triangle].xyz + u * e1 + v * e2;
    let face = cross(e1, e2);
    let face_normal = face / sqrt(dot(face, face));
    let front = dot(face_normal, d) < 0.0;
    let geometric = select(-face_normal, face_normal, front);
    let w = 1.0 - u - v;
    let blend = w * decode_normal(normals.x) + u * decode_normal(normals.y) + v * decode_normal(normals.z);
    let smoothed = blend / sqrt(max(dot(blend, blend), 1e-20));
    let sided = select(-smoothed, smoothed, dot(smoothed, geometric) >= 0.0);
    let smooth_shading = (normals.w & 1u) != 0u;
    var shading = select(geometric, sided, smooth_shading);
    // Behind the shading normal the geometric one replaces it, to avoid black rims.
    shading = select(geometric, shading, dot(shading, d) < 0.0);

    let material = materials[material_of(normals)];
    var base = material.base.xyz;
    var metallic = material.base.w;
    var roughness = material.specular.w;
    var emission = material.emission.xyz;
#if UNTEXTURED
#else
    // A SIMD driver runs every loop at least once: one loop takes all textures, and scenes without textures have kernels without it.
    let more = triangle_uvs[2u * triangle + 1u];
    let textures_of = vec4<u32>(material.flags.xy, material.normal.x, material.flags.w >> MATERIAL_EMISSION_SHIFT);
    let present = select(vec4<u32>(0u), vec4<u32>(1u, 2u, 4u, 8u), textures_of != vec4<u32>(0u));
    for (var left = present.x | present.y | present.z | present.w; left != 0u; left &= left - 1u) {
        let bit = left & (0u - left);
        let is_base = bit == 1u;
        let is_roughness = bit == 2u;
        let is_normal = bit == 4u;
        let is_emission = bit == 8u;
        let number = select(select(select(textures_of.w, textures_of.z, is_normal), textures_of.y, is_roughness), textures_of.x, is_base);
        let second = (material.flags.w & (MATERIAL_SECOND_UVS * bit)) != 0u;
        let at = select(2u * triangle, bitcast<u32>(more.w), second);
        let uvs = triangle_uvs[at];
        let last = triangle_uvs[at + 1u].xy;
        let footprint = footprint_of(width, abs(dot(face_normal, d)), face, uvs.zw - uvs.xy, last - uvs.xy);
        let texel = sample_texture(number - 1u, w * uvs.xy + u * uvs.zw + v * last, footprint).xyz;
        base *= select(vec3<f32>(1.0), texel, is_base);
        roughness *= select(1.0, texel.y, is_roughness);
        metallic *= select(1.0, texel.z, is_roughness);
        emission *= select(vec3<f32>(1.0), texel, is_emission);
        let side = select(-1.0, 1.0, front);
        let scale = bitcast<f32>(material.normal.y);
        let mapped = mapped_normal(texel, scale, e1, e2, uvs.zw - uvs.xy, last - uvs.xy, shading * side) * side;
        shading = select(shading, mapped, is_normal && dot(mapped, d) < 0.0);
    }
    let colors = bitcast<u32>(more.z);
    if colors != 0u {
        let corners = triangle_normals[colors];
        base *= w * decode_color(corners.x) + u * decode_color(corners.y) + v * decode_color(corners.z);
    }
#endif
    let kind = material.flags.z;
    let whole = reflectance_of(base, metallic, material.specular.xyz, roughness);
    var alpha = select(whole.alpha, material.lobes.z, material.lobes.z < 0.0 || is_table(material.lobes.z));
    // A loop, because it runs zero times where no lobe has two widths.
    for (var i = select(0u, 1u, material.lobes.z > 0.0 && !is_table(material.lobes.z)); i > 0u; i -= 1u) {
        var corners = vec4<f32>(0.0);
        var last = vec2<f32>(0.0);
#if UNTEXTURED
#else
        corners = triangle_uvs[2u * triangle];
        last = more.xy;
#endif
        let of_front = shading * select(-1.0, 1.0, front);
        let along = grain_of(e1, e2, corners.zw - corners.xy, last - corners.xy, material.lobes.w, of_front);
        alpha = pack_grain(vec2<f32>(mix(whole.alpha, 1.0, material.lobes.z), whole.alpha), along, shading);
    }
    let lobe = select(0.0, 1.0, kind == SURFACE_OPAQUE);
    let kd = select(whole.kd, vec3<f32>(0.0), kind > SURFACE_MIRROR);
    let emits = front || (material.flags.w & MATERIAL_TWO_SIDED) != 0u;
    var s: Surface;
    s.position = position;
    s.geometric = geometric;
    s.shading = shading;
    s.emission = select(vec3<f32>(0.0), emission * cosine_falloff(abs(dot(face_normal, d)), material.lobes.x), emits);
    s.exitance = select(0.0, mean3(emission) * material.lobes.y, emits);
    s.kind = kind;
    s.front = front;
    s.material = material_of(normals);
    s.reflectance = Reflectance(kd, whole.f90 * lobe, whole.f0 * lobe, select(1.0, alpha, kind == SURFACE_OPAQUE));
    s.ideal = Reflectance(vec3<f32>(0.0), whole.f90, select(whole.f0, base, kind > SURFACE_MIRROR), 1.0);
    return s;
}
