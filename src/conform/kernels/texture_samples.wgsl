// values[i] = texture lookup at wanted[i] = (u, v, footprint, bits of the texture's index); a footprint below 0 reads the finest level.
#include "linear_index.wgsl"
#include "../../../../shaders/include/texture.wgsl"

@group(0) @binding(0) var<storage, read> wanted: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> values: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = linear_group(group, groups) * 64u + lane;
    if i >= arrayLength(&wanted) { return; }
    let at = wanted[i];
    let index = bitcast<u32>(at.w);
    if at.z < 0.0 {
        values[i] = sample_finest(index, at.xy);
    } else {
        values[i] = sample_texture(index, at.xy, at.z);
    }
}
