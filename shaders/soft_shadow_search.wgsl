// Finds the width of the kernel of each quad of 2 x 2 pixels. See pass/soft_shadow.rs.
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
@group(0) @binding(7) var<storage, read_write> ratios: array<vec4<f32>>;    // a point of the quad; w: ratio of its kernel, 0: nothing to convolve
var<immediate> push: Push;

// A workgroup for each tile, an invocation for each of its quads.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tiles = (frame.size.xy + SOFT_TILE - 1u) / SOFT_TILE;
    let index = group.x + group.y * groups.x;
    if index >= tiles.x * tiles.y {
        return;
    }
    let tile = spread_out(index, tiles.x * tiles.y);
    let corner = SOFT_TILE * divided(tile, tiles.x).yx + 2u * vec2<u32>(lane & 7u, lane / 8u);
    if any(corner >= frame.size.xy) {
        return;
    }
    let greatest = soft_windows[tile];
    var chosen = NO_POINT;
    for (var i = select(4u, 0u, greatest > 0.0); i < 4u; i += 1u) {
        let at = corner + vec2<u32>(i & 1u, i / 2u);
        let inside = all(at < frame.size.xy);
        let pixel = select(0u, at.x + at.y * frame.size.x, inside);
        let word = source[pixel].w;
        chosen = min(chosen, select(NO_POINT, pixel, inside && (is_lit(word) || is_blocked(word))));
    }
    let counts = chosen != NO_POINT;
    let pixel = select(0u, chosen, counts);
    let x = source[pixel].xyz;
    let light = soft_light(steps[push.step].first);
    let at = select(corner, place_of_pixel(pixel), counts);
    let ratio = mean_ratio(light, at, x, point_geometric[pixel].xyz, greatest, select(0u, SEARCH, counts));
    ratios[quad_of(corner)] = select(vec4<f32>(0.0), vec4<f32>(x, ratio), counts);
}
