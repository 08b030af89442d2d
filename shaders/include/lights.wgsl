// The one structure for every kind of point light. Host twin: pass::layout::PointLight.
//
// Towards a shading point in direction wo (from the light), at distance r, a light gives the perpendicular irradiance
//     I(wo) / max(r^2, clip^2),   I = emit * (surface ? max(cos, 0)^d : 1) * spot(cos)^2 + flux * f_s(wi, wo) * max(cos, 0)
// with cos = wo . normal, d the exponent of directed lights and else 1, and spot(c) = clamp(c * spot_scale + spot_offset, 0, 1).
//
// Area lights (flag AREA of the shadow-ray kernels, see area.wgsl) are parallelograms: `position.xyz` is a corner, `wi.xyz` and
// `flux.xyz` are the edges from there.
struct PointLight {
    position: vec4<f32>,    // position, ray-origin offset applied; w: bits of the flags below
    normal: vec4<f32>,      // surface normal or axis, unit; w: spot_scale, of directed lights d - 1
    emit: vec4<f32>,        // radiant intensity along the normal (directional: irradiance); w: spot_offset
    wi: vec4<f32>,          // direction back along the particle's path; w: alpha of the lobe, or on an emitter the lights on a unit of its area,
                            // or of the environment those in a unit of solid angle
    flux: vec4<f32>,        // incident flux, for the specular lobe; w: f90
    f0: vec4<f32>,          // reflectance of the lobe at normal incidence; w: bounces so far: reflections, mirrors and glass
}

const LIGHT_SURFACE: u32 = 1u;      // cosine law
const LIGHT_CLIPPED: u32 = 2u;      // clip distance applies
const LIGHT_DIRECTIONAL: u32 = 4u;  // `normal` is the direction in which light travels; no falloff
const LIGHT_GLOSSY: u32 = 8u;       // has a specular lobe
const LIGHT_ENVIRONMENT: u32 = 16u; // parallel light of the environment
const LIGHT_DIRECTED: u32 = 32u;    // emits by a higher power of the cosine
const LIGHT_SOFT: u32 = 64u;        // on an emitter whose shadows are convolved: no diffuse light for points with the flag SOFT
