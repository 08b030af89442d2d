// Finds the width of the kernel of each quad of 2 x 2 pixels, and convolves where it is wide. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "emitters.wgsl"
#include "soft_shadows.wgsl"
#include "soft_search.wgsl"
#include "spread_out.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> steps: array<Step>;
@group(0) @binding(3) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> blockers: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> soft_windows: array<f32>;
@group(0) @binding(7) var<storage, read_write> soft_quads: array<vec4<f32>>;    // a point of the quad; w: what is known, see soft_shadows.wgsl
var<immediate> push: Push;

// A workgroup for 8 x 8 quads.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let blocks = (frame.size.xy + 15u) / 16u;
    let index = group.x + group.y * groups.x;
    if index >= blocks.x * blocks.y {
        return;
    }
    let block = spread_out(index, blocks.x * blocks.y);
    let corner = 16u * divided(block, blocks.x).yx + 2u * vec2<u32>(lane & 7u, lane / 8u);
    if any(corner >= frame.size.xy) {
        return;
    }
    let greatest = soft_windows[soft_tile_of(corner)];
    var chosen = NO_POINT;
    for (var i = select(4u, 0u, greatest > 0.0); i < 4u; i += 1u) {
        let at = corner + vec2<u32>(i & 1u, i / 2u);
        let inside = all(at < frame.size.xy);
        let pixel = select(0u, at.x + at.y * frame.size.x, inside);
        let word = source[pixel].w;
        chosen = min(chosen, select(NO_POINT, pixel, inside && (is_lit(word) || is_blocked(word))));
    }
    var found = vec4<f32>(0.0, 0.0, 0.0, QUAD_UNKNOWN);
    // A loop that runs zero times skips work on every device.
    for (var once = select(1u, 0u, chosen == NO_POINT); once > 0u; once -= 1u) {
        let own = source[chosen];
        let n = point_geometric[chosen].xyz;
        let at = place_of_pixel(chosen);
        let kernel = soft_kernel(soft_light(steps[push.step].first), own.xyz, n);
        let ratio = mean_ratio(kernel, at, own.xyz, n, greatest);
        var known = ratio;
        for (var wide = select(0u, 1u, is_wide(kernel, ratio)); wide > 0u; wide -= 1u) {
            known = QUAD_LIT - lit_share(kernel, at, own, n, ratio);
        }
        found = vec4<f32>(own.xyz, known);
    }
    soft_quads[quad_of(corner)] = found;
}
