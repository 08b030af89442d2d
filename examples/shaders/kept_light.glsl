// Light kept in textures by lightsum in a shader of the host, for `#version 450`. The same in WGSL, with its comments: kept_light.wgsl.

layout(set = 0, binding = 0, std430) readonly buffer KeptFaces { vec4 kept_faces[]; };
layout(set = 0, binding = 1, std430) readonly buffer KeptPages { uvec4 kept_pages[]; };
layout(set = 0, binding = 2, std430) readonly buffer KeptTexels { uint kept_texels[]; };

struct Kept {
    vec3 direct;
    vec3 indirect;
};

Kept kept_texel(uint i) {
    vec2 a = unpackHalf2x16(kept_texels[3u * i]);
    vec2 b = unpackHalf2x16(kept_texels[3u * i + 1u]);
    vec2 c = unpackHalf2x16(kept_texels[3u * i + 2u]);
    return Kept(vec3(a, b.x), vec3(b.y, c));
}

Kept kept_irradiance(uint triangle, vec2 uv, bool back) {
    uint face = 4u * triangle + (back ? 2u : 0u);
    vec4 corners = kept_faces[face];
    vec4 rest = kept_faces[face + 1u];
    uint number = floatBitsToUint(rest.z);
    if (number == 0u) {
        return Kept(vec3(0.0), vec3(0.0));
    }
    uvec4 page = kept_pages[number - 1u];
    vec2 at = (1.0 - uv.x - uv.y) * corners.xy + uv.x * corners.zw + uv.y * rest.xy - 0.5;
    vec2 first = floor(at);
    vec2 part = at - first;
    vec2 most = vec2(page.yz - uvec2(1u));
    uvec2 low = uvec2(clamp(first, vec2(0.0), most));
    uvec2 high = uvec2(clamp(first + vec2(1.0), vec2(0.0), most));
    Kept a = kept_texel(page.x + low.x + low.y * page.y);
    Kept b = kept_texel(page.x + high.x + low.y * page.y);
    Kept c = kept_texel(page.x + low.x + high.y * page.y);
    Kept d = kept_texel(page.x + high.x + high.y * page.y);
    float unit = uintBitsToFloat(page.w);
    return Kept(
        unit * mix(mix(a.direct, b.direct, part.x), mix(c.direct, d.direct, part.x), part.y),
        unit * mix(mix(a.indirect, b.indirect, part.x), mix(c.indirect, d.indirect, part.x), part.y)
    );
}
