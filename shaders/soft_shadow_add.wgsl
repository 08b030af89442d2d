// Adds the light with soft shadows to the light of its pixels. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "flags.wgsl"

@group(0) @binding(1) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> soft_direct: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> direct: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z || !has_flag(point_wo[pixel].w, SOFT) {
        return;
    }
    direct[pixel] += vec4<f32>(soft_direct[pixel].xyz, 0.0);
}
