// Writes the pass's image and its depths, where something that moves reaches. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "segments.wgsl"
#include "motion_tiles.wgsl"

@group(0) @binding(1) var<storage, read> motion_windows: array<MotionWindow>;
@group(0) @binding(2) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> velocity: array<vec4<f32>>;
@group(0) @binding(10) var source: texture_storage_2d<rgba32float, write>;     // radiance; w: depth
@group(0) @binding(11) var sweep: texture_storage_2d<rgba32float, write>;      // packed_segment

// A workgroup for each tile.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = group.x + group.y * groups.x;
    let tiles = (frame.size.xy + 7u) / 8u;
    let count = tiles.x * tiles.y;
    // Read where all lanes run (see gpu/wgsl_parameters.rs).
    let along = motion_windows[min(tile, count - 1u)].along;
    if tile >= count || along < 0.0 {
        return;
    }
    let at = pixel_of_tile(tile, lane);
    if any(at >= frame.size.xy) {
        return;
    }
    let pixel = at.y * frame.size.x + at.x;
    let l = emitted[pixel].xyz + throughput[pixel].xyz * reflected_radiance(point_kd[pixel].xyz, lighting_of(pixel));
    let v = velocity[pixel];
    textureStore(source, vec2<i32>(at), vec4<f32>(l, v.z));
    textureStore(sweep, vec2<i32>(at), packed_segment(v.xy, v.z));
}
