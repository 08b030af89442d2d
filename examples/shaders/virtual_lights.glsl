// Virtual lights of lightsum in a shader of the host, for `#version 450`. The same in WGSL, with its comments: virtual_lights.wgsl.

struct PointLight {
    vec4 position;
    vec4 normal;
    vec4 emit;
    vec4 wi;
    vec4 flux;
    vec4 f0;
};

const uint SURFACE = 1u;
const uint CLIPPED = 2u;
const uint PARALLEL = 4u;
const uint DIRECTED = 32u;

layout(set = 0, binding = 0, std430) readonly buffer Lights { PointLight lights[]; };
layout(set = 0, binding = 1, std430) readonly buffer NodeMin { vec4 node_min[]; };
layout(set = 0, binding = 2, std430) readonly buffer NodeMax { vec4 node_max[]; };
layout(set = 0, binding = 3, std430) readonly buffer V0 { vec4 triangle_v0[]; };
layout(set = 0, binding = 4, std430) readonly buffer E1 { vec4 triangle_e1[]; };
layout(set = 0, binding = 5, std430) readonly buffer E2 { vec4 triangle_e2[]; };

vec3 to_light(PointLight light, vec3 x, float far) {
    bool parallel = (floatBitsToUint(light.position.w) & PARALLEL) != 0u;
    return parallel ? -far * light.normal.xyz : light.position.xyz - x;
}

vec3 irradiance(PointLight light, vec3 to, vec3 n, float clip) {
    uint flags = floatBitsToUint(light.position.w);
    float r2 = max(dot(to, to), 1e-37);
    vec3 wi = to / sqrt(r2);
    float cosine = -dot(wi, light.normal.xyz);
    float spot = clamp(cosine * light.normal.w + light.emit.w, 0.0, 1.0);
    float exponent = (flags & DIRECTED) != 0u ? light.normal.w + 1.0 : 1.0;
    float of_surface = (flags & SURFACE) != 0u ? pow(max(cosine, 1e-20), exponent) : 1.0;
    float nearest = (flags & CLIPPED) != 0u ? clip * clip : 0.0;
    float falloff = (flags & PARALLEL) != 0u ? 1.0 : 1.0 / max(r2, nearest);
    bool faces = (flags & SURFACE) == 0u || cosine > 0.0;
    return faces ? light.emit.xyz * (of_surface * spot * spot * falloff * max(dot(wi, n), 0.0)) : vec3(0.0);
}

bool meets(uint i, vec3 origin, vec3 d) {
    vec3 e1 = triangle_e1[i].xyz;
    vec3 e2 = triangle_e2[i].xyz;
    vec3 p = cross(d, e2);
    float det = dot(e1, p);
    float inv = 1.0 / (det == 0.0 ? 1.0 : det);
    vec3 s = origin - triangle_v0[i].xyz;
    float u = dot(s, p) * inv;
    vec3 q = cross(s, e1);
    float v = dot(d, q) * inv;
    float t = dot(e2, q) * inv;
    float slack = 1e-5;
    return det != 0.0 && u >= -slack && v >= -slack && u + v <= 1.0 + slack && t > 0.0 && t < 1.0;
}

float guarded(float x) {
    return abs(x) < 1e-30 ? (x < 0.0 ? -1e-30 : 1e-30) : x;
}

bool is_blocked(vec3 origin, vec3 to, uint nodes) {
    vec3 inv = 1.0 / vec3(guarded(to.x), guarded(to.y), guarded(to.z));
    uint node = 0u;
    while (node < nodes) {
        vec4 low = node_min[node];
        vec4 high = node_max[node];
        vec3 a = (low.xyz - origin) * inv;
        vec3 b = (high.xyz - origin) * inv;
        vec3 near = min(a, b);
        vec3 far = max(a, b);
        float end = min(min(far.x, far.y), far.z) * 1.000001;
        bool inside = max(max(near.x, near.y), max(near.z, 0.0)) <= min(end, 1.0);
        uint leaf = floatBitsToUint(high.w);
        uint first = leaf >> 3u;
        uint last = first + (inside ? leaf & 7u : 0u);
        for (uint i = first; i < last; i += 1u) {
            if (meets(i, origin, to)) {
                return true;
            }
        }
        node = inside && leaf == 0u ? node + 1u : floatBitsToUint(low.w);
    }
    return false;
}
