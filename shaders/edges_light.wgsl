// Light along the rays at edges, from pixels nearby that show their surface. See pass/edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "camera.wgsl"
#include "edges.wgsl"
#include "radiance.wgsl"

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

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    if index >= atomicLoad(&work.live) {
        return;
    }
    let ray = list[index];
    let d = ray_direction[ray].xyz;
    let hit = hits[ray];
    let triangle = bitcast<u32>(hit.w);
    let own = first_hit(triangle, hit.x, d);
    let s = surface_at(select(0u, triangle, own.found), hit.y, hit.z, d);
    let pixel = ray_pixel[ray];
    let at = vec2<i32>(place_of_pixel(pixel));

    // The nearest pixel of 3 x 3 that shows the surface.
    var nearest = pixel;
    var least = 3.0e38;
    for (var i = 0u; i < 9u; i += 1u) {
        let p = at + vec2<i32>(i32(i % 3u) - 1, i32(i / 3u) - 1);
        let inside = all(p >= vec2<i32>(0)) && all(p < vec2<i32>(frame.size.xy));
        let there = vec2<u32>(clamp(p, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1));
        let other = there.x + there.y * frame.size.x;
        let guide = first_hits[other];
        let their_d = eye_direction(there, frame.pixel_offset.xy);
        let shows = same_surface(own, first_hit(guide.x, bitcast<f32>(guide.y), their_d));
        let between = d - their_d;
        let distance2 = dot(between, between);
        let nearer = inside && shows && distance2 < least;
        nearest = select(nearest, other, nearer);
        least = select(least, distance2, nearer);
    }
    let known = least < 3.0e38;
    let light = lighting_of(nearest);
    let kd = point_kd[nearest].xyz;
    let through = throughput[nearest].xyz;
    let shown = emitted[nearest].xyz + through * reflected_radiance(kd, light);
    // Its own albedo, where that of the pixel is known.
    let is_first = point_position[nearest].w == bitcast<f32>(first_hits[nearest].y);
    let irradiance = light.e_direct + light.e_indirect;
    let own_albedo = select(vec3<f32>(0.0), through * diffuse_radiance(s.reflectance.kd - kd, irradiance), is_first && own.found);
    // An emitter that no pixel shows is bright by itself.
    let emits = own.found && mean3(s.emission) > 0.0;
    let l = select(select(vec3<f32>(0.0), s.emission, emits), max(shown + own_albedo, vec3<f32>(0.0)), known);
    ray_light[ray] = vec4<f32>(l, select(0.0, select(1.0, 2.0, own.found), known || emits));
}
