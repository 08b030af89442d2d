// Unit vectors in 2 x 16 bits, signed, by octahedral encoding (Meyer et al. 2010).

fn encode_normal(n: vec3<f32>) -> u32 {
    let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let folded = (1.0 - abs(p.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), p >= vec2<f32>(0.0));
    return pack2x16snorm(select(folded, p, n.z >= 0.0));
}

fn decode_normal(bits: u32) -> vec3<f32> {
    let e = unpack2x16snorm(bits);
    let z = 1.0 - abs(e.x) - abs(e.y);
    let fold = max(-z, 0.0);
    let n = vec3<f32>(e - select(vec2<f32>(-fold), vec2<f32>(fold), e >= vec2<f32>(0.0)), z);
    return n / sqrt(dot(n, n));
}
