// Light along the rays at edges, from pixels nearby that show their surface. See pass/edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "camera.wgsl"
#include "edges.wgsl"
#include "edge_rays.wgsl"
#include "edge_rounds.wgsl"
#include "radiance.wgsl"
#include "environment.wgsl"

@group(0) @binding(9) var<storage, read> first_hits: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read> ray_pixel: array<u32>;
@group(0) @binding(19) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(20) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(21) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(22) var<storage, read_write> ray_light: array<vec4<f32>>;   // L; w: 0 nothing known, 1 a miss, 2 a hit
@group(0) @binding(23) var<storage, read> list: array<u32>;
@group(0) @binding(26) var<storage, read> edges: array<u32>;   // words, see edge_rounds.wgsl
var<immediate> push: Push;  // number of the round
#if MIRRORS
@group(0) @binding(24) var<storage, read> second_hits: array<vec2<u32>>;
@group(0) @binding(25) var<storage, read> mirror_hits: array<vec2<u32>>;
#endif

// Relative difference of squared distances up to which pixels count as equally near. Host twin: pass::edges::TIE.
const TIE: f32 = 1e-4;

// Origin less the eye of a ray of a pixel. That of a ray which a mirror has reflected is no longer known, but for its place in the pixel.
fn start_of(ray: u32, at: vec2<u32>, pixel: u32) -> vec3<f32> {
    let tile = at / 8u;
    let part = part_of_tile(tile.x + tile.y * ((frame.size.x + 7u) / 8u));
    let place = place_of_pixel(ray) - part.xy;
    let word = edges[pixel];
    let offset = offset_in_round(push.step, place.x + place.y * part.z - place_of_first(word), word);
    return eye_ray(at, offset).start;
}

// Place of pixel i of 3 x 3 around one; z: 1 inside the image, 0 beyond it, where the place is the nearest one inside.
fn near_pixel(at: vec2<i32>, i: u32) -> vec3<u32> {
    let p = at + vec2<i32>(i32(i % 3u) - 1, i32(i / 3u) - 1);
    let kept = clamp(p, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
    return vec3<u32>(vec2<u32>(kept), select(0u, 1u, all(p == kept)));
}

// Weight of the angle between normals beside the distance, where a pixel lends its irradiance. Host twin: pass::edges::TURNED.
const TURNED: f32 = 8.0;
const NO_LENDER: u32 = 0xffffffffu;

// Of 3 x 3 pixels that show a diffuse first hit, the one whose hit is the nearest in space to this one and faces as it does; NO_LENDER: none does.
fn lender_for(own: FirstHit, at: vec2<i32>) -> u32 {
    var lender = NO_LENDER;
    var least = 3.0e38;
    for (var i = 0u; i < 9u; i += 1u) {
        let near = near_pixel(at, i);
        let there = near.xy;
        let other = there.x + there.y * frame.size.x;
        let guide = first_hits[other];
        let theirs = first_hit(guide.x, bitcast<f32>(guide.y), eye_ray(there, frame.pixel_offset.xy));
        let between = theirs.position - own.position;
        let distance2 = dot(between, between) * (1.0 + TURNED * (1.0 - dot(theirs.normal, own.normal)));
        let is_last = theirs.found && point_position[other].w == bitcast<f32>(guide.y);
        let nearer = near.z == 1u && is_last && mean3(point_kd[other].xyz) > 0.0 && distance2 < least;
        lender = select(lender, other, nearer);
        least = select(least, distance2, nearer);
    }
    return lender;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= atomicLoad(&work.live) {
        return;
    }
    let ray = list[index];
    let last_d = ray_direction[ray].xyz;
    let hit = hits[ray];
    let triangle = bitcast<u32>(hit.w);
    let found = triangle != 0xffffffffu;
    let pixel = ray_pixel[ray];
    let at_pixel = place_of_pixel(pixel);
    let start = start_of(ray, at_pixel, pixel);
#if MIRRORS
    // A ray that a mirror has reflected: the eye ray is its image in the mirror.
    let mirror = mirror_hits[ray];
    let turned = mirror.x != NO_MIRROR;
    let met = vec2<u32>(triangle, bitcast<u32>(hit.x));
    let normal = first_hit(select(0xffffffffu, mirror.x, turned), 0.0, EyeRay(start, last_d)).normal;
    let d = select(last_d, mirrored_direction(last_d, normal), turned);
    let length = hit.x + select(0.0, bitcast<f32>(mirror.y), turned);
    let own = shown_by(select(met, mirror, turned), select(vec2<u32>(NO_MIRROR, 0u), met, turned), EyeRay(start, d));
    let own_first = own.first;
#else
    let turned = false;
    let d = last_d;
    let length = hit.x;
    let own = first_hit(triangle, hit.x, EyeRay(start, d));
    let own_first = own;
#endif
    // Textures are averaged over the pixel, as for the pixel's own ray.
    let s = surface_at(select(0u, triangle, found), hit.y, hit.z, last_d, frame.cones.x * depth_scale(dot(d, frame.forward.xyz) * length));
    let at = vec2<i32>(at_pixel);

    // The nearest pixel of 3 x 3 that shows the surface.
    var nearest = pixel;
    var least = 3.0e38;
    for (var i = 0u; i < 9u; i += 1u) {
        let near = near_pixel(at, i);
        let there = near.xy;
        let other = there.x + there.y * frame.size.x;
        let guide = first_hits[other];
        let their_ray = eye_ray(there, frame.pixel_offset.xy);
#if MIRRORS
        let shows = same_shown(own, shown_by(guide, second_hits[other], their_ray));
#else
        let shows = same_surface(own, first_hit(guide.x, bitcast<f32>(guide.y), their_ray));
#endif
        // Rays from one eye differ in direction, parallel ones in where they start.
        let between = (d - their_ray.d) + (start - their_ray.start);
        // Parallel rays may pass halfway between pixels: the first of these counts, whatever rounding makes of it.
        let behind = select(0.0, TIE * f32(i), is_orthographic());
        let distance2 = dot(between, between) * (1.0 + behind);
        let nearer = near.z == 1u && shows && distance2 < least;
        nearest = select(nearest, other, nearer);
        least = select(least, distance2, nearer);
    }
    let known = least < 3.0e38;
    let light = lighting_of(nearest);
    let kd = point_kd[nearest].xyz;
    let through = throughput[nearest].xyz;
    let shown = emitted[nearest].xyz + through * reflected_radiance(kd, light);
    // Its own albedo, where that of the pixel is known.
    var their_hit = first_hits[nearest].y;
#if MIRRORS
    their_hit = select(their_hit, second_hits[nearest].y, turned);
#endif
    let is_last = point_position[nearest].w == bitcast<f32>(their_hit);
    let irradiance = light.e_direct + light.e_indirect;
    let own_albedo = select(vec3<f32>(0.0), through * diffuse_radiance(s.reflectance.kd - kd, irradiance), is_last && found);
    // An emitter that no pixel shows is bright by itself; in a mirror it is left out.
    let emits = found && !turned && mean3(s.emission) > 0.0;
    // So is the environment.
    let leaves = !found && !turned && has_environment();
    var alone = select(vec3<f32>(0.0), s.emission, emits);
    for (var i = select(0u, 1u, leaves); i > 0u; i -= 1u) {
        alone = environment_seen(d);
    }
    // A diffuse surface that no pixel shows takes the irradiance of one. Zero times for most rays.
    let borrows = found && !known && !turned && !emits && s.kind == SURFACE_OPAQUE && mean3(s.reflectance.kd) > 0.0;
    var lender = NO_LENDER;
    for (var i = select(0u, 1u, borrows); i > 0u; i -= 1u) {
        lender = lender_for(own_first, at);
        let lent = lighting_of(select(lender, pixel, lender == NO_LENDER));
        let borrowed = diffuse_radiance(s.reflectance.kd, lent.e_direct + lent.e_indirect);
        alone = select(borrowed, vec3<f32>(0.0), lender == NO_LENDER);
    }
    let l = select(alone, max(shown + own_albedo, vec3<f32>(0.0)), known);
    let counts = known || emits || leaves || lender != NO_LENDER;
    ray_light[ray] = vec4<f32>(l, select(0.0, select(1.0, 2.0, found || turned || leaves), counts));
}
