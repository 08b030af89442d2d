// Writes the pass's image as the source of the convolution, and the circle of confusion of each pixel. See pass/lens.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"

@group(0) @binding(2) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> source: array<vec4<f32>>;      // radiance; w: depth
@group(0) @binding(10) var<storage, read_write> footprint: array<vec4<f32>>;  // diameter, layer, u axis
@group(0) @binding(11) var<storage, read_write> region: array<u32>;           // 1: in focus or behind; 2: before

// Depth of pixels that see nothing, beyond every surface. Host twin: pass::lens::NOTHING_SEEN.
const NOTHING_SEEN: f32 = 3.0e38;
// Maximum diameter of circles, in pixels. Host twin: pass::lens::MAX_DIAMETER.
const MAX_DIAMETER: f32 = 1e6;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    if pixel >= frame.size.z {
        return;
    }
    let through = throughput[pixel];
    let l = emitted[pixel].xyz + through.xyz * reflected_radiance(point_kd[pixel].xyz, lighting_of(pixel));
    let found = has_flag(point_wo[pixel].w, HIT);
    let nearness = select(0.0, 1.0 / max(through.w, 1e-30), found);
    let diameter = min(frame.lens.x * abs(nearness - frame.lens.y), MAX_DIAMETER);
    source[pixel] = vec4<f32>(l, select(NOTHING_SEEN, through.w, found));
    footprint[pixel] = vec4<f32>(diameter, 0.0, 1.0, 0.0);
    region[pixel] = select(1u, 2u, nearness > frame.lens.y);
}
