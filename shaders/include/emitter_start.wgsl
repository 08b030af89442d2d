// Start points and directions of particles. Needs frame.wgsl, math.wgsl, emitters.wgsl, and the emitters bound
// as `emitters`. CPU twin: light::emitters.
// UNTEXTURED: there are no textures.
#include "environment.wgsl"
#include "cosine.wgsl"
#if UNTEXTURED
#else
#include "texture.wgsl"
#endif

struct Start {
    emitter: u32,
    kind: u32,
    position: vec3<f32>,    // on the emitter itself
    origin: vec3<f32>,      // the same with the ray-origin offset
    normal: vec3<f32>,      // axis of the emission
    radiance: vec4<f32>,    // of the environment from this direction, with its density; of surfaces exitance over pi at this point
    flux: vec3<f32>,        // of a particle if it were the only one
    exponent: f32,          // of the cosine by which a surface emits
}

// Texture of a triangle or quad at coordinates along its edges.
fn pattern_at(e: EmitterRecord, along: vec2<f32>) -> vec3<f32> {
    var color = vec3<f32>(1.0);
#if UNTEXTURED
#else
    let word = bitcast<u32>(e.pattern.z);
    for (var j = select(0u, 1u, word != 0u); j > 0u; j -= 1u) {
        color = sample_finest((word & 0x7fffffu) - 1u, e.uv.xy + along.x * e.uv.zw + along.y * e.pattern.xy).xyz;
    }
#endif
    return color;
}

// The first emitter whose interval ends above u: at most 32 halvings.
fn choose(u: f32) -> u32 {
    var low = 0u;
    var high = frame.scene.y - 1u;
    while low < high {
        let middle = (low + high) / 2u;
        let above = emitters[middle].radiance.w > u;
        high = select(high, middle, above);
        low = select(middle + 1u, low, above);
    }
    return low;
}

// Composition method: the number that chooses the emitter is stretched and used again for the point on it. `side` chooses the side
// of a two-sided emitter.
fn start_at(place: vec2<f32>, side: f32) -> Start {
    let index = choose(place.x);
    let e = emitters[index];
    let lower = select(0.0, emitters[max(index, 1u) - 1u].radiance.w, index > 0u);
    let u0 = clamp((place.x - lower) / e.normal.w, 0.0, ONE_MINUS_EPSILON);
    let u1 = place.y;
    let kind = bitcast<u32>(e.p0.w);
    let flags = bitcast<u32>(e.e2.w);
    let axis = e.normal.xyz;
    let flipped = select(axis, -axis, (flags & 1u) != 0u && side < 0.5);

    var position = e.p0.xyz;
    var normal = axis;
    var radiance = vec4<f32>(e.radiance.xyz * e.pattern.w, e.radiance.w);
    var along = vec2<f32>(0.0);
    let disc = sqrt(u0);
    let around = unit_circle(u1);
    switch kind {
        case EMITTER_TRIANGLE: {
            let s = sqrt(1.0 - u0);
            along = vec2<f32>(s * (1.0 - u1), s * u1);
            position += e.e1.xyz * along.x + e.e2.xyz * along.y;
            normal = flipped;
        }
        case EMITTER_QUAD: {
            along = vec2<f32>(u0, u1);
            position += e.e1.xyz * along.x + e.e2.xyz * along.y;
            normal = flipped;
        }
        case EMITTER_SPHERE: {
            let n = uniform_sphere(u0, u1);
            position += n * e.e1.x;
            normal = select(n, -n, (flags & 2u) != 0u);
        }
        case EMITTER_ENVIRONMENT: {
            let towards = environment_direction(e.e1.x + e.e1.y * u1, e.e1.z + e.e2.x * u0);
            position += towards * e.e2.y;
            normal = -towards;
            radiance = environment_radiance(towards);
        }
        case EMITTER_POINT: {
            normal = vec3<f32>(0.0, 0.0, 1.0);
        }
        case EMITTER_DIRECTIONAL: {
            position += e.e1.xyz * (disc * around.x) + e.e2.xyz * (disc * around.y);
        }
        default: {
        }
    }
    let leaves_surface = kind <= EMITTER_SPHERE || kind == EMITTER_VIRTUAL;
    let origin = select(position, offset_origin(position, normal, frame.eye.w), leaves_surface);
    var carried = e.flux.xyz;
    let disc_area = PI * e.e2.y * e.e2.y;
    carried = select(carried, radiance.xyz * (e.e1.w * disc_area / e.normal.w), kind == EMITTER_ENVIRONMENT);
    if bitcast<u32>(e.pattern.z) != 0u {
        carried *= pattern_at(e, along);
        let sides = select(1.0, 2.0, (flags & 1u) != 0u);
        radiance = vec4<f32>(carried * (e.normal.w / (PI * e.e1.w * sides)), radiance.w);
    }
    return Start(index, kind, position, origin, normal, radiance, carried, e.flux.w);
}

// Point at which the ray of a particle begins, given the numbers of its direction.
fn ray_origin_from(start: Start, leave: vec2<f32>) -> vec3<f32> {
    let across = basis(start.normal);
    let on_disc = unit_circle(leave.y) * (emitters[start.emitter].e2.y * sqrt(leave.x));
    let moved = start.origin + across[0] * on_disc.x + across[1] * on_disc.y;
    return select(start.origin, moved, start.kind == EMITTER_ENVIRONMENT);
}

// Direction, distributed as radiance times cosine.
fn direction_from(start: Start, leave: vec2<f32>) -> vec3<f32> {
    let normal = start.normal;
    let tangents = basis(normal);
    var direction = normal;
    switch start.kind {
        case EMITTER_POINT: {
            direction = uniform_sphere(leave.x, leave.y);
        }
        case EMITTER_SPOT: {
            // Inversion of the falloff's integral over the cosine: the full cone, then the squared ramp.
            let cosines = emitters[start.emitter].e1;
            let inner = cosines.x;
            let outer = cosines.y;
            let full = 1.0 - inner;
            let ramp = (inner - outer) * (1.0 / 3.0);
            let x = leave.x * (full + ramp);
            let s3 = clamp(1.0 - (x - full) / max(ramp, 1e-20), 0.0, 1.0);
            let c = select(outer + pow(s3, 1.0 / 3.0) * (inner - outer), 1.0 - x, x < full);
            let s = sqrt(max(1.0 - c * c, 0.0));
            let p = unit_circle(leave.y);
            direction = s * (p.x * tangents[0] + p.y * tangents[1]) + c * normal;
        }
        case EMITTER_DIRECTIONAL, EMITTER_ENVIRONMENT: {
        }
        default: {
            var s = sqrt(leave.x);
            var c = sqrt(1.0 - leave.x);
            let p = unit_circle(leave.y);
            if start.exponent != 1.0 {
                c = pow(1.0 - leave.x, 1.0 / (start.exponent + 1.0));
                s = sqrt(max(1.0 - c * c, 0.0));
            }
            direction = s * (p.x * tangents[0] + p.y * tangents[1]) + c * normal;
        }
    }
    return direction;
}
