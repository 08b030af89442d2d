// Reflectance: Lambert plus a lobe, GGX or by phong.wgsl, anisotropic.wgsl, or where TABLES is set by lobe_table.wgsl. CPU twin: bsdf.rs. Needs math.wgsl.
#include "phong.wgsl"
#include "anisotropic.wgsl"
#if TABLES
#include "lobe_table.wgsl"
#endif

struct Reflectance {
    kd: vec3<f32>,
    f90: f32,
    f0: vec3<f32>,
    alpha: f32,             // negative: minus the exponent of a lobe by phong.wgsl; 2 or more: a lobe by anisotropic.wgsl; between
                            // 1 and 2: one by lobe_table.wgsl
}

// Mean of Schlick's Fresnel term over the cosine-weighted hemisphere.
fn mean_fresnel(f0: vec3<f32>, f90: f32) -> vec3<f32> {
    return f0 + (vec3<f32>(f90) - f0) * (1.0 / 21.0);
}

fn reflectance_of(base: vec3<f32>, metallic: f32, dielectric: vec3<f32>, roughness: f32) -> Reflectance {
    let f0 = mix(dielectric, base, metallic);
    let f90 = clamp(50.0 * max(max(f0.x, f0.y), f0.z), 0.0, 1.0);
    let kd = base * (1.0 - metallic) * (vec3<f32>(1.0) - mean_fresnel(f0, f90));
    return Reflectance(kd, f90, f0, max(roughness * roughness, 1e-3));
}

// Probability of following the diffuse lobe.
fn diffuse_probability(r: Reflectance) -> f32 {
    let d = mean3(r.kd);
    let s = select(0.0, mean3(mean_fresnel(r.f0, r.f90)), r.f90 > 0.0);
    return select(1.0, d / (d + s), d + s > 0.0);
}

fn schlick(r: Reflectance, cos_h: f32) -> vec3<f32> {
    let m = clamp(1.0 - cos_h, 0.0, 1.0);
    let m2 = m * m;
    return r.f0 + (vec3<f32>(r.f90) - r.f0) * (m2 * m2 * m);
}

// The lobe; GGX with height-correlated Smith masking (Heitz 2014); without the cosine. Symmetric in wo and wi.
fn eval_specular(r: Reflectance, n: vec3<f32>, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let cos_o = dot(n, wo);
    let cos_i = dot(n, wi);
    let sum = wo + wi;
    let h = sum / sqrt(max(dot(sum, sum), 1e-20));
    let cos_h = dot(n, h);
    // 1 - cos_h^2 by the cross product: no cancellation for sharp lobes.
    let c = cross(n, h);
    let a2 = r.alpha * r.alpha;
    let k = dot(c, c) + a2 * cos_h * cos_h;
    let d = a2 / (PI * k * k);
    let v = 0.5 / (cos_o * sqrt(a2 + (1.0 - a2) * cos_i * cos_i) + cos_i * sqrt(a2 + (1.0 - a2) * cos_o * cos_o));
    var lobe = d * v;
    // A loop, because it runs zero times where all lobes are GGX.
    for (var i = select(0u, 1u, r.alpha < 0.0); i > 0u; i -= 1u) {
        lobe = phong_density(n, wi, wo, -r.alpha) * phong_over_density(cos_i, cos_o, -r.alpha);
    }
    for (var i = select(0u, 1u, is_anisotropic(r.alpha)); i > 0u; i -= 1u) {
        let g = unpack_grain(r.alpha, n);
        lobe = grain_distribution(g, n, h) * 0.5 / (cos_o * grain_stretch(g, wi, cos_i) + cos_i * grain_stretch(g, wo, cos_o));
    }
#if TABLES
    for (var i = select(0u, 1u, is_table(r.alpha) && cos_o > 0.0 && cos_i > 0.0); i > 0u; i -= 1u) {
        lobe = table_lobe(r.alpha, n, wi, wo);
    }
#endif
    let f = schlick(r, dot(wo, h)) * lobe;
    return select(vec3<f32>(0.0), f, cos_o > 0.0 && cos_i > 0.0);
}

// Density over solid angle of the specular directions of `sample_lobe`; of GGX G1(wo) D(h) / (4 cos_o).
fn lobe_density(alpha: f32, n: vec3<f32>, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let cos_o = dot(n, wo);
    let sum = wo + wi;
    let h = sum / sqrt(max(dot(sum, sum), 1e-20));
    let cos_h = dot(n, h);
    let c = cross(n, h);
    let a2 = alpha * alpha;
    let k = dot(c, c) + a2 * cos_h * cos_h;
    var density = a2 / (PI * k * k) / (2.0 * (cos_o + sqrt(a2 + (1.0 - a2) * cos_o * cos_o)));
    for (var i = select(0u, 1u, alpha < 0.0); i > 0u; i -= 1u) {
        density = phong_density(n, wi, wo, -alpha);
    }
    for (var i = select(0u, 1u, is_anisotropic(alpha)); i > 0u; i -= 1u) {
        let g = unpack_grain(alpha, n);
        density = grain_distribution(g, n, h) / (2.0 * (cos_o + grain_stretch(g, wo, cos_o)));
    }
#if TABLES
    for (var i = select(0u, 1u, is_table(alpha) && cos_o > 0.0 && dot(n, wi) > 0.0); i > 0u; i -= 1u) {
        density = table_density(alpha, n, wi, wo);
    }
#endif
    return select(0.0, density, cos_o > 0.0 && dot(n, wi) > 0.0);
}

struct LobeSample {
    wi: vec3<f32>,
    weight: vec3<f32>,      // f cos / pdf, divided by the lobe's probability
}

// A direction from one lobe: cosine law for the diffuse (Keller 1997, 3.2), for the specular one visible normals
// (Heitz 2018), a power of the cosine or a table. The caller drops directions below the surface.
fn sample_lobe(r: Reflectance, diffuse: bool, p_diffuse: f32, n: vec3<f32>, wo: vec3<f32>, u: f32, v: f32) -> LobeSample {
    let frame_n = basis(n);
    let circle = unit_circle(v);
    let direction = sqrt(u) * (circle.x * frame_n[0] + circle.y * frame_n[1]) + sqrt(max(1.0 - u, 0.0)) * n;
    var s = LobeSample(direction, r.kd / max(p_diffuse, 1e-6));
    for (var i = select(1u, 0u, diffuse || r.alpha >= 0.0); i > 0u; i -= 1u) {
        let wi = phong_sample(n, wo, -r.alpha, u, v);
        let cos_i = dot(n, wi);
        let sum = wo + wi;
        let cos_h = sqrt(0.25 * dot(sum, sum));
        let share = cos_i * phong_over_density(max(cos_i, 0.0), dot(n, wo), -r.alpha) / max(1.0 - p_diffuse, 1e-6);
        s.wi = wi;
        s.weight = select(vec3<f32>(0.0), schlick(r, cos_h) * share, cos_i > 0.0);
    }
#if TABLES
    for (var i = select(1u, 0u, diffuse || !is_table(r.alpha)); i > 0u; i -= 1u) {
        let found = table_sample(r.alpha, n, wo, u, v);
        let sum = wo + found.xyz;
        let cos_h = sqrt(0.25 * dot(sum, sum));
        s.wi = found.xyz;
        s.weight = schlick(r, cos_h) * (found.w / max(1.0 - p_diffuse, 1e-6));
    }
#endif
    for (var i = select(1u, 0u, diffuse || r.alpha < 0.0 || is_table(r.alpha)); i > 0u; i -= 1u) {
        let two = is_anisotropic(r.alpha);
        // Without a branch, so that it leaves the loops of callers.
        let unpacked = unpack_grain(r.alpha, n);
        let along = select(frame_n[0], unpacked.along, two);
        let across = select(frame_n[1], unpacked.across, two);
        let grain = Grain(along, across, select(vec2<f32>(r.alpha), unpacked.alphas, two));
        let local = vec3<f32>(dot(wo, grain.along), dot(wo, grain.across), dot(wo, n));
        let stretched = vec3<f32>(grain.alphas * local.xy, local.z);
        let stretch = sqrt(dot(stretched, stretched));
        let vh = stretched / stretch;
        let length2 = vh.x * vh.x + vh.y * vh.y;
        let t1 = select(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(-vh.y, vh.x, 0.0) / sqrt(max(length2, 1e-30)), length2 > 1e-12);
        let t2 = cross(vh, t1);
        let radius = sqrt(u);
        let p1 = radius * circle.x;
        let blend = 0.5 * (1.0 + vh.z);
        let p2 = (1.0 - blend) * sqrt(max(1.0 - p1 * p1, 0.0)) + blend * radius * circle.y;
        let nh = p1 * t1 + p2 * t2 + sqrt(max(1.0 - p1 * p1 - p2 * p2, 0.0)) * vh;
        let ne = vec3<f32>(grain.alphas * nh.xy, max(nh.z, 1e-7));
        let m = ne / sqrt(dot(ne, ne));
        let h = m.x * grain.along + m.y * grain.across + m.z * n;
        let cos_h = dot(wo, h);
        let wi = 2.0 * cos_h * h - wo;
        let cos_i = dot(n, wi);
        let cos_o = local.z;
        let a2 = grain.alphas.x * grain.alphas.x;
        let flat = grain.alphas * (2.0 * cos_h * m.xy - local.xy);
        let lo = select(sqrt(a2 + (1.0 - a2) * cos_o * cos_o), stretch, two);
        let li = select(sqrt(a2 + (1.0 - a2) * cos_i * cos_i), sqrt(dot(flat, flat) + cos_i * cos_i), two);
        // G2 / G1(wo) of the height-correlated masking.
        let g = cos_i * (cos_o + lo) / (cos_o * li + cos_i * lo);
        s.wi = wi;
        s.weight = select(vec3<f32>(0.0), schlick(r, cos_h) * (g / max(1.0 - p_diffuse, 1e-6)), cos_i > 0.0);
    }
    return s;
}

// Light that the lobe reflects of light from wo, by 8 x 4 visible normals, denser where masking begins.
fn lobe_albedo(r: Reflectance, n: vec3<f32>, wo: vec3<f32>) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < 32u; i += 1u) {
        let left = 1.0 - (f32(i / 4u) + 0.5) / 8.0;
        let turn = (f32(i & 3u) + 0.25 + 0.5 * f32((i / 4u) & 1u)) / 4.0;
        sum += left * mean3(sample_lobe(r, false, 0.0, n, wo, 1.0 - left * left, turn).weight);
    }
    return sum / 16.0;
}

// Factor by which a lobe widened to this alpha must grow to reflect as much light from wo as the lobe itself, at most 4.
fn widening_factor(r: Reflectance, n: vec3<f32>, wo: vec3<f32>, alpha: f32) -> f32 {
    var factor = 1.0;
    for (var i = select(0u, 1u, r.f90 > 0.0 && r.alpha != alpha); i > 0u; i -= 1u) {
        let wide = Reflectance(r.kd, r.f90, r.f0, alpha);
        factor = clamp(lobe_albedo(r, n, wo) / max(lobe_albedo(wide, n, wo), 1e-6), 1.0, 4.0);
    }
    return factor;
}
