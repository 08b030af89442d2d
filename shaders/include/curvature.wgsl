// How a smooth curved surface mirrors the rays of neighbouring pixels. Needs frame.wgsl and surface.wgsl. CPU twin: pass::curvature.

// Least power of a surface times the distance from the eye: more concave ones show no mirror image. Host twin: pass::curvature::MOST_CONCAVE.
const MOST_CONCAVE: f32 = -0.5;
// Faces steeper than this against the interpolated normal count as flat: least cosine. Host twin: pass::curvature::STEEPEST.
const STEEPEST: f32 = 0.01;

struct Bend {
    normal: vec3<f32>,  // mirrors the ray
    u: vec3<f32>,       // across the ray in the plane of incidence, on the side of the normal
    mu: f32,            // cosine between the normal and the view
    power: vec3<f32>,   // along u, mixed, and across: added to the reciprocal distance of the mirror image
    mild: bool,         // flat, convex or hardly concave
}

// At barycentric coordinates of a triangle that a ray in direction d meets at distance t from the eye.
fn bend_at(triangle: u32, hit_u: f32, hit_v: f32, d: vec3<f32>, t: f32) -> Bend {
    let e1 = triangle_e1[triangle].xyz;
    let e2 = triangle_e2[triangle].xyz;
    let normals = triangle_normals[triangle];
    let face = cross(e1, e2);
    let face_normal = face / sqrt(dot(face, face));
    let geometric = select(-face_normal, face_normal, dot(face_normal, d) < 0.0);
    let n0 = decode_normal(normals.x);
    let to_n1 = decode_normal(normals.y) - n0;
    let to_n2 = decode_normal(normals.z) - n0;
    let blend = n0 + hit_u * to_n1 + hit_v * to_n2;
    let length = sqrt(max(dot(blend, blend), 1e-20));
    let side = select(-1.0, 1.0, dot(blend, geometric) >= 0.0);
    let shading = blend * (side / length);
    let mirrored = d - shading * (2.0 * dot(shading, d));
    // The geometric normal replaces the shading normal if that would send the ray into the surface, as at ideal mirrors.
    let above = dot(shading, d) < 0.0 && dot(mirrored, geometric) > 0.0;
    let n = select(geometric, shading, above);
    let mu = -dot(n, d);

    // u, v span the plane across the ray; e, v the tangent plane.
    let along = d + mu * n;
    let aslant = n + mu * d;
    let turned = dot(aslant, aslant) > 1e-10;
    let right = frame.right.xyz - d * dot(frame.right.xyz, d);
    let any = right / sqrt(max(dot(right, right), 1e-37));
    let u = select(any, aslant / sqrt(max(dot(aslant, aslant), 1e-37)), turned);
    let e = select(any, along / sqrt(max(dot(along, along), 1e-37)), turned);
    let v = cross(d, u);
    let edge1 = vec2<f32>(dot(e1, e), dot(e1, v));
    let edge2 = vec2<f32>(dot(e2, e), dot(e2, v));
    let turn1 = vec2<f32>(dot(to_n1, e), dot(to_n1, v)) * (side / length);
    let turn2 = vec2<f32>(dot(to_n2, e), dot(to_n2, v)) * (side / length);
    let area = edge1.x * edge2.y - edge1.y * edge2.x;
    let curved = abs(area) > STEEPEST * sqrt(dot(face, face));
    let inverse = select(0.0, 1.0 / area, curved);
    let shape_e = (turn1.x * edge2.y - turn2.x * edge1.y) * inverse;
    let shape_v = (turn2.y * edge1.x - turn1.y * edge2.x) * inverse;
    let shape_ev = 0.5 * (turn2.x * edge1.x - turn1.x * edge2.x + turn1.y * edge2.y - turn2.y * edge1.y) * inverse;

    var bend: Bend;
    bend.normal = n;
    bend.u = u;
    bend.mu = mu;
    bend.power = 2.0 * vec3<f32>(shape_e / max(mu, 1e-3), shape_ev, shape_v * mu);
    let half = 0.5 * (bend.power.x - bend.power.z);
    let least = 0.5 * (bend.power.x + bend.power.z) - sqrt(half * half + bend.power.y * bend.power.y);
    bend.mild = t * least >= MOST_CONCAVE;
    return bend;
}
