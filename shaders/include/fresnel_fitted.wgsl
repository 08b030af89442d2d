// Directional reflectance of mirrors and of planes in mirror images. Needs frame.wgsl. CPU twin:
// superposition::reflectance.

// Fresnel term fitted to the reflectance at normal incidence (Bastos 1999, equations 6.10 to 6.14), for each band.
fn fresnel_fitted(f0: vec3<f32>, cos: f32) -> vec3<f32> {
    let root = sqrt(clamp(f0, vec3<f32>(0.0), vec3<f32>(0.999999)));
    let n = (1.0 + root) / (1.0 - root);
    let c = clamp(cos, 0.0, 1.0);
    let g = sqrt(n * n + c * c - 1.0);
    let perpendicular = (g - c) / (g + c);
    let ratio = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
    return select(0.5 * perpendicular * perpendicular * (1.0 + ratio * ratio), vec3<f32>(0.0), f0 <= vec3<f32>(0.0));
}

// Whether reflectance follows Fresnel's equations.
fn is_fresnel() -> bool {
    return frame.superposition.y != 0u;
}
