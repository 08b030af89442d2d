// Rays towards near emitters. Needs frame.wgsl, math.wgsl and emitters.wgsl, and `emitters` bound. Host twin: pass::near_aim.

const AIM_EMITTERS: u32 = 8u;       // at most; scenes with more have none of these rays
const AIM_HEIGHT: f32 = 1e-4;       // over the plane of a parallelogram, at least, in lengths of its longer edge

// The part of an emitter that a point can reach, in coordinates relative to the point.
struct Aim {
    kind: u32,
    weight: f32,        // chance to be chosen, in any unit; 0: nothing can be reached
    origin: vec3<f32>,  // of a parallelogram the foot of the perpendicular, of a triangle the first corner, of a sphere the direction to its centre
    measure: f32,       // of a parallelogram the height over its plane, of a triangle the area, of a sphere 1 - cosine of the angle of its radius
    e1: vec3<f32>,      // edges, of a parallelogram unit vectors
    e2: vec3<f32>,
    normal: vec3<f32>,
    low: vec2<f32>,     // of a parallelogram the part along the edges from the foot
    high: vec2<f32>,
}

fn aim_emitters() -> u32 {
    return select(0u, frame.scene.y, frame.scene.y <= AIM_EMITTERS);
}

// An emitter seen from a point with normal n, as far as `reach`.
fn aim_at(index: u32, point: vec3<f32>, n: vec3<f32>, reach: f32) -> Aim {
    let e = emitters[index];
    let kind = bitcast<u32>(e.p0.w);
    let flags = bitcast<u32>(e.e2.w);
    let to = e.p0.xyz - point;
    let none = vec2<f32>(0.0);
    if kind == EMITTER_SPHERE {
        let distance = sqrt(dot(to, to));
        let radius = e.e1.x;
        let sine = radius / max(distance, 1e-37);
        let reached = (flags & 2u) == 0u && sine < 1.0 && distance - radius < reach && dot(to, n) > -radius;
        let cap = sine * sine / (1.0 + sqrt(max(1.0 - sine * sine, 0.0)));
        let weight = select(0.0, mean3(e.radiance.xyz) * PI * sine * sine, reached);
        return Aim(kind, weight, to / max(distance, 1e-37), cap, vec3<f32>(0.0), vec3<f32>(0.0), vec3<f32>(0.0), none, none);
    }
    let is_quad = kind == EMITTER_QUAD;
    let normal = e.normal.xyz;
    let lengths = vec2<f32>(length(e.e1.xyz), length(e.e2.xyz));
    let height = dot(to, normal);
    // Coordinates of the foot of the perpendicular.
    let foot = -along_edges(to, e.e1.xyz, e.e2.xyz, normal);
    let within = clamp(foot, vec2<f32>(0.0), vec2<f32>(1.0));
    let nearest = to + within.x * e.e1.xyz + within.y * e.e2.xyz;
    let distance2 = dot(nearest, nearest);
    // Corners above the horizon.
    let rise = vec3<f32>(dot(to, n), dot(e.e1.xyz, n), dot(e.e2.xyz, n));
    let top = rise.x + max(rise.y, 0.0) + max(rise.z, 0.0);
    let faces = height < 0.0 || (flags & 1u) != 0u;
    // Radius of the disc of the plane that is within reach, longer where the edges are skewed.
    let radius = sqrt(max(reach * reach - height * height, 0.0)) / max(length(cross(e.e1.xyz / lengths.x, e.e2.xyz / lengths.y)), 1e-6);
    let low = max(-foot * lengths, vec2<f32>(-radius));
    let high = min((1.0 - foot) * lengths, vec2<f32>(radius));
    let reached = kind <= EMITTER_QUAD && faces && top > 0.0 && distance2 < reach * reach && all(low < high);
    let weight = select(0.0, mean3(e.radiance.xyz) * e.e1.w / max(distance2 + e.e1.w, 1e-37), reached);
    let above = max(abs(height), AIM_HEIGHT * max(lengths.x, lengths.y));
    let origin = select(to, to + foot.x * e.e1.xyz + foot.y * e.e2.xyz, is_quad);
    let measure = select(e.e1.w, above, is_quad);
    let units = select(vec2<f32>(1.0), lengths, is_quad);
    return Aim(kind, weight, origin, measure, e.e1.xyz / units.x, e.e2.xyz / units.y, normal, low, high);
}

// Coordinates of a vector's projection along two edges that span a plane.
fn along_edges(v: vec3<f32>, e1: vec3<f32>, e2: vec3<f32>, normal: vec3<f32>) -> vec2<f32> {
    let a = cross(e2, normal);
    let b = cross(e1, normal);
    return vec2<f32>(dot(v, a) / dot(e1, a), dot(v, b) / dot(e2, b));
}

// Angles under which the part of a parallelogram is seen from the height over its foot: where they begin, and their ranges.
fn aim_angles(aim: Aim) -> vec4<f32> {
    let begin = atan(aim.low / aim.measure);
    return vec4<f32>(begin, atan(aim.high / aim.measure) - begin);
}

// Direction to a point there; u and v in [0, 1).
fn aim_direction(aim: Aim, u: f32, v: f32) -> vec3<f32> {
    if aim.kind == EMITTER_SPHERE {
        let across = basis(aim.origin);
        let down = u * aim.measure;
        let circle = unit_circle(v) * sqrt(max(down * (2.0 - down), 0.0));
        return circle.x * across[0] + circle.y * across[1] + (1.0 - down) * aim.origin;
    }
    let angles = aim_angles(aim);
    let by_angle = clamp(aim.measure * tan(angles.xy + vec2<f32>(u, v) * angles.zw), aim.low, aim.high);
    let root = sqrt(1.0 - u);
    let place = select(by_angle, vec2<f32>(root * (1.0 - v), root * v), aim.kind == EMITTER_TRIANGLE);
    let to = aim.origin + place.x * aim.e1 + place.y * aim.e2;
    return to / max(length(to), 1e-37);
}

// Density of a direction by solid angle.
fn aim_density(aim: Aim, wi: vec3<f32>) -> f32 {
    if aim.kind == EMITTER_SPHERE {
        return select(0.0, 1.0 / max(2.0 * PI * aim.measure, 1e-37), dot(wi, aim.origin) >= 1.0 - aim.measure);
    }
    let cosine = dot(wi, aim.normal);
    let t = dot(aim.origin, aim.normal) / select(cosine, 1e-20, abs(cosine) < 1e-20);
    let at = along_edges(t * wi - aim.origin, aim.e1, aim.e2, aim.normal);
    let is_triangle = aim.kind == EMITTER_TRIANGLE;
    let in_triangle = min(at.x, at.y) >= 0.0 && at.x + at.y <= 1.0;
    let inside = select(all(at >= aim.low) && all(at <= aim.high), in_triangle, is_triangle);
    let h2 = aim.measure * aim.measure;
    let angles = aim_angles(aim).zw;
    let skew = length(cross(aim.e1, aim.e2));
    let by_angle = (aim.measure / (h2 + at.x * at.x)) * (aim.measure / (h2 + at.y * at.y)) / (angles.x * angles.y * skew);
    let by_area = select(by_angle, 1.0 / aim.measure, is_triangle);
    return select(0.0, by_area * t * t / max(abs(cosine), 1e-20), inside && t > 0.0);
}

// Density of the rays that a point with normal n aims at emitters.
fn aimed_density(point: vec3<f32>, n: vec3<f32>, reach: f32, wi: vec3<f32>) -> f32 {
    var sum = 0.0;
    var total = 0.0;
    for (var i = 0u; i < aim_emitters(); i += 1u) {
        let aim = aim_at(i, point, n, reach);
        total += aim.weight;
        if aim.weight > 0.0 {
            sum += aim.weight * aim_density(aim, wi);
        }
    }
    return sum / max(total, 1e-37);
}
