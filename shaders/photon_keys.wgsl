// Writes the keys by which photons are sorted: their buckets of the hash table. See pass/photon_grid.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "photons.wgsl"

@group(0) @binding(1) var<storage, read> photon_position: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> codes: array<u32>;
@group(0) @binding(3) var<storage, read_write> keys: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> work: DispatchCounts;

// Photons that are not stored go to the end; buckets have 22 bits at most.
const DEAD_KEY: u32 = 0xffffffu;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let photon = (group.x + group.y * groups.x) * 64u + lane;
    if photon >= photon_count() {
        return;
    }
    let position = photon_position[photon];
    let stored = position.w > 0.0;
    let code = code_of(vec3<i32>(floor(in_cells(position.xyz))), grid_class(photon_class(photon)));
    codes[photon] = code;
    keys[photon] = vec2<u32>(select(DEAD_KEY, bucket_of(code), stored), photon);
    if stored {
        atomicAdd(&work.live, 1u);
    }
}
