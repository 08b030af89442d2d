// Lists the shading points that may have photons around them. See pass/photon_find.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "photons.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> near: array<u32>;
@group(0) @binding(5) var<storage, read_write> found: array<u32>;
@group(0) @binding(6) var<storage, read_write> found_work: DispatchCounts;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = (group.x + group.y * groups.x) * 64u + lane;
    // A sorted list, or one in the order of the screen, may have places without a shading point.
    if place >= max(atomicLoad(&work.live), work.total) {
        return;
    }
    let slot = list[place];
    if slot == NO_POINT {
        return;
    }
    let bit = near_bit(first_cell(point_position[slot].xyz), grid_class(class_of(slot)));
    if ((near[bit >> 5u] >> (bit & 31u)) & 1u) != 0u {
        found[atomicAdd(&found_work.live, 1u)] = slot;
    }
}
