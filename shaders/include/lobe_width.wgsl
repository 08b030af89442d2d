// Widths of lobes, GGX or by phong.wgsl, anisotropic.wgsl or lobe_table.wgsl, from the alpha of a reflectance. CPU twins: bsdf::phong,
// bsdf::anisotropic, bsdf::table.

// Bits of 2.0, below those of a lobe of two widths.
const LOBE_BASE: u32 = 0x40000000u;

// Bits of 1.0, below those of a table.
const TABLE_BASE: u32 = 0x3f800000u;

fn is_table(alpha: f32) -> bool {
    return alpha > 1.0 && alpha < 2.0;
}

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

// Width of a table in such steps.
fn table_steps(alpha: f32) -> u32 {
    return ((bitcast<u32>(alpha) - TABLE_BASE) >> 1u) & 0x1ffu;
}

// Alpha of a GGX lobe about as wide; of one of two widths their geometric mean.
fn width_of(alpha: f32) -> f32 {
    let both = lobe_steps(alpha);
    let mean = select(alpha, exp2(f32(both.x + both.y) * -0.01), is_anisotropic(alpha));
    let one = select(mean, exp2(f32(table_steps(alpha)) * -0.02), is_table(alpha));
    return select(one, sqrt(-0.5 / min(alpha, -1e-6)), alpha < 0.0);
}

// The lobe widened to at least the width of this alpha.
fn widened_alpha(alpha: f32, least: f32) -> f32 {
    let both = min(lobe_steps(alpha), vec2<u32>(lobe_step(least)));
    let packed = bitcast<f32>(LOBE_BASE + ((both.x << 21u) | (both.y << 12u) | (bitcast<u32>(alpha) & 0xfffu)));
    let plain = max(alpha, select(least, -0.5 / (least * least), alpha < 0.0));
    let table = ((bitcast<u32>(alpha) - TABLE_BASE) & 0xfffffc00u) | (lobe_step(least) << 1u) | 1u;
    let narrow = is_table(alpha) && table_steps(alpha) > lobe_step(least);
    let one = select(select(plain, alpha, is_table(alpha)), bitcast<f32>(TABLE_BASE + table), narrow);
    return select(one, packed, is_anisotropic(alpha));
}
