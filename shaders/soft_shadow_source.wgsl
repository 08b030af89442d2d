// Writes the hard shadow of an emitter's centre, the source of the convolution. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "emitters.wgsl"
#include "soft_shadows.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> steps: array<Step>;
@group(0) @binding(3) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> visible: array<u32>;
@group(0) @binding(7) var<storage, read_write> source: array<vec4<f32>>;    // point; w: its word, neither lit nor blocked where the centre is below the horizon
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let light = soft_light(steps[push.step].first);
    let x = point_position[pixel].xyz;
    let n = point_geometric[pixel].xyz;
    let d = light.centre - x;
    let faces = dot(d, n) > 0.0 && dot(d, light.normal) < 0.0;
    let counts = faces && has_flag(point_wo[pixel].w, SOFT);
    let state = select(0u, select(PIXEL_BLOCKED, PIXEL_LIT, visible[pixel] != 0u), counts);
    source[pixel] = vec4<f32>(x, bitcast<f32>(PIXEL_WORD | state | select(0u, normal_code(n), counts)));
}
