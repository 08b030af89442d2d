// Reflectance of ideal mirrors. Needs frame.wgsl and bsdf.wgsl. CPU twin: superposition::reflectance::of_mirror.
#include "fresnel_fitted.wgsl"

fn mirror_reflectance(r: Reflectance, cosine: f32) -> vec3<f32> {
    return select(schlick(r, cosine), fresnel_fitted(r.f0, cosine), is_fresnel());
}
