// Sums of the kernels over the grid, for diameters up to 16 texels and for directions of a quarter turn, after which they
// repeat. See pass/convolve.rs.
#include "convolve.wgsl"
#include "convolve_kernel.wgsl"

@group(0) @binding(2) var<storage, read_write> norms: array<f32>;
@group(0) @binding(3) var<storage, read> narrowings: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    if i >= steps[push.step].layers * NORM_WIDTHS * NORM_ANGLES {
        return;
    }
    let layer = i / (NORM_WIDTHS * NORM_ANGLES);
    let diameter = f32(i / NORM_ANGLES % NORM_WIDTHS) / NORM_STEPS;
    let angle = f32(i % NORM_ANGLES) / f32(NORM_ANGLES) * 1.5707964;
    let axis = vec2<f32>(cos(angle), sin(angle)) * (2.0 / max(diameter, 1e-3));
    let reach = i32(0.5 * SUPPORT * diameter);
    let ratio = narrowed(narrowings[layer]);
    var sum = 0.0;
    for (var y = -reach; y <= reach; y += 1) {
        for (var x = -reach; x <= reach; x += 1) {
            sum += kernel_at(axis, ratio, layer, vec2<f32>(vec2<i32>(x, y)));
        }
    }
    norms[i] = sum;
}
