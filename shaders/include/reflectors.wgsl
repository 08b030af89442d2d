// Tables of glossy planes. Host twin: pass::mirror_image::Tables; superposition::kernels says what a layer is.

const VIEW_ANGLES: u32 = 32u;
const MAP_TEXELS: u32 = 128u;

@group(0) @binding(28) var<storage, read> reflectors: array<vec4<u32>>;    // first layer, first texel of the reflectance map, 1: frosted pane
@group(0) @binding(29) var<storage, read> lobes: array<vec4<f32>>;         // of each layer: tan beta, energy, captured share

// Place among the layers of a material, from 0, where a cosine of the angle of view lies.
fn view_place(mu: f32) -> f32 {
    return clamp(mu * f32(VIEW_ANGLES) - 1.0, 0.0, f32(VIEW_ANGLES - 1u));
}

fn layer_of(mu: f32) -> u32 {
    return u32(view_place(mu) + 0.5);
}

// tan beta and energy, interpolated between angles of view.
fn lobe_at(first: u32, mu: f32) -> vec2<f32> {
    let s = view_place(mu);
    let i = u32(s);
    return mix(lobes[first + i].xy, lobes[first + min(i + 1u, VIEW_ANGLES - 1u)].xy, s - f32(i));
}

// The image of a small disc across the direction of view d: direction of its u axis, pixels for a unit of length at unit distance, the
// mean of both directions.
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
