// words[i] = components 2j and 2j + 1 of a point, for wanted[i] = (j, index).
#include "linear_index.wgsl"
#include "../../../../shaders/include/sobol.wgsl"

@group(0) @binding(0) var<storage, read> wanted: array<vec2<u32>>;
@group(0) @binding(1) var<storage, read_write> words: array<vec2<u32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = linear_group(group, groups) * 64u + lane;
    if i >= arrayLength(&wanted) { return; }
    words[i] = sobol(wanted[i].x, wanted[i].y);
}
