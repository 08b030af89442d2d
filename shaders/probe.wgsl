// Copies the sums of a few pixels of an instance, for the host. See pass/probe.rs.
#include "frame.wgsl"
#include "gain_share.wgsl"

@group(0) @binding(1) var<storage, read> probed: array<u32>;
@group(0) @binding(2) var<storage, read> sum_color: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> rest_color: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> tail_color: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> sum_gain: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> rest_gain: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> counts: array<u32>;
@group(0) @binding(8) var<storage, read_write> probe: array<vec4<f32>>;  // three for each pixel

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    if i >= arrayLength(&probed) {
        return;
    }
    let pixel = probed[i];
    probe[3u * i] = sum_color[pixel];
    probe[3u * i + 1u] = rest_color[pixel] + tail_color[pixel];
    let gain = sum_gain[pixel] + rest_gain[pixel];
    let share = biased_share(place_of_pixel(pixel), frame.size.xy, f32(counts[0] + counts[1]));
    probe[3u * i + 2u] = vec4<f32>(gain.xyz, share);
}
