// Finds the closest hits of up to 64 eye rays at once: a subgroup walks the tree for a tile of 8 x 8 pixels. See pass/trace.rs.
// ALPHA: some surfaces let rays pass.
// EDGES: for the rays at edges that each tile has.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "triangle.wgsl"
#include "subgroup.wgsl"
#include "cluster_walk.wgsl"
#include "shaft.wgsl"
#if ALPHA
#include "alpha.wgsl"
#endif
#if EDGES
#include "edge_rays.wgsl"
#endif

@group(0) @binding(7) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> hits: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> progress: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(12) var<storage, read> steps: array<Step>;
#if EDGES
@group(0) @binding(13) var<storage, read> marks: array<u32>;        // rays of each tile
#endif
var<immediate> push: Push;

const FAR: f32 = 3.0e38;
const NOTHING: u32 = 0xffffffffu;

// Distance at which the shaft enters a box, at most `far`; FAR if it misses the box.
fn shaft_enters(shaft: Shaft, lo: vec3<f32>, hi: vec3<f32>, far: f32) -> f32 {
    let span = shaft_span(shaft, lo, hi, far);
    return select(FAR, span.x, span.x <= span.y);
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let step = steps[push.step];
    let across = (frame.size.x + 7u) / 8u;
    let down = (frame.size.y + 7u) / 8u;
    let cluster = spread_runs(group, groups);
    if cluster >= across * down {
        return;
    }
#if EDGES
    let count = marks[cluster];
    if count == 0u {
        return;
    }
    let part = part_of_tile(cluster);
    let last = count - 1u;
#endif
    let eye = frame.eye.xyz;
    var ray: array<u32, RAYS>;
    var d: array<vec3<f32>, RAYS>;
    var inverse: array<vec3<f32>, RAYS>;
    // Closest hit so far: distance and triangle.
    var best: array<f32, RAYS>;
    var nearest: array<u32, RAYS>;
    var present = 0u;
    var lo = vec3<f32>(FAR);
    var hi = vec3<f32>(-FAR);
    for (var r = 0u; r < RAYS; r += 1u) {
        let i = r * LANES + lane;
        // Rays beyond the last, or beyond the image, repeat it and take no part.
#if EDGES
        present |= select(0u, 1u << r, i <= last);
        ray[r] = ray_of_tile(part, min(i, last));
#else
        let at = pixel_of_tile(cluster, i);
        let inside = min(at, frame.size.xy - 1u);
        present |= select(0u, 1u << r, all(at == inside));
        ray[r] = inside.x + inside.y * frame.size.x;
#endif
        d[r] = ray_direction[ray[r]].xyz;
        inverse[r] = safe_inverse(d[r]);
#if EDGES
        best[r] = FAR;
#else
        // As in camera_rays.wgsl.
        best[r] = select(-1.0, FAR, in_task(inside));
#endif
        nearest[r] = NOTHING;
        lo = min(lo, d[r]);
        hi = max(hi, d[r]);
    }
    let shaft = make_shaft(min_reduce(lo), max_reduce(hi));

    var left = step.steps;
    // The nearest of a node's children is visited first.
    var walk: Walk;
    walk.pending = 1u;
    var chosen = 0u;
    var far = FAR;
    var more = true;
#if ALPHA
    // Leaves of a node with surfaces that let rays pass: first triangle, and mask of those in the shaft. As in shade_cluster.wgsl, they are
    // looked up outside of the walk.
    var waiting: array<u32, PARTS>;
    var waiting_mask: array<u32, PARTS>;
    var waiting_count = 0u;
    loop {
    while more && left > 0u && waiting_count == 0u {
#else
    while more && left > 0u {
#endif
        var child: array<u32, PARTS>;
        var leaves = 0u;
        loop {
            left = max(left, 1u) - 1u;
            let node = walk.base + chosen;
            push_rest(&walk, walk.pending & ~(1u << chosen), lane);

            var box_lo: array<vec3<f32>, PARTS>;
            var box_hi: array<vec3<f32>, PARTS>;
            // Distance and number of a child in one word: bits of positive floats order like the floats.
            var order: array<u32, PARTS>;
            var in_shaft = 0u;
            var is_leaf = 0u;
            for (var part = 0u; part < PARTS; part += 1u) {
                let k = number_of(part, lane);
                let loaded = load_child(node, k, eye);
                box_lo[part] = loaded.lo;
                box_hi[part] = loaded.hi;
                child[part] = loaded.entry;
                let enter = shaft_enters(shaft, loaded.lo, loaded.hi, far);
                order[part] = (bitcast<u32>(enter) & ~7u) | k;
                in_shaft |= select(0u, 1u << k, enter < FAR);
                is_leaf |= select(0u, 1u << k, is_leaf_entry(loaded.entry));
            }
            var survivors = or_reduce(in_shaft);
            var met_by = 0u;
            loop {
                left = max(left, 1u) - 1u;
                let k = firstTrailingBit(survivors) & 7u;
                let k_lo = vec3_of(&box_lo, k);
                let k_hi = vec3_of(&box_hi, k);
                var met = false;
                for (var r = 0u; r < RAYS; r += 1u) {
                    // Apart, because a call behind || or && becomes a branch.
                    let meets = slabs_meet(k_lo * inverse[r], k_hi * inverse[r], best[r]);
                    met = met || meets;
                }
                met_by |= select(0u, (survivors & (~survivors + 1u)), met);
                survivors &= survivors - 1u;
                if survivors == 0u {
                    break;
                }
            }
            met_by = or_reduce(met_by);
            let leaf_children = or_reduce(is_leaf);
            leaves = met_by & leaf_children;
            walk.pending = met_by & ~leaf_children;
            walk.base = subgroupShuffle(child[0], 0u);
            var first = NOTHING;
            for (var part = 0u; part < PARTS; part += 1u) {
                first = min(first, select(NOTHING, order[part], ((walk.pending >> (order[part] & 7u)) & 1u) != 0u));
            }
            chosen = min_of_eight(first) & 7u;
            let popped = pop_if_done(&walk);
            chosen = select(chosen, firstTrailingBit(walk.pending) & 7u, popped);
            if leaves != 0u || walk.pending == 0u || left == 0u {
                break;
            }
        }
        more = walk.pending != 0u;

        // Leaves: lane k sets up triangle k; triangles in the shaft are tested against the rays.
        loop {
            left = max(left, 1u) - 1u;
            let leaf = firstTrailingBit(leaves) & 7u;
            let entry = u32_of(&child, leaf);
            let count = select(0u, entry >> 28u, leaves != 0u);
            leaves &= leaves - 1u;
            let index = entry & 0x0fffffffu;
            var planes: array<Planes, PARTS>;
            var taking_part = 0u;
#if ALPHA
            var lets_pass = 0u;
#endif
            for (var part = 0u; part < PARTS; part += 1u) {
                let k = number_of(part, lane);
#if ALPHA
                lets_pass |= select(0u, 1u << k, has_alpha(index + min(k, max(count, 1u) - 1u)));
#endif
                let triangle = set_up_triangle(index + min(k, max(count, 1u) - 1u), eye);
                planes[part] = triangle.planes;
                let in_shaft = shaft_enters(shaft, triangle.lo, triangle.hi, far) < FAR;
                taking_part |= select(0u, 1u << k, in_shaft && k < count && triangle.planes.reach != 0.0);
            }
            var survivors = or_reduce(taking_part);
#if ALPHA
            let partly = survivors & or_reduce(lets_pass);
            survivors &= ~partly;
#endif
            loop {
                left = max(left, 1u) - 1u;
                let k = firstTrailingBit(survivors) & 7u;
                let any = survivors != 0u;
                survivors &= survivors - 1u;
                let k_planes = planes_of(&planes, k);
                for (var r = 0u; r < RAYS; r += 1u) {
                    let b = products(k_planes, d[r]);
                    let inside = passes_inside(b);
                    let closer = any && inside && b.z * best[r] > k_planes.reach;
                    best[r] = select(best[r], k_planes.reach / b.z, closer);
                    nearest[r] = select(nearest[r], index + k, closer);
                }
                if survivors == 0u {
                    break;
                }
            }
#if ALPHA
            for (var part = 0u; part < PARTS; part += 1u) {
                let put = partly != 0u && number_of(part, lane) == waiting_count;
                waiting[part] = select(waiting[part], index, put);
                waiting_mask[part] = select(waiting_mask[part], partly, put);
            }
            waiting_count += select(0u, 1u, partly != 0u);
#endif
            if leaves == 0u {
                break;
            }
        }
        // This loop over the rays counts as a visit too.
        left = max(left, 1u) - 1u;
        var farthest = best[0];
        for (var r = 1u; r < RAYS; r += 1u) {
            farthest = max(farthest, best[r]);
        }
        far = -min_reduce(vec3<f32>(-farthest)).x;
    }
#if ALPHA
        for (; waiting_count > 0u; waiting_count -= 1u) {
            let first = u32_of(&waiting, waiting_count - 1u);
            for (var partly = u32_of(&waiting_mask, waiting_count - 1u); partly != 0u; partly &= partly - 1u) {
                left = max(left, 1u + ALPHA_VISITS) - 1u - ALPHA_VISITS;
                let triangle = first + firstTrailingBit(partly);
                let planes = set_up_triangle(triangle, eye).planes;
                var rest = 0u;
                for (var r = 0u; r < RAYS; r += 1u) {
                    let b = products(planes, d[r]);
                    rest |= select(0u, 1u << r, passes_inside(b) && b.z * best[r] > planes.reach);
                }
                var stopping = 0u;
                for (; rest != 0u; rest &= rest - 1u) {
                    let one = firstTrailingBit(rest);
                    // With `one` as an index the array would lie in memory, for the walk too.
                    var taken = ray[0];
                    for (var r = 1u; r < RAYS; r += 1u) {
                        taken = select(taken, ray[r], r == one);
                    }
                    let to = ray_direction[taken].xyz;
                    let hit = intersect_triangle(triangle, eye, to, FAR);
                    let stops = is_stopped(triangle, hit.u, hit.v, to);
                    stopping |= select(0u, 1u << one, hit.ok && stops);
                }
                for (var r = 0u; r < RAYS; r += 1u) {
                    let closer = ((stopping >> r) & 1u) != 0u;
                    best[r] = select(best[r], planes.reach / dot(planes.n_sum, d[r]), closer);
                    nearest[r] = select(nearest[r], triangle, closer);
                }
            }
        }
        if !more || left == 0u {
            break;
        }
    }
#endif

    // The place on the triangle is that of the test for single rays. Single rays finish, from the root, tiles out of budget.
    let node = select(frame.scene.x, 0u, more);
    for (var r = 0u; r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            let found = nearest[r] != NOTHING;
            let hit = intersect_triangle(select(0u, nearest[r], found), eye, d[r], FAR);
            let t = select(best[r], hit.t, hit.ok && found);
            hits[ray[r]] = vec4<f32>(t, select(0.0, hit.u, found), select(0.0, hit.v, found), bitcast<f32>(nearest[r]));
            progress[ray[r]] = vec2<u32>(0u, node);
        }
    }
    if more {
        atomicAdd(&work.unfinished, countOneBits(present));
    }
}
