// Textures. The including kernel declares `textures` and `texels`. Host twin: pass::layout::TextureRecord; CPU twin:
// scene::texture.

struct TextureRecord {
    first: u32,             // first texel
    width: u32,
    height: u32,
    flags: u32,             // bit 0: sRGB; bits 1-2: wrap of u, 3-4: of v (0 repeat, 1 mirror, 2 clamp)
}

fn wrapped(i: i32, n: i32, mode: u32) -> i32 {
    let clamped = clamp(i, 0, n - 1);
    let repeated = ((i % n) + n) % n;
    let period = ((i % (2 * n)) + 2 * n) % (2 * n);
    let mirrored = min(period, 2 * n - 1 - period);
    return select(select(clamped, mirrored, mode == 1u), repeated, mode == 0u);
}

fn srgb_to_linear(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3<f32>(2.4)), c / 12.92, c <= vec3<f32>(0.04045));
}

fn texel(record: TextureRecord, x: i32, y: i32) -> vec4<f32> {
    let tx = wrapped(x, i32(record.width), (record.flags >> 1u) & 3u);
    let ty = wrapped(y, i32(record.height), (record.flags >> 3u) & 3u);
    let c = unpack4x8unorm(texels[record.first + u32(ty) * record.width + u32(tx)]);
    return vec4<f32>(select(c.xyz, srgb_to_linear(c.xyz), (record.flags & 1u) != 0u), c.w);
}

// Bilinear; texel centres lie at half-integers. Colour is decoded first; alpha is linear.
fn sample_texture(index: u32, uv: vec2<f32>) -> vec4<f32> {
    let record = textures[index];
    // Large coordinates are reduced first, so that the conversion to integers is safe.
    let period = vec2<f32>(2.0);
    let near = uv - period * floor(uv / period);
    let clamps = vec2<bool>(((record.flags >> 1u) & 3u) == 2u, ((record.flags >> 3u) & 3u) == 2u);
    let st = select(near, clamp(uv, vec2<f32>(0.0), vec2<f32>(1.0)), clamps);
    let p = st * vec2<f32>(f32(record.width), f32(record.height)) - 0.5;
    let base = floor(p);
    let f = p - base;
    let x = i32(base.x);
    let y = i32(base.y);
    let top = mix(texel(record, x, y), texel(record, x + 1, y), f.x);
    let bottom = mix(texel(record, x, y + 1), texel(record, x + 1, y + 1), f.x);
    return mix(top, bottom, f.y);
}
