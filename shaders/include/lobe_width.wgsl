// Widths of lobes, GGX or by phong.wgsl or anisotropic.wgsl, from the alpha of a reflectance. CPU twins: bsdf::phong, bsdf::anisotropic.

// Bits of 2.0, below those of a lobe of two widths.
const LOBE_BASE: u32 = 0x40000000u;

fn is_anisotropic(alpha: f32) -> bool {
    return alpha >= 2.0;
}

// An alpha in steps of a 50th of an octave, and those of a lobe of two widths.
fn lobe_step(alpha: f32) -> u32 {
    return u32(clamp(-50.0 * log2(alpha) + 0.5, 0.0, 507.0));
}

fn lobe_steps(alpha: f32) -> vec2<u32> {
    let word = bitcast<u32>(alpha);
    return vec2<u32>((word - LOBE_BASE) >> 21u, (word >> 12u) & 0x1ffu);
}

// Alpha of a GGX lobe about as wide; of one of two widths their geometric mean.
fn width_of(alpha: f32) -> f32 {
    let both = lobe_steps(alpha);
    let mean = select(alpha, exp2(f32(both.x + both.y) * -0.01), is_anisotropic(alpha));
    return select(mean, sqrt(-0.5 / min(alpha, -1e-6)), alpha < 0.0);
}

// The lobe widened to at least the width of this alpha.
fn widened_alpha(alpha: f32, least: f32) -> f32 {
    let both = min(lobe_steps(alpha), vec2<u32>(lobe_step(least)));
    let packed = bitcast<f32>(LOBE_BASE + ((both.x << 21u) | (both.y << 12u) | (bitcast<u32>(alpha) & 0xfffu)));
    let plain = max(alpha, select(least, -0.5 / (least * least), alpha < 0.0));
    return select(plain, packed, is_anisotropic(alpha));
}
