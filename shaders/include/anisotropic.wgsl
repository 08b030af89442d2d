// GGX lobes of two widths, along the grain of a surface and across it. Needs math.wgsl. CPU twin: bsdf::anisotropic, which has the formulas and
// says what the number that stands for a lobe holds.
#include "lobe_width.wgsl"

struct Grain {
    along: vec3<f32>,
    across: vec3<f32>,
    alphas: vec2<f32>,
}

// The low bits of the number: a direction about the unit normal n.
fn grain_bits(along: vec3<f32>, n: vec3<f32>) -> u32 {
    let frame_n = basis(n);
    let p = vec2<f32>(dot(along, frame_n[0]), dot(along, frame_n[1]));
    let length2 = dot(p, p);
    let flat = select(vec2<f32>(1.0, 0.0), p / sqrt(max(length2, 1e-37)), length2 > 1e-37);
    let half = select(flat, -flat, flat.x < 0.0);
    return u32(half.y / (1.0 + half.x) * 2048.0 + 2048.5) & 0xfffu;
}

fn pack_grain(alphas: vec2<f32>, along: vec3<f32>, n: vec3<f32>) -> f32 {
    return bitcast<f32>(LOBE_BASE + ((lobe_step(alphas.x) << 21u) | (lobe_step(alphas.y) << 12u) | grain_bits(along, n)));
}

// The lobe that an alpha of 2 or more encodes.
fn unpack_grain(alpha: f32, n: vec3<f32>) -> Grain {
    let word = bitcast<u32>(alpha);
    let d = f32(word & 0xfffu) * (1.0 / 2048.0) - 1.0;
    let scale = 1.0 / (1.0 + d * d);
    let x = (1.0 - d * d) * scale;
    let y = 2.0 * d * scale;
    let frame_n = basis(n);
    let alphas = exp2(vec2<f32>(lobe_steps(alpha)) * -0.02);
    return Grain(frame_n[0] * x + frame_n[1] * y, frame_n[1] * x - frame_n[0] * y, alphas);
}

// The alpha of a lobe of two widths, along another direction about n.
fn with_grain(alpha: f32, along: vec3<f32>, n: vec3<f32>) -> f32 {
    return bitcast<f32>((bitcast<u32>(alpha) & 0xfffff000u) | grain_bits(along, n));
}

// Any alpha, of a lobe about one normal, for the same lobe about another normal.
fn turned_lobe(alpha: f32, from_n: vec3<f32>, to_n: vec3<f32>) -> f32 {
    var turned = alpha;
    // A loop, because it runs zero times where no lobe has two widths.
    for (var i = select(0u, 1u, is_anisotropic(alpha)); i > 0u; i -= 1u) {
        turned = with_grain(alpha, unpack_grain(alpha, from_n).along, to_n);
    }
    return turned;
}

// s(w).
fn grain_stretch(g: Grain, w: vec3<f32>, cosine: f32) -> f32 {
    let flat = g.alphas * vec2<f32>(dot(g.along, w), dot(g.across, w));
    return sqrt(dot(flat, flat) + cosine * cosine);
}

fn grain_distribution(g: Grain, n: vec3<f32>, h: vec3<f32>) -> f32 {
    let p = vec3<f32>(vec2<f32>(dot(g.along, h), dot(g.across, h)) / g.alphas, dot(n, h));
    let k = dot(p, p);
    return 1.0 / (PI * g.alphas.x * g.alphas.y * k * k);
}

// Direction along the grain of a triangle about the unit normal n of its front, by its edges and those in texture coordinates, or a fixed
// one where these span no area; turned by `rotation`.
fn grain_of(e1: vec3<f32>, e2: vec3<f32>, d1: vec2<f32>, d2: vec2<f32>, rotation: f32, n: vec3<f32>) -> vec3<f32> {
    let area = d1.x * d2.y - d1.y * d2.x;
    let along_u = (e1 * d2.y - e2 * d1.y) * select(1.0, -1.0, area < 0.0);
    let flat = along_u - n * dot(n, along_u);
    let length2 = dot(flat, flat);
    let fixed = select(vec3<f32>(1.0, 0.0, 0.0) - n * n.x, vec3<f32>(n.z, 0.0, -n.x), abs(n.y) < 0.999);
    let t = select(fixed / sqrt(dot(fixed, fixed)), flat / sqrt(max(length2, 1e-37)), area != 0.0 && length2 > 1e-37);
    let b = select(cross(n, t), cross(t, n), area > 0.0);
    return t * cos(rotation) + b * sin(rotation);
}
