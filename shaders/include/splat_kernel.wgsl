// The kernel of a splat, and the part of it that lies on a planar surface. CPU twins: pass::splat_light::{kernel, coverage}.

// A Gaussian of deviation h / 4, cut off at h / 2: exp(-SHARPNESS d^2 / h^2), and its integral without the cut over that with it.
const SHARPNESS: f32 = 8.0;
const CUT_OFF: f32 = 1.1565176;
// Smallest part of a kernel that a light is divided by. Host twin: pass::splat_light::MIN_COVERED.
const MIN_COVERED: f32 = 1e-3;

// At the square of the distance over h^2; its integral over the plane is h^2.
fn splat_kernel(part: f32) -> f32 {
    return select(0.0, exp(-SHARPNESS * part) * (CUT_OFF * SHARPNESS * INV_PI), part < 0.25);
}

// Integral of the kernel within a wedge between the foot of the perpendicular to a line at a distance (over h) and the direction at an
// angle from it, up to the line, over 2 pi: by eight points of Gauss and Legendre up to where the line leaves the kernel.
fn wedge(distance: f32, angle: f32) -> f32 {
    const X = array<f32, 4>(0.18343464, 0.52553241, 0.79666648, 0.96028986);
    const W = array<f32, 4>(0.36268378, 0.31370665, 0.22238103, 0.10122854);
    let leaves = acos(clamp(2.0 * distance, 0.0, 1.0));
    let to = min(abs(angle), leaves);
    var sum = 0.0;
    for (var k = 0u; k < 8u; k += 1u) {
        let i = k >> 1u;
        let theta = 0.5 * to * (1.0 + select(-X[i], X[i], (k & 1u) == 0u));
        let reach = distance / max(cos(theta), 1e-6);
        sum += W[i] * (1.0 - exp(-SHARPNESS * reach * reach));
    }
    let whole = 0.5 * to * sum * CUT_OFF + abs(angle) - to;
    return select(-whole, whole, angle >= 0.0) * (0.5 * INV_PI);
}

// Contribution of the directed edge from a to b to the part of a kernel within an outline.
fn edge_part(x: vec3<f32>, n: vec3<f32>, a: vec3<f32>, b: vec3<f32>, width: f32) -> f32 {
    let along = b - a;
    let length2 = dot(along, along);
    let t = along / sqrt(max(length2, 1e-37));
    let distance = dot(n, cross(t, x - a));
    let d = abs(distance);
    let turn = wedge(d / width, atan2(dot(b - x, t), d)) - wedge(d / width, atan2(dot(a - x, t), d));
    return select(0.0, select(-turn, turn, distance >= 0.0), length2 > 0.0 && d > 0.0);
}
