// Writes the mean of all passes, less the filter's bias, to the image that a host shows. See pass/resolve.rs.
// HALF: the image has 16 bits for each channel.
#include "gain_share.wgsl"

@group(0) @binding(0) var<storage, read> sum_a: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> rest_a: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sum_b: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> rest_b: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> counts: array<u32>;    // passes in sum_a and in sum_b
@group(0) @binding(6) var<storage, read> sum_gain: array<vec4<f32>>;    // radiance that the filter added; w: squares
@group(0) @binding(7) var<storage, read> rest_gain: array<vec4<f32>>;
#if HALF
@group(0) @binding(5) var image: texture_storage_2d<rgba16float, write>;
#else
@group(0) @binding(5) var image: texture_storage_2d<rgba32float, write>;
#endif

// Greatest finite number of 16 bits.
const MAX_HALF: f32 = 65504.0;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    let size = textureDimensions(image);
    if pixel >= size.x * size.y {
        return;
    }
    let sum = (sum_a[pixel] + rest_a[pixel]) + (sum_b[pixel] + rest_b[pixel]);
    let at = vec2<u32>(pixel % size.x, pixel / size.x);
    // Counted by the device, because passes with lost rays are not in the sums. Black before the first pass.
    let passes = f32(max(counts[0] + counts[1], 1u));
    let bias = biased_share(at, size, passes) * (sum_gain[pixel].xyz + rest_gain[pixel].xyz);
    let mean = (sum - vec4<f32>(bias, 0.0)) / passes;
#if HALF
    textureStore(image, at, min(mean, vec4<f32>(MAX_HALF)));
#else
    textureStore(image, at, mean);
#endif
}
