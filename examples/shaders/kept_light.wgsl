// Light kept in textures by lightsum, in a shader of the host. Buffers: lightsum::pass::kept_light::KeptBuffers. The same in GLSL: kept_light.glsl.

@group(0) @binding(0) var<storage, read> kept_faces: array<vec4<f32>>;     // for each triangle front and back: (u, v) of two corners; of the third, bits of 1 + its page
@group(0) @binding(1) var<storage, read> kept_pages: array<vec4<u32>>;     // first texel, width, height, bits of the unit
@group(0) @binding(2) var<storage, read> kept_texels: array<u32>;          // three words each: six halves, of direct and of indirect irradiance

struct Kept {
    direct: vec3<f32>,      // irradiance from the emitters, W/m^2
    indirect: vec3<f32>,    // after one or more reflections
}

fn kept_texel(i: u32) -> Kept {
    let a = unpack2x16float(kept_texels[3u * i]);
    let b = unpack2x16float(kept_texels[3u * i + 1u]);
    let c = unpack2x16float(kept_texels[3u * i + 2u]);
    return Kept(vec3<f32>(a, b.x), vec3<f32>(b.y, c));
}

// Irradiance at a point of a triangle in the order of the leaves (lightsum::accel::Bvh::leaf_numbers): the weights of its second and third
// corner, and whether it is seen from the back. Bilinear between four texels; 0 on sides that no light reaches.
fn kept_irradiance(triangle: u32, uv: vec2<f32>, back: bool) -> Kept {
    let face = 4u * triangle + select(0u, 2u, back);
    let corners = kept_faces[face];
    let rest = kept_faces[face + 1u];
    let number = bitcast<u32>(rest.z);
    if number == 0u {
        return Kept(vec3<f32>(0.0), vec3<f32>(0.0));
    }
    let page = kept_pages[number - 1u];
    let at = (1.0 - uv.x - uv.y) * corners.xy + uv.x * corners.zw + uv.y * rest.xy - 0.5;
    let first = floor(at);
    let part = at - first;
    let most = vec2<f32>(page.yz - 1u);
    let low = vec2<u32>(clamp(first, vec2<f32>(0.0), most));
    let high = vec2<u32>(clamp(first + 1.0, vec2<f32>(0.0), most));
    let a = kept_texel(page.x + low.x + low.y * page.y);
    let b = kept_texel(page.x + high.x + low.y * page.y);
    let c = kept_texel(page.x + low.x + high.y * page.y);
    let d = kept_texel(page.x + high.x + high.y * page.y);
    let unit = bitcast<f32>(page.w);
    return Kept(
        unit * mix(mix(a.direct, b.direct, part.x), mix(c.direct, d.direct, part.x), part.y),
        unit * mix(mix(a.indirect, b.indirect, part.x), mix(c.indirect, d.indirect, part.x), part.y),
    );
}
