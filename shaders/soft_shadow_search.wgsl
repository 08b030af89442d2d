// Finds the width of the kernel of each quad of 2 x 2 pixels, and convolves where it is wide. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "math.wgsl"
#include "soft_shadows.wgsl"
#include "soft_emitter.wgsl"
#include "soft_search.wgsl"
#include "spread_out.wgsl"

@group(0) @binding(1) var<storage, read> soft_emitter: array<vec4<f32>>;
@group(0) @binding(3) var source: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var blockers: texture_storage_2d<rgba32float, read>;
@group(0) @binding(6) var<storage, read> soft_windows: array<f32>;
@group(0) @binding(7) var soft_quads: texture_storage_2d<rgba32float, write>;    // a point of the quad; w: what is known, see soft_shadows.wgsl

// A workgroup for 8 x 8 quads.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let view = soft_view();
    let light = soft_light();
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
    var chosen = 4u;
    for (var i = select(4u, 0u, greatest > 0.0); i < 4u; i += 1u) {
        let at = corner + vec2<u32>(i & 1u, i / 2u);
        let inside = all(at < frame.size.xy);
        let word = textureLoad(source, vec2<i32>(select(corner, at, inside))).w;
        chosen = min(chosen, select(4u, i, inside && (is_lit(word) || is_blocked(word))));
    }
    let at = corner + select(vec2<u32>(0u), vec2<u32>(chosen & 1u, chosen / 2u), chosen < 4u);
    let own = textureLoad(source, vec2<i32>(at));
    let n = point_geometric[at.x + at.y * frame.size.x].xyz;
    let kernel = soft_kernel(view, light, own.xyz, n);
    var found = vec4<f32>(0.0, 0.0, 0.0, QUAD_UNKNOWN);
    // A loop that runs zero times skips work on every device.
    for (var once = select(1u, 0u, chosen == 4u); once > 0u; once -= 1u) {
        let ratio = mean_ratio(kernel, at, own.xyz, n, greatest);
        var known = ratio;
        for (var wide = select(0u, 1u, is_wide(kernel, ratio)); wide > 0u; wide -= 1u) {
            known = QUAD_LIT - lit_share(kernel, at, own, n, ratio);
        }
        found = vec4<f32>(own.xyz, known);
    }
    textureStore(soft_quads, vec2<i32>(corner / 2u), found);
}
