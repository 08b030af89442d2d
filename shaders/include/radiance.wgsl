// Light that a shading point reflects back along its ray. Needs math.wgsl, the shading points bound as `point_wo`, and their sums bound as
// `direct`, `indirect` and `specular`.
#include "flags.wgsl"

struct Lighting {
    e_direct: vec3<f32>,    // irradiance by direct light
    e_indirect: vec3<f32>,  // irradiance by indirect light
    l_specular: vec3<f32>,  // radiance that the specular lobe reflects
}

// Zero for a shading point that is not lit: nothing has written its sums.
fn lighting_of(slot: u32) -> Lighting {
    let lit = has_flag(point_wo[slot].w, LIT);
    let zero = vec3<f32>(0.0);
    return Lighting(
        select(zero, direct[slot].xyz, lit),
        select(zero, indirect[slot].xyz, lit),
        select(zero, specular[slot].xyz, lit),
    );
}

// A Lambertian surface of albedo kd under the irradiance e.
fn diffuse_radiance(kd: vec3<f32>, e: vec3<f32>) -> vec3<f32> {
    return kd * INV_PI * e;
}

// L = kd / pi (E_d + E_i) + L_s
fn reflected_radiance(kd: vec3<f32>, light: Lighting) -> vec3<f32> {
    return diffuse_radiance(kd, light.e_direct + light.e_indirect) + light.l_specular;
}
