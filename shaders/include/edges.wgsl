// First hits of eye rays, and which of them lie on one surface. Needs frame.wgsl, math.wgsl, bsdf.wgsl, surface.wgsl and camera.wgsl.
// MIRRORS: reflections in flat mirrors are told apart, too. CPU twins: pass::edges::{FirstHit, Shown, same_surface, same_shown}.

struct FirstHit {
    found: bool,            // false: the ray met nothing
    triangle: u32,
    material: u32,
    front: bool,            // seen from its front
    normal: vec3<f32>,      // geometric, towards the eye
    position: vec3<f32>,    // from the eye
    t: f32,
}

// `triangle`: bits as in `hits.w`.
fn first_hit(triangle: u32, t: f32, ray: EyeRay) -> FirstHit {
    let found = triangle != 0xffffffffu;
    let at = select(0u, triangle, found);
    let face = cross(triangle_e1[at].xyz, triangle_e2[at].xyz);
    let normal = face / sqrt(dot(face, face));
    let front = dot(normal, ray.d) < 0.0;
    return FirstHit(found, triangle, material_of(triangle_normals[at]), front, select(-normal, normal, front), ray.start + t * ray.d, t);
}

// Pixels are thought to show one surface if their triangles have one material and nearly one plane: to the size of a pixel, and to 18 degrees.
fn same_surface(a: FirstHit, b: FirstHit) -> bool {
    let between = b.position - a.position;
    let pixel = 2.0 * sqrt(dot(frame.up.xyz, frame.up.xyz)) / f32(frame.within.w);
    let tolerance = pixel * depth_scale(max(a.t, b.t));
    let near = abs(dot(a.normal, between)) <= tolerance && abs(dot(b.normal, between)) <= tolerance;
    let alike = a.material == b.material && a.front == b.front && dot(a.normal, b.normal) > 0.95 && near;
    return a.triangle == b.triangle || (a.found && b.found && alike);
}

// The eye ray of a pixel, through an offset in pixels from its upper left corner; its direction is of unit length.
fn eye_ray(at: vec2<u32>, offset: vec2<f32>) -> EyeRay {
    let ray = ray_through(f32(at.x + frame.within.x) + offset.x, f32(at.y + frame.within.y) + offset.y);
    return EyeRay(ray.start, ray.d / sqrt(dot(ray.d, ray.d)));
}

#if MIRRORS
// Triangle of `second_hits` where a pixel shows no reflection in a flat mirror.
const NO_MIRROR: u32 = 0xfffffffeu;

// The surfaces that an eye ray shows: its first hit, and behind a flat mirror without a diffuse base the hit of the reflected ray.
struct Shown {
    first: FirstHit,
    mirrored: bool,
    second: FirstHit,       // position from the eye, t: length of both segments
}

fn mirrored_direction(d: vec3<f32>, n: vec3<f32>) -> vec3<f32> {
    return d - 2.0 * dot(n, d) * n;
}

// Whether a triangle is of a flat mirror without a diffuse base.
fn is_plain_mirror(triangle: u32) -> bool {
    let found = triangle < NO_MIRROR;
    let normals = triangle_normals[select(0u, triangle, found)];
    let material = materials[material_of(normals)];
    let black = all(material.base.xyz == vec3<f32>(0.0));
    return found && (normals.w & 1u) == 0u && material.flags.z == SURFACE_MIRROR && black;
}

// `first` and `second`: triangle and bits of t as in `first_hits` and `second_hits`; ray: the eye ray.
fn shown_by(first: vec2<u32>, second: vec2<u32>, ray: EyeRay) -> Shown {
    let mirrored = second.x != NO_MIRROR;
    let mirror = first_hit(first.x, bitcast<f32>(first.y), ray);
    let beyond = select(0xffffffffu, second.x, mirrored);
    let onward = EyeRay(mirror.position, mirrored_direction(ray.d, mirror.normal));
    var met = first_hit(beyond, select(0.0, bitcast<f32>(second.y), mirrored), onward);
    met.t += mirror.t;
    return Shown(mirror, mirrored, met);
}

fn same_shown(a: Shown, b: Shown) -> bool {
    let alike = !a.mirrored || same_surface(a.second, b.second);
    return same_surface(a.first, b.first) && a.mirrored == b.mirrored && alike;
}
#endif
