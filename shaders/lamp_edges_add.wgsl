// Takes the emission that pixels at edges of lamps show towards the mean of their rays. See pass/lamp_edges.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "edge_rays.wgsl"
#include "lamp_edges.wgsl"

@group(0) @binding(1) var<storage, read> marks: array<u32>;
@group(0) @binding(2) var<storage, read> lamp_light: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> emitted: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> steps: array<Step>;
#if GAIN
@group(0) @binding(5) var<storage, read_write> path_gain: array<vec4<f32>>;
#endif
@group(0) @binding(9) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(10) var<storage, read> tiles: array<u32>;
var<immediate> push: Push;

// Host twin: pass::edges::FULL_PASSES.
const FULL_PASSES: f32 = 4.0;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let word = marks[pixel];
    if word < 4u {
        return;
    }
    let at = place_of_pixel(pixel);
    let part = part_of_tile(at.x / 8u + at.y / 8u * ((frame.size.x + 7u) / 8u));
    let each = word / 4u & 15u;
    let bits = word & 3u;
    let weight = min(1.0, FULL_PASSES * frame.shift.w);
    var all = vec3<f32>(0.0);
    for (var j = 0u; j < sought_slots(bits, steps[push.step].components); j += 1u) {
        let first = word / 64u + j * each;
        let own = lamp_light[lamp_ray(part, first)];
        var sum = own.xyz;
        var count = 1.0;
        for (var k = 1u; k < each; k += 1u) {
            let l = lamp_light[lamp_ray(part, first + k)];
            sum += l.w * l.xyz;
            count += l.w;
        }
        // Third components have joined the second ones.
        let component = min(j + 1u - (bits & 1u), 1u);
        let change = weight * own.w * (sum / count - own.xyz);
        emitted[pixel + component * frame.size.z] += vec4<f32>(change, 0.0);
        all += change;
    }
#if GAIN
    path_gain[pixel] += vec4<f32>(all, 0.0);
#endif
}
