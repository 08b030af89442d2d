// Widths of the footprints of photons, by the flux of the photons around each. See pass/photon_width.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "photons.wgsl"
#include "photon_look_up.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> steps: array<Step>;
@group(0) @binding(3) var<storage, read> sorted_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> sorted_normal: array<vec4<f32>>;       // w: bits of the class in the grid
@group(0) @binding(5) var<storage, read_write> sorted_wi: array<vec4<f32>>;    // w: the sum, then r^2 over the squared radius
@group(0) @binding(6) var<storage, read> sorted_flux: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> buckets: array<u32>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let own = (group.x + group.y * groups.x) * 64u + lane;
    let step = steps[push.step];
    let stored = atomicLoad(&work.live);
    if max(own, step.first) >= stored {
        return;
    }
    let position = sorted_position[own].xyz;
    let normal = sorted_normal[own].xyz;
    let radius2 = frame.photon.x * frame.photon.x;
    let cells = look_up(position, bitcast<u32>(sorted_normal[own].w), step.first, step.end);
    var sum = 0.0;
    // One loop for all cells: most cells are empty, and a SIMD driver runs every loop at least once.
    for (var j = 0u; j < cells.total; j += 1u) {
        let found = looked_up(cells, j);
        let photon = sorted_position[found.y];
        let off = photon.xyz - position;
        let near = bitcast<u32>(photon.w) == found.x && dot(off, off) < radius2;
        let faces = dot(sorted_normal[found.y].xyz, normal) > MIN_COSINE;
        sum += select(0.0, mean3(sorted_flux[found.y].xyz), near && faces);
    }
    sum += sorted_wi[own].w;
    let many = frame.lens.w;
    let narrowed = select(1.0, max(sum / max(many * mean3(sorted_flux[own].xyz), 1e-37), 1.0), many > 0.0);
    sorted_wi[own].w = select(sum, narrowed, step.end >= stored);
}
