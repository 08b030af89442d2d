// Bodies of mirrors and glass that photons are shot at. Needs math.wgsl, emitters.wgsl and an array `targets`, two for each target:
// centre, radius; weight, area, bits of first (with PLANAR) and end of its triangles. CPU twin: light::targets.

// Sparse targets are aimed at by their triangles from beyond this many radii. Host twin: light::targets::FAR.
const FAR: f32 = 4.0;
// Factor of the weight of planar mirrors that reflect virtual lights. Host twin: light::targets::MIRRORED.
const MIRRORED: f32 = 0.25;
// Bit of a target whose triangles are planar mirrors, beside the first of them. Host twin: light::targets::PLANAR.
const PLANAR: u32 = 0x80000000u;

// First triangle of a target.
fn first_triangle(parts: vec4<f32>) -> u32 {
    return bitcast<u32>(parts.z) & ~PLANAR;
}

// Whether a target is aimed at by its triangles: a sparse one that is far enough.
fn aims_by_area(sphere: vec4<f32>, parts: vec4<f32>, to: vec3<f32>, parallel: bool) -> bool {
    let reach = FAR * sphere.w;
    return first_triangle(parts) < bitcast<u32>(parts.w) && (parallel || dot(to, to) >= reach * reach);
}

// Weight of a target in the choice: about its solid angle times its reflectance, and from a surface the greatest cosine towards its sphere.
fn weight_of(t: u32, kind: u32, origin: vec3<f32>, normal: vec3<f32>) -> f32 {
    let s = targets[2u * t];
    let parts = targets[2u * t + 1u];
    let to = s.xyz - origin;
    let d2 = dot(to, to);
    let r2 = s.w * s.w;
    let oriented = kind <= EMITTER_SPHERE || kind == EMITTER_VIRTUAL;
    // Cosines of the sphere's half angle and of the angle to its centre.
    let sine2 = min(r2 / max(d2, 1e-37), 1.0);
    let half = sqrt(1.0 - sine2);
    let axis = clamp(dot(to, normal) / sqrt(max(d2, 1e-37)), -1.0, 1.0);
    let aside = axis * half + sqrt((1.0 - axis * axis) * sine2);
    let behind = axis * axis >= sine2 && axis <= 0.0;
    let greatest = select(select(aside, 1.0, axis >= half), 0.0, behind);
    let parallel = is_parallel(kind);
    let by_sphere = aims_by_area(s, parts, to, false) != aims_by_area(s, parts, to, true);
    let planar = (bitcast<u32>(parts.z) & PLANAR) != 0u;
    let own = parts.x * select(1.0, MIRRORED, planar && frame.mirrors.z > 0u);
    let weight = own * select(1.0, 2.0 * PI * r2 / parts.y, by_sphere);
    let angle = weight / max(d2, r2) * select(1.0, greatest, oriented);
    return select(angle, own, parallel);
}
