// The four texels around each cell, scaled to a maximum of 1. See pass/convolve.rs.
#include "convolve.wgsl"

@group(0) @binding(2) var<storage, read> kernels: array<f32>;
@group(0) @binding(3) var<storage, read> moments: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> quads: array<vec4<f32>>;

fn texel(layer: u32, x: i32, y: i32) -> f32 {
    let last = i32(TEXELS) - 1;
    let at = (vec2<f32>(vec2<i32>(x, y)) + 0.5) * (2.0 / f32(TEXELS)) - 1.0;
    let found = kernels[layer * TEXELS * TEXELS + u32(clamp(y, 0, last)) * TEXELS + u32(clamp(x, 0, last))];
    let inside = dot(at, at) <= 1.0 && min(x, y) >= 0 && max(x, y) <= last;
    return max(select(0.0, found, inside), 0.0);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    let layers = steps[push.step].layers;
    // An additional layer is 1 everywhere; sources that do not spread use it.
    if i >= (layers + 1u) * CELLS_OF_LAYER {
        return;
    }
    let layer = min(i / CELLS_OF_LAYER, layers - 1u);
    let x = i32(i % CELLS);
    let y = i32(i % CELLS_OF_LAYER / CELLS);
    let found = vec4<f32>(texel(layer, x - 1, y - 1), texel(layer, x, y - 1), texel(layer, x - 1, y), texel(layer, x, y));
    quads[i] = select(found * moments[2u * layer].w, vec4<f32>(1.0), i >= layers * CELLS_OF_LAYER);
}
