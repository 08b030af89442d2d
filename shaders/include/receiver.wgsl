// Receivers: the points that are lit, pixel by pixel, in parallel arrays. Needs bsdf.wgsl. Host twin: pass::receivers::Receivers.
//   position:  point with ray-origin offset towards wo; w: distance along the ray, negative if it hit nothing
//   geometric: geometric normal on the side of wo; w: f90
//   shading:   shading normal on the side of wo; w: alpha
//   kd:        diffuse albedo; w: probability of following the diffuse lobe
//   f0:        specular reflectance at normal incidence; w: 1 if there is a specular lobe, else 0
//   wo:        direction back along the ray; w: 1 if it is lit, because it can reflect light to the eye, else 0

// emitted.w where an eye path ended on the base of a glossy plane: the receiver there has no lobe.
const LOBE_FOLLOWED: f32 = 2.0;

// The specular lobe alone.
fn receiver_lobe(geometric: vec4<f32>, shading: vec4<f32>, f0: vec4<f32>) -> Reflectance {
    return Reflectance(vec3<f32>(0.0), geometric.w, f0.xyz, shading.w);
}
