// Finds the closest hits of a batch of rays, in rounds of bounded length. See pass/trace.rs.
// ALPHA: some surfaces let rays pass.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bvh.wgsl"
#include "triangle.wgsl"
#if ALPHA
#include "alpha.wgsl"
#endif

@group(0) @binding(6) var<storage, read> ray_origin: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> hits: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> progress: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(11) var<storage, read> list: array<u32>;
@group(0) @binding(12) var<storage, read> steps: array<Step>;
var<immediate> push: Push;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let step = steps[push.step];
    let index = spread_group(group, groups) * 64u + lane;
    // Without a list, `end` is the number of rays.
    let listed = step.indirect == 1u;
    let count = select(step.end, atomicLoad(&work.live), listed);
    if index >= count {
        return;
    }
    // `select` evaluates both operands, and the list may be shorter than a batch without a list.
    let ray = select(index, list[select(0u, index, listed)], listed);
    let nodes = frame.scene.x;
    let origin4 = ray_origin[ray];
    let origin = origin4.xyz;
    let d = ray_direction[ray].xyz;
    // t, u, v of the closest hit so far and the bits of its triangle; t_max and no triangle at the start.
    var best = vec4<f32>(origin4.w, 0.0, 0.0, bitcast<f32>(0xffffffffu));
    var node = 0u;
    if step.round > 0u {
        best = hits[ray];
        node = progress[ray].y;
    }
    let inverse = safe_inverse(d);
    var left = step.steps;
#if ALPHA
    // As in shade.wgsl, surfaces that let rays pass are looked up outside of the walk.
    var resume = 0u;
    loop {
    var waiting = NO_TRIANGLE;
    while node < nodes && (left > 0u || resume > 0u) && waiting == NO_TRIANGLE {
#else
    while node < nodes && left > 0u {
#endif
        left = max(left, 1u) - 1u;
        let lo = node_min[node];
        let hi = node_max[node];
        let span = slab(lo.xyz, hi.xyz, origin, inverse, best.x);
        let inside = span.x <= span.y;
        let leaf = bitcast<u32>(hi.w);
        let first = leaf >> 3u;
        let end = first + select(0u, leaf & 7u, inside);
#if ALPHA
        for (var i = max(first, resume); i < end && waiting == NO_TRIANGLE; i += 1u) {
            let hit = intersect_triangle(i, origin, d, best.x);
            for (var j = select(0u, 1u, hit.ok); j > 0u; j -= 1u) {
                let lets_pass = has_alpha(i);
                waiting = select(NO_TRIANGLE, i, lets_pass);
                best = select(vec4<f32>(hit.t, hit.u, hit.v, bitcast<f32>(i)), best, lets_pass);
            }
        }
        resume = select(waiting + 1u, 0u, waiting == NO_TRIANGLE);
        let stays = waiting != NO_TRIANGLE;
#else
        for (var i = first; i < end; i += 1u) {
            let hit = intersect_triangle(i, origin, d, best.x);
            if hit.ok {
                best = vec4<f32>(hit.t, hit.u, hit.v, bitcast<f32>(i));
            }
        }
        let stays = false;
#endif
        node = select(select(bitcast<u32>(lo.w), node + 1u, inside && leaf == 0u), node, stays);
    }
#if ALPHA
        if waiting == NO_TRIANGLE {
            break;
        }
        let hit = intersect_triangle(waiting, origin, d, best.x);
        if is_stopped(waiting, hit.u, hit.v, d) {
            best = vec4<f32>(hit.t, hit.u, hit.v, bitcast<f32>(waiting));
        }
    }
#endif
    hits[ray] = best;
    progress[ray] = vec2<u32>(0u, node);
    if node < nodes {
        atomicAdd(&work.unfinished, 1u);
    }
}
