// Diameters of the kernels of each surface. See pass/splat_width.rs.
#include "math.wgsl"
#include "splats.wgsl"

@group(0) @binding(0) var<storage, read> surfaces: array<vec4<u32>>;        // bits of the area, first and end of its edges
@group(0) @binding(1) var<storage, read> surface_hits: array<u32>;
@group(0) @binding(2) var<storage, read_write> surface_width: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let surface = (group.x + group.y * groups.x) * 64u + lane;
    if surface >= arrayLength(&surfaces) {
        return;
    }
    let n = surface_hits[surface];
    let width = splat_parameters.width * sqrt(bitcast<f32>(surfaces[surface].x) / f32(max(n, 1u)));
    surface_width[surface] = select(0.0, width, n > 0u);
}
