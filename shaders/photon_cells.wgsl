// Writes the sorted photons, and the first and the end of each bucket. See pass/photon_grid.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "photons.wgsl"

@group(0) @binding(1) var<storage, read> keys: array<vec2<u32>>;            // sorted
@group(0) @binding(2) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(3) var<storage, read> codes: array<u32>;
@group(0) @binding(4) var<storage, read> photon_position: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> photon_normal: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> flux: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> sorted_position: array<vec4<f32>>;   // w: bits of the code
@group(0) @binding(9) var<storage, read_write> sorted_normal: array<vec4<f32>>;     // w: bits of the class in the grid
@group(0) @binding(10) var<storage, read_write> sorted_wi: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> sorted_flux: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> buckets: array<u32>;        // first, end of each; cleared before

@group(0) @binding(13) var<storage, read_write> near: array<atomic<u32>>;  // bits of look-ups that visit a cell with photons; cleared before

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = (group.x + group.y * groups.x) * 64u + lane;
    let live = atomicLoad(&work.live);
    if i >= live {
        return;
    }
    let bucket = keys[i].x;
    let photon = keys[i].y;
    sorted_position[i] = vec4<f32>(photon_position[photon].xyz, bitcast<f32>(codes[photon]));
    sorted_normal[i] = vec4<f32>(photon_normal[photon].xyz, bitcast<f32>(grid_class(photon_class(photon))));
    sorted_wi[i] = vec4<f32>(-ray_direction[photon].xyz, 0.0);
    sorted_flux[i] = vec4<f32>(flux[photon].xyz, ray_direction[photon].w);
    if i == 0u || keys[max(i, 1u) - 1u].x != bucket {
        buckets[2u * bucket] = i;
    }
    if i + 1u == live || keys[min(i + 1u, live - 1u)].x != bucket {
        buckets[2u * bucket + 1u] = i + 1u;
    }
    // Look-ups that visit the photon's cell begin in that cell or in the one before it along each axis.
    let cell = vec3<i32>(floor(in_cells(photon_position[photon].xyz)));
    for (var corner = 0u; corner < 8u; corner += 1u) {
        let first = cell - vec3<i32>(vec3<u32>(corner & 1u, (corner >> 1u) & 1u, corner >> 2u));
        let bit = near_bit(first, grid_class(photon_class(photon)));
        atomicOr(&near[bit >> 5u], 1u << (bit & 31u));
    }
}
