// A point light seen from a shading point, by the formula of lights.wgsl. Needs frame.wgsl, math.wgsl, bsdf.wgsl and lights.wgsl.
// CPU twin: pass::shade::light_towards.
#include "cosine.wgsl"
#include "lobe_shares.wgsl"

// Factor of the square of the clip distance for direct highlights where splats show the rest of a lobe: nothing restores what is cut off
// there. Host twin: pass::shade::SPLAT_CLIP.
const SPLAT_CLIP: f32 = 0.01;

// Vector from x to a light, not normalised.
fn to_light(position: vec4<f32>, normal: vec4<f32>, x: vec3<f32>) -> vec3<f32> {
    let parallel = (bitcast<u32>(position.w) & LIGHT_DIRECTIONAL) != 0u;
    return select(position.xyz - x, -frame.forward.w * normal.xyz, parallel);
}

// Intensity without the specular lobe; `cosine` is that of the angle between the normal and the direction to the shading point.
fn plain_intensity(normal: vec4<f32>, emit: vec4<f32>, flags: u32, cosine: f32) -> vec3<f32> {
    // 1 where a directed light emits.
    let spot = clamp(cosine * normal.w + emit.w, 0.0, 1.0);
    let exponent = select(1.0, normal.w + 1.0, (flags & LIGHT_DIRECTED) != 0u);
    return emit.xyz * (select(1.0, cosine_power(max(cosine, 0.0), exponent), (flags & LIGHT_SURFACE) != 0u) * spot * spot);
}

fn lobe_shines(flags: u32, cosine: f32) -> bool {
    return (flags & LIGHT_GLOSSY) != 0u && cosine > 0.0;
}

// Intensity of the specular lobe alone; `wi` points from the shading point to the light.
fn lobe_intensity(l: PointLight, wi: vec3<f32>, cosine: f32) -> vec3<f32> {
    let shines = lobe_shines(bitcast<u32>(l.position.w), cosine);
    // Lights without a lobe have another number in place of its alpha, which must not be taken for that of a table.
    let lobe = Reflectance(vec3<f32>(0.0), l.flux.w, l.f0.xyz, select(1.0, l.wi.w, shines));
    let intensity = l.flux.xyz * eval_specular(lobe, l.normal.xyz, l.wi.xyz, -wi) * cosine;
    return select(vec3<f32>(0.0), intensity, shines);
}

fn intensity_of(l: PointLight, wi: vec3<f32>) -> vec3<f32> {
    let cosine = -dot(wi, l.normal.xyz);
    return plain_intensity(l.normal, l.emit, bitcast<u32>(l.position.w), cosine) + lobe_intensity(l, wi, cosine);
}

// Square of the clip distance, 0 for lights that are not clipped.
fn clip2_of(flags: u32) -> f32 {
    return select(0.0, frame.right.w, (flags & LIGHT_CLIPPED) != 0u);
}

// Inverse square law with clipping.
fn inverse_square(r2: f32, clip2: f32) -> f32 {
    return 1.0 / max(max(r2, clip2), 1e-37);
}

// Perpendicular irradiance for an intensity of 1, if the square of the clip distance is multiplied by `scale`.
fn falloff_beyond(flags: u32, r2: f32, scale: f32) -> f32 {
    return select(inverse_square(r2, scale * clip2_of(flags)), 1.0, (flags & LIGHT_DIRECTIONAL) != 0u);
}

fn falloff_of(flags: u32, r2: f32) -> f32 {
    return falloff_beyond(flags, r2, 1.0);
}

// Inverse square law for the highlight at a shading point with the flag LOBE_SAMPLED: its path brings the rest. Nothing is clipped, since
// paths take over where lights are near. `lobe`: density of the lobe towards the light.
fn highlight_falloff(l_f0: vec4<f32>, l_wi: vec4<f32>, flags: u32, r2: f32, cosine: f32, lobe: f32) -> f32 {
    let density = select(lights_on_surfaces(), l_wi.w, l_f0.w == 0.0);
    let divided = highlight_factor(lobe, density, r2, cosine);
    // Of parallel light only that of the environment is found by paths.
    let parallel = select(1.0, l_wi.w / max(l_wi.w + lobe, 1e-37), (flags & LIGHT_ENVIRONMENT) != 0u);
    let whole = select(1.0 / max(r2, 1e-37), parallel, (flags & LIGHT_DIRECTIONAL) != 0u);
    return select(whole, divided, (flags & LIGHT_SURFACE) != 0u);
}
