// Writes the hard shadow of an emitter's centre, the source of the convolution. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "soft_shadows.wgsl"
#include "soft_emitter.wgsl"

@group(0) @binding(1) var<storage, read> soft_emitter: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> visible: array<u32>;
@group(0) @binding(7) var source: texture_storage_2d<rgba32float, write>;    // point; w: its word, neither lit nor blocked where the centre is below the horizon

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let light = soft_light();
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let x = point_position[pixel].xyz;
    let n = point_geometric[pixel].xyz;
    let d = light.centre - x;
    let faces = dot(d, n) > 0.0 && dot(d, light.normal) < 0.0;
    let counts = faces && has_flag(point_wo[pixel].w, SOFT);
    let state = select(0u, select(PIXEL_BLOCKED, PIXEL_LIT, visible[pixel] != 0u), counts);
    let word = PIXEL_WORD | state | select(0u, normal_code(n), counts);
    textureStore(source, vec2<i32>(place_of_pixel(pixel)), vec4<f32>(x, bitcast<f32>(word)));
}
