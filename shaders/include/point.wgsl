// Shading points: the points that are lit, pixel by pixel, in parallel arrays. Needs bsdf.wgsl. Host twin: pass::ShadingPoints.
//   position:  point with ray-origin offset towards wo; w: distance along the ray
//   geometric: geometric normal on the side of wo; w: f90
//   shading:   shading normal on the side of wo; w: alpha
//   kd:        diffuse albedo; w: probability of following the diffuse lobe
//   f0:        specular reflectance at normal incidence
//   wo:        direction back along the ray; w: flags
// Of a shading point without the flag HIT, kd and f0 are zero, and nothing else means anything.
#include "flags.wgsl"

// The specular lobe alone.
fn point_lobe(geometric: vec4<f32>, shading: vec4<f32>, f0: vec4<f32>) -> Reflectance {
    return Reflectance(vec3<f32>(0.0), geometric.w, f0.xyz, shading.w);
}
