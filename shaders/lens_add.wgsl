// Adds the difference that the lens makes to the emission of the pixels. See pass/lens.rs.
#include "frame.wgsl"

@group(0) @binding(1) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> spread: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> emitted: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    emitted[pixel] += vec4<f32>(spread[pixel].xyz - source[pixel].xyz, 0.0);
}
