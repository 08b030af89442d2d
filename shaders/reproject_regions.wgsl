// Writes the planar reflector that each pixel shows, and clears what is projected there. See pass/reproject.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "surface.wgsl"
#include "reproject.wgsl"

@group(0) @binding(9) var<storage, read> hits: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> region: array<u32>;
@group(0) @binding(11) var<storage, read_write> nearest: array<u32>;
@group(0) @binding(12) var<storage, read_write> chosen: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let triangle = bitcast<u32>(hits[pixel].w);
    let found = triangle != 0xffffffffu;
    let normals = triangle_normals[select(0u, triangle, found)];
    // Rays show what curved surfaces mirror.
    region[pixel] = select(0u, glossy_plane(normals), found && !is_curved(normals));
    nearest[pixel] = NO_IMAGE;
    chosen[pixel] = NO_IMAGE;
}
