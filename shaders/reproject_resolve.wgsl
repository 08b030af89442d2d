// Writes the colour and depth of the chosen points, and counts pixels. See pass/reproject.rs.
#include "frame.wgsl"
#include "reproject.wgsl"

@group(0) @binding(1) var<storage, read> depth_points: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> region: array<u32>;
@group(0) @binding(3) var<storage, read> nearest: array<u32>;
@group(0) @binding(4) var<storage, read> chosen: array<u32>;
@group(0) @binding(5) var<storage, read_write> reprojected: array<vec4<f32>>; // radiance, depth; 0: a ray is traced
@group(0) @binding(6) var<storage, read_write> reproject_counts: array<atomic<u32>>; // tiles, pixels that show reflectors, holes, points without a colour

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let found = chosen[pixel] != NO_IMAGE;
    let point = depth_points[select(0u, chosen[pixel], found)];
    let holds = found && point.w > 0.0;
    reprojected[pixel] = select(vec4<f32>(0.0), vec4<f32>(point.xyz, bitcast<f32>(nearest[pixel])), holds);
    if region[pixel] > 0u {
        atomicAdd(&reproject_counts[1], 1u);
        if !found {
            atomicAdd(&reproject_counts[2], 1u);
        }
        if found && !holds {
            atomicAdd(&reproject_counts[3], 1u);
        }
    }
}
