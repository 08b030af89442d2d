// Ideal reflection and refraction at mirrors and glass. Needs frame.wgsl, bsdf.wgsl and surface.wgsl. CPU twin: bsdf::ideal.
#include "mirror_reflectance.wgsl"

// The bodies of glass around a ray, the last one entered first: material + 1, or 0 for none.
// Entering puts a body on top; leaving removes it at any depth.
fn crossed(bodies: vec4<u32>, body: u32, enters: bool) -> vec4<u32> {
    // The bodies below the removed one move up.
    let x = bodies.x == body;
    let y = x || bodies.y == body;
    let z = y || bodies.z == body;
    let w = z || bodies.w == body;
    let without = select(bodies, vec4<u32>(bodies.yzw, 0u), vec4<bool>(x, y, z, w));
    return select(without, vec4<u32>(body, bodies.xyz), enters);
}

fn index_of(bodies: vec4<u32>) -> f32 {
    return select(materials[max(bodies.x, 1u) - 1u].emission.w, 1.0, bodies.x == 0u);
}

// Index of refraction behind the surface over that before it. A pane is always entered.
fn relative_index(bodies: vec4<u32>, s: Surface) -> f32 {
    let enters = s.front || s.kind == SURFACE_PANE;
    let own = materials[s.material].emission.w;
    // A ray outside all bodies that is about to leave one started inside it.
    let near = select(index_of(bodies), own, bodies.x == 0u && !enters);
    return index_of(crossed(bodies, s.material + 1u, enters)) / near;
}

// Reflectance of a smooth dielectric by Fresnel's equations, and the cosine of the refracted ray; negative: total reflection.
fn fresnel_dielectric(cos_i: f32, eta: f32) -> vec2<f32> {
    let c = clamp(cos_i, 0.0, 1.0);
    let sin2_t = (1.0 - c * c) / (eta * eta);
    let cos_t = sqrt(max(1.0 - sin2_t, 0.0));
    let parallel = (eta * c - cos_t) / (eta * c + cos_t);
    let perpendicular = (c - eta * cos_t) / (c + eta * cos_t);
    let r = 0.5 * (parallel * parallel + perpendicular * perpendicular);
    return select(vec2<f32>(r, cos_t), vec2<f32>(1.0, -1.0), sin2_t >= 1.0);
}

fn reflected(wo: vec3<f32>, n: vec3<f32>) -> vec3<f32> {
    return n * (2.0 * dot(n, wo)) - wo;
}

fn refracted(wo: vec3<f32>, n: vec3<f32>, eta: f32, cos_t: f32) -> vec3<f32> {
    let w = n * (dot(n, wo) / eta - cos_t) - wo / eta;
    return w / sqrt(dot(w, w));
}

// The two components that a path may take.
struct SpecularSplit {
    stays: bool,                // the first is the diffuse base of a mirror: the path ends on it
    probability: f32,           // of the first if one is chosen at random; 1: there is no second
    first_wi: vec3<f32>,        // through glass, or reflected
    first_weight: vec3<f32>,    // factor of the radiance
    first_adjoint: f32,         // additional factor of flux
    crosses: bool,              // the first crosses the surface of a body
    second_wi: vec3<f32>,       // reflected
    second_weight: vec3<f32>,
    second_adjoint: f32,
}

// Factor of flux for a shading normal n on a face g (Veach 1997, 5.3).
fn skew_of(g: vec3<f32>, n: vec3<f32>, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return min(abs(dot(n, wo) * dot(g, wi) / (dot(g, wo) * dot(n, wi))), 4.0);
}

fn specular_split(s: Surface, wo: vec3<f32>, eta: f32) -> SpecularSplit {
    // The geometric normal replaces the shading normal if that would send a ray to the wrong side.
    let bend = select(1.0, eta, s.kind == SURFACE_GLASS);
    let leaning = fresnel_dielectric(dot(s.shading, wo), bend);
    let above = dot(s.shading, wo) > 0.0 && dot(reflected(wo, s.shading), s.geometric) > 0.0;
    let below = leaning.y < 0.0 || dot(refracted(wo, s.shading, bend, leaning.y), s.geometric) < 0.0;
    let n = select(s.geometric, s.shading, above && below);
    let cos_o = dot(n, wo);

    let is_mirror = s.kind == SURFACE_MIRROR;
    let is_pane = s.kind == SURFACE_PANE;
    let f = fresnel_dielectric(cos_o, eta);
    let r = select(f.x, 2.0 * f.x / (1.0 + f.x), is_pane);
    let passes = !is_mirror && select(f.y >= 0.0, r < 1.0, is_pane);
    let mirrored = select(vec3<f32>(r), mirror_reflectance(s.ideal, cos_o), is_mirror);
    let base = mean3(s.reflectance.kd);
    let reflects = mean3(mirrored);

    var split: SpecularSplit;
    split.second_wi = reflected(wo, n);
    split.second_weight = mirrored;
    split.stays = is_mirror && base > 0.0;
    split.probability = select(select(1.0, base / (base + reflects), split.stays), 1.0 - reflects, passes);
    split.crosses = passes && !is_pane;
    split.first_wi = select(split.second_wi, select(refracted(wo, n, eta, f.y), -wo, is_pane), passes);
    let through = s.ideal.f0 * select((1.0 - r) / (eta * eta), 1.0 - r, is_pane);
    split.first_weight = select(mirrored, through, passes);
    // Rays pass a pane straight, so the cosines are the same on both sides.
    let spread = select(1.0, eta * eta, split.crosses);
    split.first_adjoint = spread * skew_of(s.geometric, n, wo, split.first_wi);
    split.second_adjoint = skew_of(s.geometric, n, wo, split.second_wi);
    return split;
}

// At a glossy plane: its base, and its mirror image times `reflectance`, which is 1 if the lobe is applied later.
fn split_of_plane(s: Surface, wo: vec3<f32>, reflectance: vec3<f32>) -> SpecularSplit {
    let base = mean3(s.reflectance.kd);
    var split: SpecularSplit;
    split.stays = true;
    split.probability = base / (base + mean3(reflectance));
    split.first_weight = vec3<f32>(1.0);
    split.second_wi = reflected(wo, s.geometric);
    split.second_weight = reflectance;
    return split;
}
