// Shoots photons from emitters and virtual lights at mirrors and glass. See pass/photon_start.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "emitters.wgsl"
#include "emitter_start.wgsl"
#include "lights.wgsl"
#include "light_at.wgsl"
#include "sobol.wgsl"
#include "photons.wgsl"
#include "targets.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
// See targets.wgsl.
@group(0) @binding(2) var<storage, read> targets: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> ray_origin: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> ray_direction: array<vec4<f32>>;  // w: bounces of the light that it left, or WITHOUT_AREA
@group(0) @binding(5) var<storage, read_write> flux: array<vec4<f32>>;     // w: bits of what it is aimed at
@group(0) @binding(6) var<storage, read_write> photon_position: array<vec4<f32>>;  // w: 1 if stored, else 0
@group(0) @binding(7) var<storage, read> lights: array<PointLight>;
// Sums of the weights of the lights of a class up to each one, see photon_lights.wgsl.
@group(0) @binding(9) var<storage, read> light_sums: array<f32>;
// Three for each triangle of the sparse targets: first vertex and area up to it; edge and bits of its number; edge.
@group(0) @binding(8) var<storage, read> target_triangles: array<vec4<f32>>;

// A point counts as inside a sphere if the squared sine of the sphere's half angle is at least this.
const INSIDE: f32 = 0.999;
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let photon = (group.x + group.y * groups.x) * 64u + lane;
    if photon >= photon_count() {
        return;
    }
    let index = frame.photons.y + photon_class(photon) * frame.photons.x + photon / frame.pattern.z;
    var u: array<f32, 5>;
    let bases = array<u32, 5>(2u, 3u, 5u, 7u, 11u);
    let by_sobol = (frame.keys.z & 2u) != 0u;
    for (var d = 0u; d < 5u; d += 1u) {
        let word = key(frame.keys.y, STREAM_PHOTON, d, 0u);
        let halton = rotate(radical_inverse(bases[d], index), random(word));
        let pair = unit(sobol(d / 2u, select(0u, index, by_sobol)) ^ vec2<u32>(hash(word)));
        u[d] = select(halton, select(pair.x, pair.y, (d & 1u) == 1u), by_sobol);
    }
    let side = random(key(frame.keys.x, STREAM_PHOTON_SIDE, photon, 0u));
    var start = start_at(vec2<f32>(u[2], u[3]), side);

    // The last photons of a class start from its lights after reflections. Each part stands for all photons.
    let from_emitters = bitcast<u32>(frame.photon.w);
    let from_light = photon / frame.pattern.z >= from_emitters;
    let reflected = frame.pattern.w - frame.depths[1].y;
    let first_light = select(0u, photon_class(photon) * frame.pattern.w + frame.depths[1].y, from_light);
    var lower = first_light;
    var upper = first_light + select(1u, max(reflected, 1u), from_light) - 1u;
    let whole = select(0.0, light_sums[upper], from_light);
    for (var k = 0u; k < 32u && lower < upper; k += 1u) {
        let middle = (lower + upper) / 2u;
        let after = light_sums[middle] <= u[2] * whole;
        lower = select(lower, middle + 1u, after);
        upper = select(middle, upper, after);
    }
    let light = lights[select(0u, lower, from_light)];
    let below = select(0.0, light_sums[max(lower, 1u) - 1u], lower > first_light);
    let chance = (light_sums[lower] - below) / max(whole, 1e-37);
    let part = select(from_emitters, frame.photons.x - from_emitters, from_light);
    let times = f32(frame.photons.x) / f32(max(part, 1u)) * select(1.0, 1.0 / max(chance, 1e-37), from_light);
    if from_light {
        start.kind = EMITTER_VIRTUAL;
        start.exponent = 1.0;
        start.origin = light.position.xyz;
        start.normal = light.normal.xyz;
    }

    // Chooses a target with probability proportional to its weight.
    let count = frame.photons.z;
    var sum = 0.0;
    var last = count;
    for (var t = 0u; t < count; t += 1u) {
        let w = weight_of(t, start.kind, start.origin, start.normal);
        sum += w;
        last = select(last, t, w > 0.0);
    }
    let aims = last < count;
    var rest = u[4] * sum;
    var chosen = select(0u, last, aims);
    for (var t = 0u; t < select(0u, last, aims); t += 1u) {
        let w = weight_of(t, start.kind, start.origin, start.normal);
        if rest < w {
            chosen = t;
            break;
        }
        rest -= w;
    }
    let sphere = targets[2u * chosen];
    let parts = targets[2u * chosen + 1u];
    let p = weight_of(chosen, start.kind, start.origin, start.normal) / max(sum, 1e-37);

    let e = emitters[start.emitter];
    let to = sphere.xyz - start.origin;
    let distance2 = max(dot(to, to), 1e-37);
    let sin2 = sphere.w * sphere.w / distance2;
    let inside = sin2 >= INSIDE;
    let parallel = is_parallel(start.kind);
    let of_environment = start.kind == EMITTER_ENVIRONMENT;
    // Irradiance across parallel light, and a way back that leads out of the scene.
    let irradiance = select(e.radiance.xyz, start.radiance.xyz * e.e1.w, of_environment);
    let back = 2.0 * select(length(e.e1.xyz), e.e2.y, of_environment);

    // 1 - cos of the cone around the sphere, without cancellation.
    let cap = sin2 / (1.0 + sqrt(max(1.0 - sin2, 0.0)));
    let h = u[0] * cap;
    let sine = sqrt(max(h * (2.0 - h), 0.0));
    let axis = select(to / sqrt(distance2), start.normal, parallel);
    let across = basis(axis);
    let circle = unit_circle(u[1]);
    let in_cone = across[0] * (sine * circle.x) + across[1] * (sine * circle.y) + axis * (1.0 - h);
    let free = direction_from(start, vec2<f32>(u[0], u[1]));
    let to_sphere = select(select(in_cone, free, inside), axis, parallel);

    // Parallel light starts on the sphere's disc, outside the scene.
    let disc = sphere.w * sqrt(u[0]);
    let before = sphere.xyz - axis * back;
    let on_disc = before + across[0] * (disc * circle.x) + across[1] * (disc * circle.y);
    let of_sphere = select(start.origin, on_disc, parallel);

    // A sparse target that is far enough: a point on its triangles, of which a search by halves finds one.
    let begin = first_triangle(parts);
    let end = bitcast<u32>(parts.w);
    let by_area = aims_by_area(sphere, parts, to, parallel);
    let at = u[0] * parts.y;
    var low = begin;
    var high = max(end, begin + 1u) - 1u;
    for (var k = 0u; k < 32u && by_area && low < high; k += 1u) {
        let middle = (low + high) / 2u;
        let after = target_triangles[3u * middle].w <= at;
        low = select(low, middle + 1u, after);
        high = select(middle, high, after);
    }
    let triangle = 3u * select(0u, low, by_area);
    let v0 = target_triangles[triangle];
    let e1 = target_triangles[triangle + 1u];
    let e2 = target_triangles[triangle + 2u].xyz;
    let sum_before = select(0.0, target_triangles[max(triangle, 3u) - 3u].w, low > begin);
    let root = sqrt(clamp((at - sum_before) / max(v0.w - sum_before, 1.17549435e-38), 0.0, 1.0));
    let place = v0.xyz + e1.xyz * (1.0 - root) + e2 * (u[1] * root);
    let to_place = place - start.origin;
    let place2 = max(dot(to_place, to_place), 1e-37);
    let direction = select(to_sphere, select(to_place / sqrt(place2), axis, parallel), by_area);
    let origin = select(of_sphere, select(start.origin, place - axis * back, parallel), by_area);
    let normal = cross(e1.xyz, e2);
    let facing = abs(dot(normal, direction)) / max(length(normal), 1e-37);
    // Solid angle, or one over the density of the direction.
    let spread = select(2.0 * PI * cap, facing * parts.y / place2, by_area);

    let cosine = dot(start.normal, direction);
    let ramp = clamp((cosine - e.e1.y) / max(e.e1.x - e.e1.y, 1e-6), 0.0, 1.0);
    let of_point = e.radiance.xyz * (select(1.0, ramp * ramp, start.kind == EMITTER_SPOT) / e.normal.w);
    let of_surface = start.flux * (INV_PI * cosine_sharpness(start.exponent) * cosine_power(max(cosine, 0.0), start.exponent));
    let is_point = start.kind == EMITTER_POINT || start.kind == EMITTER_SPOT;
    let into_cone = select(of_surface, of_point, is_point) * spread;
    let of_disc = irradiance * (select(PI * sphere.w * sphere.w, facing * parts.y, by_area) / e.normal.w);
    let freely = inside && !by_area;
    let of_emitter = select(select(into_cone, start.flux, freely), of_disc, parallel);
    let of_light = intensity_of(light, -direction) * select(spread, PI / max(cosine, 1e-6), freely);
    let carried = select(of_emitter, of_light, from_light) * (times / max(p, 1e-37));

    let flies = aims && mean3(carried) > 0.0;
    ray_origin[photon] = vec4<f32>(origin, select(0.0, 3.0e38, flies));
    let left = select(0.0, WITHOUT_AREA, is_point || start.kind == EMITTER_DIRECTIONAL);
    ray_direction[photon] = vec4<f32>(direction, select(left, light.f0.w, from_light));
    let aim = select(chosen + 1u, NO_TARGET + bitcast<u32>(e1.w), by_area);
    flux[photon] = vec4<f32>(select(vec3<f32>(0.0), carried, flies), bitcast<f32>(aim));
    photon_position[photon] = vec4<f32>(0.0);
}
