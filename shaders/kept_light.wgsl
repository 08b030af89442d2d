// Lights shading points by the irradiance kept in textures. See pass/kept_light.rs.
#include "frame.wgsl"

@group(0) @binding(1) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> triangle_e2: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> kept_faces: array<vec4<f32>>;     // for each triangle front and back: two corners; the third, bits of page + 1, -
@group(0) @binding(6) var<storage, read> kept_pages: array<vec4<u32>>;     // first texel, width, height, bits of the unit
@group(0) @binding(7) var<storage, read> kept_texels: array<u32>;          // three words each: six halves, direct and indirect
@group(0) @binding(8) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> specular: array<vec4<f32>>;

struct Kept {
    direct: vec3<f32>,
    indirect: vec3<f32>,
}

fn kept_texel(i: u32) -> Kept {
    let a = unpack2x16float(kept_texels[3u * i]);
    let b = unpack2x16float(kept_texels[3u * i + 1u]);
    let c = unpack2x16float(kept_texels[3u * i + 2u]);
    return Kept(vec3<f32>(a, b.x), vec3<f32>(b.y, c));
}

#if BICUBIC
// Mitchell's filter (1/3, 1/3) at four texels, the second of them t before.
fn mitchell(t: f32) -> vec4<f32> {
    let near = vec2<f32>(t, 1.0 - t);
    let far = 1.0 + near;
    let inner = ((21.0 * near - 36.0) * near * near + 16.0) / 18.0;
    let outer = (((36.0 - 7.0 * far) * far - 60.0) * far + 32.0) / 18.0;
    return vec4<f32>(outer.x, inner, outer.y);
}
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let slot = (group.x + group.y * groups.x) * 64u + lane;
    if slot >= arrayLength(&direct) {
        return;
    }
    let hit = hits[slot];
    // Slots of second components that no path uses hold anything.
    let triangle = min(bitcast<u32>(hit.w), arrayLength(&triangle_e1) - 1u);
    let back = dot(cross(triangle_e1[triangle].xyz, triangle_e2[triangle].xyz), ray_direction[slot].xyz) >= 0.0;
    let face = 4u * triangle + select(0u, 2u, back);
    let corners = kept_faces[face];
    let rest = kept_faces[face + 1u];
    let number = bitcast<u32>(rest.z);
    let has_light = number != 0u;
    let page = kept_pages[select(0u, number - 1u, has_light)];
    let at = (1.0 - hit.y - hit.z) * corners.xy + hit.y * corners.zw + hit.z * rest.xy - 0.5;
    let first = floor(at);
    let part = at - first;
    let most = vec2<f32>(page.yz - 1u);
#if BICUBIC
    let across = mitchell(part.x);
    let down = mitchell(part.y);
    var sum = Kept(vec3<f32>(0.0), vec3<f32>(0.0));
    for (var i = 0u; i < 16u; i += 1u) {
        let place = clamp(first + vec2<f32>(f32(i & 3u), f32(i >> 2u)) - 1.0, vec2<f32>(0.0), most);
        let texel = kept_texel(page.x + u32(place.x) + u32(place.y) * page.y);
        let weight = across[i & 3u] * down[i >> 2u];
        sum.direct += weight * texel.direct;
        sum.indirect += weight * texel.indirect;
    }
    // The filter is negative at its border.
    let kept = Kept(max(sum.direct, vec3<f32>(0.0)), max(sum.indirect, vec3<f32>(0.0)));
#else
    let low = vec2<u32>(clamp(first, vec2<f32>(0.0), most));
    let high = vec2<u32>(clamp(first + 1.0, vec2<f32>(0.0), most));
    let a = kept_texel(page.x + low.x + low.y * page.y);
    let b = kept_texel(page.x + high.x + low.y * page.y);
    let c = kept_texel(page.x + low.x + high.y * page.y);
    let d = kept_texel(page.x + high.x + high.y * page.y);
    let kept = Kept(
        mix(mix(a.direct, b.direct, part.x), mix(c.direct, d.direct, part.x), part.y),
        mix(mix(a.indirect, b.indirect, part.x), mix(c.indirect, d.indirect, part.x), part.y),
    );
#endif
    let unit = select(0.0, bitcast<f32>(page.w), has_light);
    direct[slot] = vec4<f32>(unit * kept.direct, 0.0);
    indirect[slot] = vec4<f32>(unit * kept.indirect, 0.0);
    specular[slot] = vec4<f32>(0.0);
}
