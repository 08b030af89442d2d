// Textures. Host twins: pass::layout::{TextureRecord, LevelRecord}, device_scene::texels; CPU twin: bsdf::sample_filtered.

struct TextureRecord {
    first: u32,             // its level 0 in `texture_levels`
    last: u32,              // its last level
    flags: u32,             // bit 0: sRGB; bits 1-2: wrap of u, 3-4: of v (0 repeat, 1 mirror, 2 clamp)
    extent: f32,            // root of its number of texels
}

struct LevelRecord {
    origin: u32,            // column, and row << 16, of its corner in the layer
    size: u32,              // width, and height << 16
    layer: u32,
    page: u32,              // number of its image
}

@group(0) @binding(60) var<storage, read> textures: array<TextureRecord>;
@group(0) @binding(61) var<storage, read> texture_levels: array<LevelRecord>;
@group(0) @binding(62) var texels_0: texture_2d_array<f32>;
@group(0) @binding(63) var texels_1: texture_2d_array<f32>;
@group(0) @binding(64) var texels_2: texture_2d_array<f32>;
@group(0) @binding(65) var texels_3: texture_2d_array<f32>;

fn texel(page: u32, at: vec2<i32>, layer: u32) -> vec4<f32> {
    switch page {
        case 0u: { return textureLoad(texels_0, at, layer, 0); }
        case 1u: { return textureLoad(texels_1, at, layer, 0); }
        case 2u: { return textureLoad(texels_2, at, layer, 0); }
        default: { return textureLoad(texels_3, at, layer, 0); }
    }
}

// Index of a texel along an axis of n texels, from one beyond the first to one beyond the last of its period: n to repeat, 2n mirrored.
fn wrapped(i: vec2<i32>, n: i32, mode: u32) -> vec2<i32> {
    let repeated = i + select(vec2<i32>(0), vec2<i32>(n), i < vec2<i32>(0)) - select(vec2<i32>(0), vec2<i32>(n), i >= vec2<i32>(n));
    let back = select(i, 2 * n - 1 - i, i >= vec2<i32>(n));
    let mirrored = select(back, -1 - back, back < vec2<i32>(0));
    let clamped = clamp(i, vec2<i32>(0), vec2<i32>(n - 1));
    return select(select(clamped, mirrored, mode == 1u), repeated, mode == 0u);
}

// Coordinate within the first period, so that the texel's index stays small and exact.
fn in_period(u: f32, mode: u32) -> f32 {
    let period = select(1.0, 2.0, mode == 1u);
    return select(u - period * floor(u / period), clamp(u, 0.0, 1.0), mode == 2u);
}

fn srgb_to_linear(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3<f32>(2.4)), c / 12.92, c <= vec3<f32>(0.04045));
}

fn decoded(c: vec4<f32>, flags: u32) -> vec4<f32> {
    return vec4<f32>(select(c.xyz, srgb_to_linear(c.xyz), (flags & 1u) != 0u), c.w);
}

// Bilinear, within a level; st within the first period. Texel centres lie at half-integers. Colour is decoded first; alpha is linear.
fn sample_level(level: u32, flags: u32, st: vec2<f32>) -> vec4<f32> {
    let record = texture_levels[level];
    let size = vec2<i32>(i32(record.size & 0xffffu), i32(record.size >> 16u));
    let origin = vec2<i32>(i32(record.origin & 0xffffu), i32(record.origin >> 16u));
    let p = st * vec2<f32>(size) - 0.5;
    let base = floor(p);
    let f = p - base;
    let x = wrapped(vec2<i32>(i32(base.x), i32(base.x) + 1), size.x, (flags >> 1u) & 3u) + origin.x;
    let y = wrapped(vec2<i32>(i32(base.y), i32(base.y) + 1), size.y, (flags >> 3u) & 3u) + origin.y;
    let t0 = decoded(texel(record.page, vec2<i32>(x.x, y.x), record.layer), flags);
    let t1 = decoded(texel(record.page, vec2<i32>(x.y, y.x), record.layer), flags);
    let t2 = decoded(texel(record.page, vec2<i32>(x.x, y.y), record.layer), flags);
    let t3 = decoded(texel(record.page, vec2<i32>(x.y, y.y), record.layer), flags);
    return mix(mix(t0, t1, f.x), mix(t2, t3, f.x), f.y);
}

// Trilinear: the mean over a footprint of this width, in texture coordinates (a texture is 1 wide; 0: a point).
fn sample_texture(index: u32, uv: vec2<f32>, footprint: f32) -> vec4<f32> {
    let record = textures[index];
    let st = vec2<f32>(in_period(uv.x, (record.flags >> 1u) & 3u), in_period(uv.y, (record.flags >> 3u) & 3u));
    let level = min(log2(max(footprint * record.extent, 1.0)), f32(record.last - record.first));
    let fine = record.first + u32(level);
    let coarse = min(fine + 1u, record.last);
    return mix(sample_level(fine, record.flags, st), sample_level(coarse, record.flags, st), fract(level));
}

// Bilinear, from the texture itself.
fn sample_finest(index: u32, uv: vec2<f32>) -> vec4<f32> {
    let record = textures[index];
    let st = vec2<f32>(in_period(uv.x, (record.flags >> 1u) & 3u), in_period(uv.y, (record.flags >> 3u) & 3u));
    return sample_level(record.first, record.flags, st);
}
