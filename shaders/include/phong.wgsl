// Scattering by a power of the cosine about the mirror direction. Needs math.wgsl. CPU twin: bsdf::phong, which has the formula. A
// reflectance has this lobe if its alpha is negative: it is then minus the exponent.
#include "lobe_width.wgsl"

// Density over solid angle of the directions of phong_sample above the surface.
fn phong_density(n: vec3<f32>, wi: vec3<f32>, wo: vec3<f32>, exponent: f32) -> f32 {
    let chord = wi - (2.0 * dot(n, wo) * n - wo);
    let x = 0.5 * dot(chord, chord);
    // ln(1 - x): for small x 1 - x has lost its digits.
    let series = -x * (1.0 + x * (0.5 + x * (1.0 / 3.0 + x * (0.25 + x * 0.2))));
    let logarithm = select(log(max(1.0 - x, 1e-20)), series, x < 0.05);
    return select((exponent + 1.0) * (0.5 * INV_PI) * exp(exponent * logarithm), 0.0, x >= 1.0);
}

// Share of the lobe about a direction of this cosine that counts.
fn phong_kept(cosine: f32, exponent: f32) -> f32 {
    let sine = sqrt(max(1.0 - cosine * cosine, 1e-8));
    let x = cosine / (sine * sqrt(sine)) * (exponent + 1.9) / sqrt(exponent);
    let h = x / (x + 0.8 + 1.7 * exp(-0.72 * x));
    return 0.5 + (0.5 - 1.0 / (exponent + 2.0)) * h;
}

// The lobe without its Fresnel term over the density.
fn phong_over_density(cos_i: f32, cos_o: f32, exponent: f32) -> f32 {
    return 1.0 / max(max(cos_i, cos_o) * max(phong_kept(cos_i, exponent), phong_kept(cos_o, exponent)), 1e-20);
}

// A direction about the mirror direction of wo, which may lie below the surface.
fn phong_sample(n: vec3<f32>, wo: vec3<f32>, exponent: f32, u: f32, v: f32) -> vec3<f32> {
    let r = 2.0 * dot(n, wo) * n - wo;
    let across = basis(r);
    let cosine = pow(1.0 - u, 1.0 / (exponent + 1.0));
    let circle = unit_circle(v) * sqrt(max(1.0 - cosine * cosine, 0.0));
    return across[0] * circle.x + across[1] * circle.y + r * cosine;
}
