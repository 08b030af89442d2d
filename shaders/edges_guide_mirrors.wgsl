// Keeps what eye rays meet after one reflection in a flat mirror. See pass/edges.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "camera.wgsl"
#include "edges.wgsl"

@group(0) @binding(9) var<storage, read> first_hits: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> second_hits: array<vec2<u32>>;  // triangle (all ones: none, NO_MIRROR: no reflection), bits of t

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let triangle = first_hits[pixel].x;
    var second = vec2<u32>(NO_MIRROR, 0u);
    // Zero times for most pixels.
    for (var i = select(0u, 1u, is_plain_mirror(triangle)); i > 0u; i -= 1u) {
        let ray = eye_ray(place_of_pixel(pixel), frame.pixel_offset.xy);
        // The path may have gone on: then its last ray is another one.
        let off = ray_direction[pixel].xyz - mirrored_direction(ray.d, first_hit(triangle, 0.0, ray).normal);
        let hit = hits[pixel];
        second = select(second, vec2<u32>(bitcast<u32>(hit.w), bitcast<u32>(hit.x)), dot(off, off) < 1e-8);
    }
    second_hits[pixel] = second;
}
