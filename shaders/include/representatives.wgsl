// Shading points that weigh the lights of a pool. Needs frame.wgsl. CPU twin: pass::light_lists::contribution.

// Host twin: pass::light_lists::SOFT.
const SOFT: f32 = 0.2;

// Four representatives, a component of all four in a vector.
struct Representatives {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    nx: vec4<f32>,
    ny: vec4<f32>,
    nz: vec4<f32>,
}

fn representatives_at(slots: vec4<u32>) -> Representatives {
    let p = transpose(mat4x4<f32>(point_position[slots.x], point_position[slots.y], point_position[slots.z], point_position[slots.w]));
    let n = transpose(mat4x4<f32>(point_shading[slots.x], point_shading[slots.y], point_shading[slots.z], point_shading[slots.w]));
    return Representatives(p[0], p[1], p[2], n[0], n[1], n[2]);
}

// Squared distance of a light from the nearest representative.
fn nearest2(position: vec4<f32>, at: Representatives) -> f32 {
    let x = position.x - at.x;
    let y = position.y - at.y;
    let z = position.z - at.z;
    let r2 = x * x + y * y + z * z;
    return min(min(r2.x, r2.y), min(r2.z, r2.w));
}

// The irradiance that a light of power 1 has at most at a squared distance.
fn bound_at(distance2: f32) -> f32 {
    return 1.0 / max(distance2, max(frame.right.w, 1e-7));
}

// The irradiance from a light of power 1 at each representative, without shadows.
fn contributions(position: vec4<f32>, normal: vec4<f32>, at: Representatives) -> vec4<f32> {
    let x = position.x - at.x;
    let y = position.y - at.y;
    let z = position.z - at.z;
    let r2 = max(x * x + y * y + z * z, vec4<f32>(1e-30));
    let soft = SOFT * sqrt(r2);
    let cos_point = max(x * at.nx + y * at.ny + z * at.nz + soft, vec4<f32>(0.0));
    let cos_light = max(soft - (x * normal.x + y * normal.y + z * normal.z), vec4<f32>(0.0));
    return cos_point * cos_light / (r2 * max(r2, vec4<f32>(max(frame.right.w, 1e-7))));
}
