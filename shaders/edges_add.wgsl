// Takes the light of a pixel at an edge towards the mean of its rays. See pass/edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "edge_rays.wgsl"
#include "edge_rounds.wgsl"

@group(0) @binding(1) var<storage, read_write> edges: array<u32>;   // words, see edge_rounds.wgsl
@group(0) @binding(2) var<storage, read> ray_light: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> emitted: array<vec4<f32>>;   // w: coverage beyond that of the eye ray
@group(0) @binding(11) var<storage, read_write> edge_sums: array<vec4<f32>>;    // light of the rays before; w: covered
var<immediate> push: Push;  // number of the round
#if GAIN
@group(0) @binding(10) var<storage, read_write> path_gain: array<vec4<f32>>;
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let word = edges[pixel];
    if word == 0u {
        return;
    }
    var sum = vec4<f32>(0.0);
    var known = 0u;
    let at = place_of_pixel(pixel) / 8u;
    let part = part_of_tile(at.x + at.y * ((frame.size.x + 7u) / 8u));
    for (var k = 0u; k < rays_in_round(push.step, word); k += 1u) {
        let ray = ray_light[ray_of_tile(part, place_of_first(word) + k)];
        let counts = ray.w > 0.0;
        sum += vec4<f32>(select(vec3<f32>(0.0), ray.xyz, counts), select(0.0, 1.0, ray.w > 1.5));
        known += select(0u, 1u, counts);
    }
    if push.step > 0u {
        sum += edge_sums[pixel];
    }
    if push.step + 1u < ROUNDS {
        edge_sums[pixel] = sum;
        edges[pixel] = word + AT_EDGE * known;
        return;
    }
    let own = emitted[pixel].xyz + throughput[pixel].xyz * reflected_radiance(point_kd[pixel].xyz, lighting_of(pixel));
    let covered = select(0.0, 1.0, has_flag(point_wo[pixel].w, COVERED));
    let count = f32(known_of(word) + known);
    let mean = (sum + vec4<f32>(own, covered)) / count;
    let more = weight_in_pass() * (mean - vec4<f32>(own, covered));
    emitted[pixel] += more;
#if GAIN
    path_gain[pixel] += vec4<f32>(more.xyz, 0.0);
#endif
}
