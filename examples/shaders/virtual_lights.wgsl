// Virtual lights of lightsum in a shader of the host. Buffers and numbers: lightsum::engine::PassBuffers. The same in GLSL:
// virtual_lights.glsl.

struct PointLight {
    position: vec4<f32>,    // w: bits of the flags below
    normal: vec4<f32>,      // surface normal or axis, unit; w: scale of a spot's falloff, of directed lights the exponent less 1
    emit: vec4<f32>,        // radiant intensity along the normal, parallel light: irradiance; w: offset of a spot's falloff
    wi: vec4<f32>,          // these three: the specular lobe of a glossy surface, which is left out here
    flux: vec4<f32>,
    f0: vec4<f32>,          // w: reflections so far; 0: direct light
}

const SURFACE: u32 = 1u;        // cosine law about the normal
const CLIPPED: u32 = 2u;        // the clip distance applies
const PARALLEL: u32 = 4u;       // along the normal, without falloff
const DIRECTED: u32 = 32u;      // a power of the cosine

@group(0) @binding(0) var<storage, read> lights: array<PointLight>;
@group(0) @binding(1) var<storage, read> node_min: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> node_max: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> triangle_v0: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> triangle_e2: array<vec4<f32>>;

// Vector from x to a light, not normalised. `far`: of LightLayout.
fn to_light(light: PointLight, x: vec3<f32>, far: f32) -> vec3<f32> {
    let parallel = (bitcast<u32>(light.position.w) & PARALLEL) != 0u;
    return select(light.position.xyz - x, -far * light.normal.xyz, parallel);
}

// Irradiance by a light at a point with normal n, without its shadow. `to`: of to_light; `clip`: of LightLayout.
fn irradiance(light: PointLight, to: vec3<f32>, n: vec3<f32>, clip: f32) -> vec3<f32> {
    let flags = bitcast<u32>(light.position.w);
    let r2 = max(dot(to, to), 1e-37);
    let wi = to / sqrt(r2);
    let cosine = -dot(wi, light.normal.xyz);
    let spot = clamp(cosine * light.normal.w + light.emit.w, 0.0, 1.0);
    let exponent = select(1.0, light.normal.w + 1.0, (flags & DIRECTED) != 0u);
    let of_surface = select(1.0, pow(max(cosine, 1e-20), exponent), (flags & SURFACE) != 0u);
    let nearest = select(0.0, clip * clip, (flags & CLIPPED) != 0u);
    let falloff = select(1.0 / max(r2, nearest), 1.0, (flags & PARALLEL) != 0u);
    let faces = (flags & SURFACE) == 0u || cosine > 0.0;
    return select(vec3<f32>(0.0), light.emit.xyz * (of_surface * spot * spot * falloff * max(dot(wi, n), 0.0)), faces);
}

fn meets(i: u32, origin: vec3<f32>, d: vec3<f32>) -> bool {
    let e1 = triangle_e1[i].xyz;
    let e2 = triangle_e2[i].xyz;
    let p = cross(d, e2);
    let det = dot(e1, p);
    let inverse = 1.0 / select(det, 1.0, det == 0.0);
    let s = origin - triangle_v0[i].xyz;
    let u = dot(s, p) * inverse;
    let q = cross(s, e1);
    let v = dot(d, q) * inverse;
    let t = dot(e2, q) * inverse;
    let slack = 1e-5;
    return det != 0.0 && u >= -slack && v >= -slack && u + v <= 1.0 + slack && t > 0.0 && t < 1.0;
}

// Whether a triangle lies between a point and a light. The point lies off its own surface, as lights do: by some 1e-5 of its greatest
// coordinate along the normal. Surfaces with alpha block here.
fn is_blocked(origin: vec3<f32>, to: vec3<f32>, nodes: u32) -> bool {
    let tiny = vec3<f32>(1e-30);
    let inverse = 1.0 / select(to, select(tiny, -tiny, to < vec3<f32>(0.0)), abs(to) < tiny);
    var node = 0u;
    while node < nodes {
        let low = node_min[node];
        let high = node_max[node];
        let a = (low.xyz - origin) * inverse;
        let b = (high.xyz - origin) * inverse;
        let near = min(a, b);
        let far = max(a, b);
        // Widened by more than rounding.
        let end = min(min(far.x, far.y), far.z) * 1.000001;
        let inside = max(max(near.x, near.y), max(near.z, 0.0)) <= min(end, 1.0);
        let leaf = bitcast<u32>(high.w);
        let first = leaf >> 3u;
        let last = first + select(0u, leaf & 7u, inside);
        for (var i = first; i < last; i += 1u) {
            if meets(i, origin, to) {
                return true;
            }
        }
        // Into an inner node that the ray meets, else past all nodes below.
        node = select(bitcast<u32>(low.w), node + 1u, inside && leaf == 0u);
    }
    return false;
}
