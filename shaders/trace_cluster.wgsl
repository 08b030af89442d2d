// Closest hits of the eye's rays, 64 at once: a subgroup walks the tree for a tile of 8 x 8 pixels. See pass/trace.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "triangle.wgsl"
#include "subgroup.wgsl"
#include "shaft.wgsl"

@group(0) @binding(1) var<storage, read> wide_nodes: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> ray_direction: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> hits: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> progress: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read_write> work: Work;
@group(0) @binding(12) var<storage, read> steps: array<Step>;
var<immediate> push: Push;

// As in shade_cluster.wgsl.
const RAYS: u32 = 64u / LANES;
const PARTS: u32 = 8u / min(LANES, 8u);
const WORDS: u32 = 16u / min(LANES, 16u);

const FAR: f32 = 3.0e38;
const NOTHING: u32 = 0xffffffffu;

fn min_of(x: u32) -> u32 {
    var y = x;
    y = min(y, subgroupShuffleXor(y, 1u));
    y = min(y, subgroupShuffleXor(y, 2u));
    if LANES > 4u {
        y = min(y, subgroupShuffleXor(y, 4u));
    }
    // From eight lanes on they repeat each other.
    return y;
}

// Where the shaft enters a box; beyond `far` if it does not. As shaft_meets, but for rays without an end.
fn shaft_enters(shaft: Shaft, lo: vec3<f32>, hi: vec3<f32>, far: f32) -> f32 {
    let enter = max(bitcast<vec3<i32>>(lo * shaft.enter_lo), bitcast<vec3<i32>>(hi * shaft.enter_hi));
    let leave = bitcast<vec3<i32>>(select(lo, hi, shaft.positive) * shaft.leave + shaft.never);
    let t_near = bitcast<f32>(max(max(enter.x, enter.y), max(enter.z, 0)));
    let t_far = bitcast<f32>(min(min(leave.x, leave.y), min(leave.z, bitcast<i32>(far)))) * 1.000002;
    return select(FAR, t_near, t_near <= t_far);
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
    let eye = frame.eye.xyz;
    var ray: array<u32, RAYS>;
    var d: array<vec3<f32>, RAYS>;
    var inverse: array<vec3<f32>, RAYS>;
    // Closest so far: distance and triangle.
    var best: array<f32, RAYS>;
    var nearest: array<u32, RAYS>;
    var present = 0u;
    var lo = vec3<f32>(FAR);
    var hi = vec3<f32>(-FAR);
    for (var r = 0u; r < RAYS; r += 1u) {
        let i = r * LANES + lane;
        let at = vec2<u32>(8u * (cluster % across) + (i & 7u), 8u * (cluster / across) + i / 8u);
        // Rays beyond the image repeat the last and take no part.
        let inside = min(at, frame.size.xy - 1u);
        present |= select(0u, 1u << r, all(at == inside));
        ray[r] = inside.x + inside.y * frame.size.x;
        d[r] = ray_direction[ray[r]].xyz;
        let tiny = vec3<f32>(1e-30);
        inverse[r] = 1.0 / select(d[r], select(tiny, -tiny, d[r] < vec3<f32>(0.0)), abs(d[r]) < tiny);
        best[r] = FAR;
        nearest[r] = NOTHING;
        lo = min(lo, d[r]);
        hi = max(hi, d[r]);
    }
    let shaft = make_shaft(min_reduce(lo), -min_reduce(-hi));

    var left = step.steps;
    // The stack is that of shade_cluster.wgsl; of a node's children the nearest is visited first.
    var stack: array<u32, WORDS>;
    var top = 0u;
    var base = 0u;
    var pending = 1u;
    var chosen = 0u;
    var far = FAR;
    var more = true;
    while more && left > 0u {
        var child: array<u32, PARTS>;
        var leaves = 0u;
        loop {
            left = max(left, 1u) - 1u;
            let node = base + chosen;
            let rest = pending & ~(1u << chosen);
            let push = rest != 0u;
            let word = base | (rest << 24u);
            for (var w = 0u; w < WORDS; w += 1u) {
                stack[w] = select(stack[w], word, push && lane + w * LANES == top);
            }
            top += select(0u, 1u, push);

            var box_lo: array<vec3<f32>, PARTS>;
            var box_hi: array<vec3<f32>, PARTS>;
            // Distance and number of a child in one word: bits of positive floats order like the floats.
            var order: array<u32, PARTS>;
            var in_shaft = 0u;
            var is_leaf = 0u;
            for (var part = 0u; part < PARTS; part += 1u) {
                let k = part * LANES + (lane & 7u);
                let a = wide_nodes[16u * node + 2u * k];
                let b = wide_nodes[16u * node + 2u * k + 1u];
                box_lo[part] = a.xyz - eye;
                box_hi[part] = b.xyz - eye;
                child[part] = bitcast<u32>(a.w) | (bitcast<u32>(b.w) << 28u);
                let enter = shaft_enters(shaft, box_lo[part], box_hi[part], far);
                order[part] = (bitcast<u32>(enter) & ~7u) | k;
                in_shaft |= select(0u, 1u << k, enter < FAR);
                is_leaf |= select(0u, 1u << k, child[part] >= 0x10000000u);
            }
            var survivors = or_reduce(in_shaft);
            var met_by = 0u;
            loop {
                left = max(left, 1u) - 1u;
                let k = firstTrailingBit(survivors) & 7u;
                let upper = k >= LANES;
                let k_lo = subgroupShuffle(select(box_lo[0], box_lo[PARTS - 1u], upper), k & (LANES - 1u));
                let k_hi = subgroupShuffle(select(box_hi[0], box_hi[PARTS - 1u], upper), k & (LANES - 1u));
                var met = false;
                for (var r = 0u; r < RAYS; r += 1u) {
                    let t0 = bitcast<vec3<i32>>(k_lo * inverse[r]);
                    let t1 = bitcast<vec3<i32>>(k_hi * inverse[r]);
                    let near3 = min(t0, t1);
                    let far3 = max(t0, t1);
                    let near = bitcast<f32>(max(max(near3.x, near3.y), max(near3.z, 0)));
                    let end = bitcast<f32>(min(min(far3.x, far3.y), min(far3.z, bitcast<i32>(best[r])))) * 1.000001;
                    met = met || near <= end;
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
            pending = met_by & ~leaf_children;
            base = subgroupShuffle(child[0], 0u);
            var first = NOTHING;
            for (var part = 0u; part < PARTS; part += 1u) {
                first = min(first, select(NOTHING, order[part], ((pending >> (order[part] & 7u)) & 1u) != 0u));
            }
            chosen = min_of(first) & 7u;
            let pop = pending == 0u && top > 0u;
            top -= select(0u, 1u, pop);
            var words = stack[0];
            for (var w = 1u; w < WORDS; w += 1u) {
                words = select(words, stack[w], top / LANES == w);
            }
            let popped = subgroupShuffle(words, top & (LANES - 1u));
            base = select(base, popped & 0xffffffu, pop);
            pending = select(pending, popped >> 24u, pop);
            chosen = select(chosen, firstTrailingBit(pending) & 7u, pop);
            if leaves != 0u || pending == 0u || left == 0u {
                break;
            }
        }
        more = pending != 0u;

        // Leaves: lane k sets up triangle k; those in the shaft are tested against the rays.
        loop {
            left = max(left, 1u) - 1u;
            let leaf = firstTrailingBit(leaves) & 7u;
            let entry = subgroupShuffle(select(child[0], child[PARTS - 1u], leaf >= LANES), leaf & (LANES - 1u));
            let count = select(0u, entry >> 28u, leaves != 0u);
            leaves &= leaves - 1u;
            let index = entry & 0x0fffffffu;
            var n0: array<vec3<f32>, PARTS>;
            var n1: array<vec3<f32>, PARTS>;
            var n_sum: array<vec3<f32>, PARTS>;
            var reach: array<f32, PARTS>;
            var taking_part = 0u;
            for (var part = 0u; part < PARTS; part += 1u) {
                let k = part * LANES + (lane & 7u);
                let i = index + min(k, max(count, 1u) - 1u);
                let a = triangle_v0[i].xyz - eye;
                let e1 = triangle_e1[i].xyz;
                let e2 = triangle_e2[i].xyz;
                let b = a + e1;
                let c = a + e2;
                // Planes through the eye and each edge, as in shade_cluster.wgsl.
                let face = cross(e1, e2);
                let depth = dot(face, a);
                let side = select(1.0, -1.0, depth < 0.0);
                let m0 = side * cross(e1 - e2, b + c);
                let m1 = side * cross(e2, c + a);
                let m2 = side * cross(-e1, a + b);
                const SLACK: f32 = 1e-5;
                let slack = SLACK * (m0 + m1 + m2);
                n0[part] = m0 + slack;
                n1[part] = m1 + slack;
                n_sum[part] = (side * 2.0 * (1.0 + 3.0 * SLACK)) * face;
                reach[part] = abs(depth) * (2.0 * (1.0 + 3.0 * SLACK));
                let in_shaft = shaft_enters(shaft, min(a, min(b, c)), max(a, max(b, c)), far) < FAR;
                taking_part |= select(0u, 1u << k, in_shaft && k < count && depth != 0.0);
            }
            var survivors = or_reduce(taking_part);
            loop {
                left = max(left, 1u) - 1u;
                let k = firstTrailingBit(survivors) & 7u;
                let any = survivors != 0u;
                survivors &= survivors - 1u;
                let upper = k >= LANES;
                let at = k & (LANES - 1u);
                let k_n0 = subgroupShuffle(select(n0[0], n0[PARTS - 1u], upper), at);
                let k_n1 = subgroupShuffle(select(n1[0], n1[PARTS - 1u], upper), at);
                let k_sum = subgroupShuffle(select(n_sum[0], n_sum[PARTS - 1u], upper), at);
                let k_reach = subgroupShuffle(select(reach[0], reach[PARTS - 1u], upper), at);
                for (var r = 0u; r < RAYS; r += 1u) {
                    let b0 = dot(k_n0, d[r]);
                    let b1 = dot(k_n1, d[r]);
                    let b = dot(k_sum, d[r]); // b0 + b1 + b2
                    let closer = any && b0 >= 0.0 && b1 >= 0.0 && b - b0 >= b1 && b * best[r] > k_reach;
                    best[r] = select(best[r], k_reach / b, closer);
                    nearest[r] = select(nearest[r], index + k, closer);
                }
                if survivors == 0u {
                    break;
                }
            }
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

    // Place on the triangle as a single ray finds it. Single rays carry on from the root what is left.
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
