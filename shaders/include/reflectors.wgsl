// Tables of glossy reflectors. Needs math.wgsl. Host twin: pass::mirror_image::Tables; superposition::kernels says what a layer is.
#include "anisotropic.wgsl"

const VIEW_ANGLES: u32 = 32u;
const MAP_TEXELS: u32 = 128u;
const AZIMUTHS: f32 = 8.0;

// Kinds of reflectors besides glossy planes.
const FROSTED_PANE: u32 = 1u;
const CURVED_SURFACE: u32 = 2u;

@group(0) @binding(28) var<storage, read> reflectors: array<vec4<u32>>;    // first layer, first texel of the reflectance map, kind, textures of a curved surface or of a plane 1: lobe of two widths
@group(0) @binding(29) var<storage, read> lobes: array<vec4<f32>>;         // of each layer: tan beta, energy, its grazing part, share of the core; then aspects

// First layer of a plane of this alpha about its normal n, seen from wo: for a lobe of two widths by the angle between the grain and the plane
// of incidence.
fn first_layer(tables: vec4<u32>, alpha: f32, n: vec3<f32>, wo: vec3<f32>) -> u32 {
    var first = tables.x;
    // A loop, because it runs zero times where no lobe has two widths.
    for (var i = select(0u, 1u, tables.z == 0u && tables.w != 0u); i > 0u; i -= 1u) {
        let along = unpack_grain(alpha, n).along;
        let turn = atan2(dot(along, cross(wo, n)), dot(along, wo)) * (AZIMUTHS * INV_PI);
        first += VIEW_ANGLES * (u32(turn + AZIMUTHS + 0.5) % u32(AZIMUTHS));
    }
    return first;
}

// Position of the cosine of a view angle among the layers of a material, from 0.
fn view_place(mu: f32) -> f32 {
    return clamp(mu * f32(VIEW_ANGLES) - 1.0, 0.0, f32(VIEW_ANGLES - 1u));
}

// Texture of the tail of the kernel; that of the core is VIEW_ANGLES further on.
fn tail_of(first: u32, mu: f32) -> u32 {
    return 2u * first + u32(view_place(mu) + 0.5);
}

// Reflectance of a lobe by Schlick's formula.
fn reflectance_of_lobe(lobe: vec4<f32>, f0: vec3<f32>, f90: f32) -> vec3<f32> {
    return f0 * (lobe.y - lobe.z) + f90 * lobe.z;
}

// Row of `lobes`, interpolated between view angles.
fn lobe_at(first: u32, mu: f32) -> vec4<f32> {
    let s = view_place(mu);
    let i = u32(s);
    return mix(lobes[first + i], lobes[first + min(i + 1u, VIEW_ANGLES - 1u)], s - f32(i));
}

// The image of a small disc across the view direction d: direction of its u axis; pixels for a unit of length at unit distance,
// averaged over both directions.
fn image_of_disc(d: vec3<f32>, u: vec3<f32>) -> vec3<f32> {
    let right = frame.right.xyz / dot(frame.right.xyz, frame.right.xyz);
    let up = frame.up.xyz / dot(frame.up.xyz, frame.up.xyz);
    let f = dot(d, frame.forward.xyz);
    let g = dot(u, frame.forward.xyz);
    let size = vec2<f32>(frame.size.xy);
    let moved = vec2<f32>(dot(u, right) * f - dot(d, right) * g, dot(d, up) * g - dot(u, up) * f) * size;
    let length2 = dot(moved, moved);
    let axis = select(vec2<f32>(1.0, 0.0), moved / sqrt(length2), length2 > 1e-20);
    return vec3<f32>(axis, 0.5 * size.y * sqrt(dot(up, up)) / (f * sqrt(f)));
}
