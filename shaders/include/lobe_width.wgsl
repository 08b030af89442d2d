// Widths of lobes, GGX or by phong.wgsl, from the alpha of a reflectance. CPU twin: bsdf::phong.

// Alpha of a GGX lobe about as wide.
fn width_of(alpha: f32) -> f32 {
    return select(alpha, sqrt(-0.5 / min(alpha, -1e-6)), alpha < 0.0);
}

// The lobe widened to at least the width of this alpha.
fn widened_alpha(alpha: f32, least: f32) -> f32 {
    return max(alpha, select(least, -0.5 / (least * least), alpha < 0.0));
}
