// Particles start at the emitters and leave their first lights there. See pass/walk_start.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "lights.wgsl"
#include "walk.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> flux: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> lights: array<PointLight>;

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

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let particle = (group.x + group.y * groups.x) * 64u + lane;
    if particle >= frame.walk.y * frame.pattern.z {
        return;
    }
    // Composition method: the number that chooses the emitter is stretched and used again for the point on it.
    let start = walk_numbers(0u, particle);
    let index = choose(start.x);
    let e = emitters[index];
    let lower = select(0.0, emitters[max(index, 1u) - 1u].radiance.w, index > 0u);
    let u0 = clamp((start.x - lower) / e.normal.w, 0.0, ONE_MINUS_EPSILON);
    let u1 = start.y;
    let kind = bitcast<u32>(e.p0.w);
    let flags = bitcast<u32>(e.e2.w);
    let axis = e.normal.xyz;
    let side = random(key(frame.keys.x, STREAM_SIDE, particle, 0u));
    let flipped = select(axis, -axis, (flags & 1u) != 0u && side < 0.5);

    var position = e.p0.xyz;
    var normal = axis;
    let disc = sqrt(u0);
    let around = unit_circle(u1);
    switch kind {
        case EMITTER_TRIANGLE: {
            let s = sqrt(1.0 - u0);
            position += e.e1.xyz * (s * (1.0 - u1)) + e.e2.xyz * (s * u1);
            normal = flipped;
        }
        case EMITTER_QUAD: {
            position += e.e1.xyz * u0 + e.e2.xyz * u1;
            normal = flipped;
        }
        case EMITTER_SPHERE: {
            let n = uniform_sphere(u0, u1);
            position += n * e.e1.x;
            normal = select(n, -n, (flags & 2u) != 0u);
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

    // Direction, distributed as radiance times cosine.
    let leave = walk_numbers(1u, particle);
    let tangents = basis(normal);
    var direction = normal;
    switch kind {
        case EMITTER_POINT: {
            direction = uniform_sphere(leave.x, leave.y);
        }
        case EMITTER_SPOT: {
            // Inversion of the falloff's integral over the cosine: the full cone, then the squared ramp.
            let inner = e.e1.x;
            let outer = e.e1.y;
            let full = 1.0 - inner;
            let ramp = (inner - outer) * (1.0 / 3.0);
            let x = leave.x * (full + ramp);
            let s3 = clamp(1.0 - (x - full) / max(ramp, 1e-20), 0.0, 1.0);
            let c = select(outer + pow(s3, 1.0 / 3.0) * (inner - outer), 1.0 - x, x < full);
            let s = sqrt(max(1.0 - c * c, 0.0));
            let p = unit_circle(leave.y);
            direction = s * (p.x * tangents[0] + p.y * tangents[1]) + c * normal;
        }
        case EMITTER_DIRECTIONAL: {
        }
        default: {
            let s = sqrt(leave.x);
            let p = unit_circle(leave.y);
            direction = s * (p.x * tangents[0] + p.y * tangents[1]) + sqrt(1.0 - leave.x) * normal;
        }
    }

    // Lights without area are lit once by themselves; here only surfaces leave a light.
    let surface = kind <= EMITTER_SPHERE;
    let origin = select(position, offset_origin(position, normal, frame.eye.w), surface || kind == EMITTER_VIRTUAL);
    let depth = frame.depths[0];
    let share = select(0.0, bitcast<f32>(depth.z), surface);
    let light = PointLight(
        vec4<f32>(origin, bitcast<f32>(LIGHT_SURFACE | LIGHT_CLIPPED)),
        vec4<f32>(normal, 0.0),
        vec4<f32>(e.flux.xyz * (share * INV_PI), 1.0),
        vec4<f32>(normal, 1.0),
        vec4<f32>(0.0),
        vec4<f32>(0.0),
    );
    // Not every particle leaves a light here.
    if particle < depth.x * frame.pattern.z {
        lights[light_slot(particle, depth.y)] = light;
    }
    let flies = particle < depth.w * frame.pattern.z;
    flux[particle] = vec4<f32>(select(vec3<f32>(0.0), e.flux.xyz, flies), 0.0);
    ray_origin[particle] = vec4<f32>(origin, select(0.0, 3.0e38, flies));
    ray_direction[particle] = vec4<f32>(direction, 0.0);
}
