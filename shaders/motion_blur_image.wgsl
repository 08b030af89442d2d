// Writes the pass's image and its depths, where something that moves reaches. See pass/motion_blur.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "segments.wgsl"
#include "motion_tiles.wgsl"

@group(0) @binding(1) var<storage, read> motion_reach: array<MotionReach>;
@group(0) @binding(2) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> velocity: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> source: array<vec4<f32>>;       // radiance; w: depth
@group(0) @binding(11) var<storage, read_write> sweep: array<vec4<f32>>;        // packed_segment
@group(0) @binding(12) var<storage, read_write> front: array<f32>;              // sources of less depth are in front; -1: none is
@group(0) @binding(13) var<storage, read_write> passing: array<vec4<u32>>;      // what passes in front: nothing yet
@group(0) @binding(14) var<storage, read_write> brightest: atomic<u32>;         // bits of the greatest component of the image

// A workgroup for each tile.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = group.x + group.y * groups.x;
    let tiles = (frame.size.xy + 7u) / 8u;
    let count = tiles.x * tiles.y;
    // Read where all lanes run (see gpu/wgsl_parameters.rs).
    let reach = motion_reach[min(tile, count - 1u)];
    let at = pixel_of_tile(tile, lane);
    if tile >= count || reach.reached == 0u || any(at >= frame.size.xy) {
        return;
    }
    let pixel = at.y * frame.size.x + at.x;
    let l = emitted[pixel].xyz + throughput[pixel].xyz * reflected_radiance(point_kd[pixel].xyz, lighting_of(pixel));
    let v = velocity[pixel];
    source[pixel] = vec4<f32>(l, v.z);
    sweep[pixel] = packed_segment(v.xy, v.z);
    front[pixel] = select(depth_in_front(v.z), -1.0, reach.even != 0u);
    passing[pixel] = vec4<u32>(0u);
    // Bits of numbers that are not negative are in the order of the numbers.
    let most = bitcast<u32>(max(max(l.x, l.y), max(l.z, 0.0)));
    // Runs once for the few pixels that are brighter than those before.
    for (var once = select(0u, 1u, most > atomicLoad(&brightest)); once > 0u; once -= 1u) {
        atomicMax(&brightest, most);
    }
}
