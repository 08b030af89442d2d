// Starts particles on the emitters and leaves their first lights there. See pass/walk_start.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "emitter_start.wgsl"
#include "lights.wgsl"
#include "walk.wgsl"
#include "lobe_shares.wgsl"
#include "soft_emitters.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> ray_direction: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> flux: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> lights: array<PointLight>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let particle = (group.x + group.y * groups.x) * 64u + lane;
    if particle >= frame.walk.y * frame.pattern.z || !begins(particle) {
        return;
    }
    let side = random(key(frame.keys.x, STREAM_SIDE, particle, 0u));
    let place = start_at(first_light_numbers(particle), side);

    // Emitters without area are point lights already, and their particles leave a black light: the slot must not keep that of the last
    // pass.
    let depth = frame.depths[0];
    let share = select(0.0, bitcast<f32>(depth.z), place.kind <= EMITTER_SPHERE);
    let of_environment = place.kind == EMITTER_ENVIRONMENT;
    let e = emitters[place.emitter];
    let irradiance = place.radiance.xyz * (e.e1.w / e.normal.w * bitcast<f32>(depth.z));
    let exponent = select(1.0, place.exponent, place.kind <= EMITTER_SPHERE);
    let directed = select(0u, LIGHT_DIRECTED, exponent != 1.0);
    let soft = select(0u, LIGHT_SOFT, is_soft(place.emitter));
    let flags = select(LIGHT_SURFACE | LIGHT_CLIPPED | directed | soft, LIGHT_DIRECTIONAL | LIGHT_ENVIRONMENT, of_environment);
    let light = PointLight(
        vec4<f32>(place.origin, bitcast<f32>(flags)),
        vec4<f32>(place.normal, exponent - 1.0),
        vec4<f32>(select(place.flux * (share * INV_PI * cosine_sharpness(exponent)), irradiance, of_environment), 1.0),
        vec4<f32>(place.normal, select(lights_on_emitter(mean3(place.radiance.xyz)), lights_from_environment(place.radiance.w), of_environment)),
        vec4<f32>(0.0),
        vec4<f32>(0.0),
    );
    // Not every particle leaves a light here.
    if particle < depth.x * frame.pattern.z {
        lights[light_slot(particle, depth.y)] = light;
    }
    // The particle starts at another point: the N_0 points of lights and the N_1 of particles are each evenly spread.
    let start = start_at(walk_numbers(0u, particle), side);
    let leave = walk_numbers(1u, particle);
    let direction = direction_from(start, leave);
    let emitted = start.flux;
    let flies = particle < depth.w * frame.pattern.z;
    flux[particle] = vec4<f32>(select(vec3<f32>(0.0), emitted, flies), 0.0);
    ray_origin[particle] = vec4<f32>(ray_origin_from(start, leave), select(0.0, 3.0e38, flies));
    ray_direction[particle] = vec4<f32>(direction, 0.0);
}
