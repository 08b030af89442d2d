// As shade.wgsl, for 64 receivers at once: a subgroup walks the tree for a whole cluster and one light.
// See pass/shade.rs.
// VISIBILITY: only counts the lights that each receiver sees. See pass/visibility.rs.
// COUNTERS: with VISIBILITY, also counts what the clusters met.
// AREA: with VISIBILITY, the lights are area lights and each ray goes to its own point of one.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "lights.wgsl"
#include "receiver.wgsl"
#if AREA
#include "area.wgsl"
#endif
#if VISIBILITY
#else
#include "light_at.wgsl"
#endif

@group(0) @binding(1) var<storage, read> wide_nodes: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> triangle_v0: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> triangle_e1: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> triangle_e2: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> receiver_position: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> receiver_geometric: array<vec4<f32>>;
#if VISIBILITY
#else
@group(0) @binding(8) var<storage, read> receiver_shading: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> receiver_f0: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> receiver_wo: array<vec4<f32>>;
#endif
@group(0) @binding(11) var<storage, read> lights: array<PointLight>;
@group(0) @binding(12) var<storage, read> list: array<u32>;
@group(0) @binding(13) var<storage, read_write> work: Work;
@group(0) @binding(14) var<storage, read> steps: array<Step>;
@group(0) @binding(15) var<storage, read_write> progress: array<vec2<u32>>;
#if VISIBILITY
@group(0) @binding(16) var<storage, read_write> visible: array<u32>;
#if COUNTERS
// Pairs of a cluster and a light, their rays, nodes, children, leaves and triangles that were tested.
@group(0) @binding(17) var<storage, read_write> counters: array<atomic<u32>, 6>;
#endif
#else
@group(0) @binding(16) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> specular: array<vec4<f32>>;
// Of each class its first cluster and its first receiver; on a list in the order of the screen, of each cluster its class.
@group(0) @binding(19) var<storage, read> classes: array<vec2<u32>>;
#endif
var<immediate> push: Push;

#include "subgroup.wgsl"
// Rays that each lane holds: a cluster has 64.
const RAYS: u32 = 64u / LANES;
// Children of a node, or triangles of a leaf, that each lane holds: eight in all; the lanes from 8 on repeat them.
const PARTS: u32 = 8u / min(LANES, 8u);
// Registers that hold the sixteen words of the stack, lane by lane. The host takes this kernel only where that is enough
// (accel::wide::WideBvh::stack_bound).
const WORDS: u32 = 16u / min(LANES, 16u);
// Greatest number of lights for each mask of lights.
const MASK: u32 = 32u;

#include "shaft.wgsl"

#if VISIBILITY
#else
// What a visible light gives to a receiver by way of specular lobes: returns the irradiance that the light's own lobe adds,
// and adds what the receiver's lobe reflects to `specular`.
fn add_lobes(light: u32, p: u32, clip2: f32) -> vec3<f32> {
    let l = lights[light];
    let geometric = receiver_geometric[p];
    let shading = receiver_shading[p];
    let f0 = receiver_f0[p];
    let flags = bitcast<u32>(l.position.w);
    let d = l.position.xyz - receiver_position[p].xyz;
    let r2 = dot(d, d);
    let wi = d / sqrt(max(r2, 1e-37));
    let cos_light = -dot(wi, l.normal.xyz);
    let plain = plain_intensity(l.normal, l.emit, flags, cos_light);
    let extra = lobe_intensity(l, wi, cos_light);
    let factor = max(dot(wi, shading.xyz), 0.0) * inverse_square(r2, clip2);
    let reflected = eval_specular(receiver_lobe(geometric, shading, f0), shading.xyz, receiver_wo[p].xyz, wi);
    specular[p] += vec4<f32>(select(vec3<f32>(0.0), (plain + extra) * factor * reflected, f0.w > 0.0), 0.0);
    return extra * factor;
}
#endif

// Greatest n . d for n and d in boxes.
fn greatest_dot(n_lo: vec3<f32>, n_hi: vec3<f32>, d_lo: vec3<f32>, d_hi: vec3<f32>) -> f32 {
    let sides = max(max(n_lo * d_lo, n_lo * d_hi), max(n_hi * d_lo, n_hi * d_hi));
    return sides.x + sides.y + sides.z;
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let step = steps[push.step];
    let live = atomicLoad(&work.live);
    let cluster = spread_runs(group, groups);
#if VISIBILITY
    let begin = cluster * 64u;
    let end = live;
    let lights_of_class = 0u;
#else
    // A cluster takes receivers of one class of pixels, which has lights of its own.
    var of_class = 0u;
    for (var k = 1u; k < frame.pattern.z; k += 1u) {
        of_class = select(of_class, k, classes[k].x <= cluster);
    }
    let several = frame.pattern.z > 1u;
    let by_screen = step.indirect == 2u;
    let shift = select(0u, classes[of_class].y - 64u * classes[of_class].x, several && !by_screen);
    let begin = shift + cluster * 64u;
    let end = select(select(live, classes[of_class + 1u].y, several), work.total, by_screen);
    of_class = select(of_class, classes[select(0u, cluster, by_screen)].x, by_screen);
    let lights_of_class = of_class * frame.pattern.w;
#endif
    if begin >= end {
        return;
    }
    var pixel: array<u32, RAYS>;
    var present = 0u;
    // Slots without a receiver, and those beyond the last, repeat another one and take no part.
    var some = NO_RECEIVER;
    for (var r = 0u; r < RAYS; r += 1u) {
        let slot = begin + r * LANES + lane;
        pixel[r] = select(NO_RECEIVER, list[min(slot, end - 1u)], slot < end);
        present |= select(0u, 1u << r, pixel[r] != NO_RECEIVER);
        some = min(some, pixel[r]);
    }
    some = least(some);
    // A cluster goes on with the light that it did not finish, from the start; all its receivers stand at the same one.
    let start = select(step.first, progress[some].x, step.round > 0u);
    if start >= step.end {
        return;
    }
    let fresh = step.fresh == 1u && step.round == 0u;

    var position: array<vec3<f32>, RAYS>;
    var geometric: array<vec3<f32>, RAYS>;
#if VISIBILITY
    var seen: array<u32, RAYS>;
#else
    var shading: array<vec3<f32>, RAYS>;
    var sum: array<vec3<f32>, RAYS>;
    var glossy = 0u;
#endif
    var lo = vec3<f32>(3.0e38);
    var hi = vec3<f32>(-3.0e38);
    var geometric_lo = vec3<f32>(1.0);
    var geometric_hi = vec3<f32>(-1.0);
    var shading_lo = vec3<f32>(1.0);
    var shading_hi = vec3<f32>(-1.0);
    for (var r = 0u; r < RAYS; r += 1u) {
        let p = select(pixel[r], some, pixel[r] == NO_RECEIVER);
        pixel[r] = p;
        position[r] = receiver_position[p].xyz;
        geometric[r] = receiver_geometric[p].xyz;
        lo = min(lo, position[r]);
        hi = max(hi, position[r]);
        geometric_lo = min(geometric_lo, geometric[r]);
        geometric_hi = max(geometric_hi, geometric[r]);
#if VISIBILITY
        seen[r] = select(visible[p], 0u, fresh);
#else
        shading[r] = receiver_shading[p].xyz;
        shading_lo = min(shading_lo, shading[r]);
        shading_hi = max(shading_hi, shading[r]);
        glossy |= select(0u, 1u << r, receiver_f0[p].w > 0.0) & present;
#endif
    }
#if VISIBILITY
#else
    // Under a SIMD driver a loop that does not run costs less than an `if`, of which all lanes execute both sides.
    for (var r = select(RAYS, 0u, fresh); r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            specular[pixel[r]] = vec4<f32>(0.0);
        }
    }
#endif
    lo = min_reduce(lo);
    hi = -min_reduce(-hi);
    geometric_lo = min_reduce(geometric_lo);
    geometric_hi = -min_reduce(-geometric_hi);

    // Lane k looks at light k: which lights may send anything to the cluster?
    let count = step.end - step.first;
    var todo = 0u;
#if VISIBILITY
    for (var base = 0u; base < count; base += LANES) {
        let i = base + lane;
#if AREA
        let area = area_light(lights[lights_of_class + step.first + min(i, count - 1u)]);
        let d_lo = area.centre - area.extent - hi;
        let d_hi = area.centre + area.extent - lo;
        let faces = greatest_dot(geometric_lo, geometric_hi, d_lo, d_hi) > 0.0;
#else
        let to_light = lights[lights_of_class + step.first + min(i, count - 1u)].position.xyz;
        let faces = greatest_dot(geometric_lo, geometric_hi, to_light - hi, to_light - lo) > 0.0;
#endif
        todo |= select(0u, 1u << (i & 31u), faces && i < count && step.first + i >= start);
    }
#else
    shading_lo = min_reduce(shading_lo);
    shading_hi = -min_reduce(-shading_hi);
    for (var base = 0u; base < count; base += LANES) {
        let i = base + lane;
        let l = lights[lights_of_class + step.first + min(i, count - 1u)];
        let d_lo = l.position.xyz - hi;
        let d_hi = l.position.xyz - lo;
        let flags = bitcast<u32>(l.position.w);
        let faces = greatest_dot(geometric_lo, geometric_hi, d_lo, d_hi) > 0.0
            && greatest_dot(shading_lo, shading_hi, d_lo, d_hi) > 0.0;
        let reaches = (flags & LIGHT_SURFACE) == 0u || greatest_dot(l.normal.xyz, l.normal.xyz, -d_hi, -d_lo) > 0.0;
        // The greatest irradiance, at the nearest point of the cluster's box.
        let nearest = max(max(d_lo, -d_hi), vec3<f32>(0.0));
        let greatest = max(l.emit.x, max(l.emit.y, l.emit.z)) / max(max(dot(nearest, nearest), clip2_of(flags)), 1e-37);
        let glossy_light = (flags & LIGHT_GLOSSY) != 0u && mean3(l.flux.xyz) > 0.0;
        let counts = glossy_light || greatest > frame.pixel_offset.w;
        todo |= select(0u, 1u << (i & 31u), faces && reaches && counts && i < count && step.first + i >= start);
    }
#endif
    todo = or_reduce(todo);
    if lane == 0u && step.round == 0u {
        atomicAdd(&work.culled, count - countOneBits(todo));
    }

#if COUNTERS
    var met: array<u32, 6>;
#endif
    // Every visit takes from one budget. What is left when it is spent is carried on by the next round.
    var left = step.steps;
    var blocker = 0u;
#if VISIBILITY
    let kinds = vec2<u32>(0u, 1u);
#else
    // First the lights that shine directly, then those behind reflections; the first chunk starts the sums of both.
    let directly = clamp(frame.depths[1].y, step.first, step.end) - step.first;
    let direct_lights = select((1u << (directly & 31u)) - 1u, 0xffffffffu, directly >= 32u);
    let kinds = vec2<u32>(select(0u, 1u, directly == 0u && !fresh), select(2u, 1u, directly == count && !fresh));
#endif
    for (var kind = kinds.x; kind < kinds.y; kind += 1u) {
#if VISIBILITY
        let of_kind = todo;
#else
        for (var r = 0u; r < RAYS; r += 1u) {
            sum[r] = vec3<f32>(0.0);
        }
        for (var r = select(0u, RAYS, fresh); r < RAYS; r += 1u) {
            sum[r] = select(indirect[pixel[r]].xyz, direct[pixel[r]].xyz, kind == 0u);
        }
        let of_kind = select(~direct_lights, direct_lights, kind == 0u);
#endif
        while (todo & of_kind) != 0u && left > 0u {
            let place = lights_of_class + step.first + firstTrailingBit(todo & of_kind);
#if AREA
            let area = area_light(lights[place]);
            let origin = area.centre;
            // Where the rays start, from the light's centre, and their moments q x d.
            var q: array<vec3<f32>, RAYS>;
            var moment: array<vec3<f32>, RAYS>;
#else
            let l_position = lights[place].position;
            let origin = l_position.xyz;
#endif
#if VISIBILITY
#else
            let l_normal = lights[place].normal;
            let l_emit = lights[place].emit;
            let flags = bitcast<u32>(l_position.w);
            let surface = (flags & LIGHT_SURFACE) != 0u;
#endif

            // Rays run from the light (t = 0) to the receivers (t = 1).
            var d: array<vec3<f32>, RAYS>;
            var inverse: array<vec3<f32>, RAYS>;
            var alive = 0u;
            for (var r = 0u; r < RAYS; r += 1u) {
#if AREA
                let point = area_point(area, pixel[r], place);
                q[r] = point - origin;
                d[r] = position[r] - point;
                moment[r] = cross(q[r], d[r]);
#else
                d[r] = position[r] - origin;
#endif
#if VISIBILITY
                let lit = dot(d[r], geometric[r]) < 0.0 && ((present >> r) & 1u) != 0u;
#else
                let faces = dot(d[r], geometric[r]) < 0.0 && dot(d[r], shading[r]) < 0.0;
                let reaches = !surface || dot(d[r], l_normal.xyz) > 0.0;
                let lit = faces && reaches && ((present >> r) & 1u) != 0u;
#endif
                alive |= select(0u, 1u << r, lit);
                let tiny = vec3<f32>(1e-30);
                inverse[r] = 1.0 / select(d[r], select(tiny, -tiny, d[r] < vec3<f32>(0.0)), abs(d[r]) < tiny);
            }
#if COUNTERS
            met[0] += 1u;
            met[1] += countOneBits(alive);
#endif
#if AREA
            let shaft = make_shaft(lo - origin, hi - origin, area.extent);
#else
            let shaft = make_shaft(lo - origin, hi - origin);
#endif

            // A word of the stack: children of one node that are still to be visited, as the first child's node and, from bit 24,
            // a mask. Lane i holds word i, and where there are more words than lanes word i + LANES, and so on.
            var stack: array<u32, WORDS>;
            var top = 0u;
            var base = 0u;
            var pending = select(0u, 1u, or_reduce(alive) != 0u);
            // The leaf that blocked the last cluster-light pair is tried first: it often blocks this one too.
            var child: array<u32, PARTS>;
            for (var part = 0u; part < PARTS; part += 1u) {
                child[part] = blocker;
            }
            var leaves = select(0u, 1u, pending != 0u && blocker != 0u);
            var more = pending != 0u;
            while more && left > 0u {
                // Leaves: lane k sets up triangle k; those in the shaft are tested against the rays.
                loop {
                    left = max(left, 1u) - 1u;
                    let leaf = firstTrailingBit(leaves) & 7u;
                    let entry = subgroupShuffle(select(child[0], child[PARTS - 1u], leaf >= LANES), leaf & (LANES - 1u));
                    let count = select(0u, entry >> 28u, leaves != 0u);
#if COUNTERS
                    met[4] += select(0u, 1u, leaves != 0u);
#endif
                    leaves &= leaves - 1u;
                    let index = entry & 0x0fffffffu;
                    var n0: array<vec3<f32>, PARTS>;
                    var n1: array<vec3<f32>, PARTS>;
                    var n_sum: array<vec3<f32>, PARTS>;
                    var reach: array<f32, PARTS>;
#if AREA
                    var edge0: array<vec3<f32>, PARTS>;
                    var edge1: array<vec3<f32>, PARTS>;
#endif
                    var taking_part = 0u;
                    for (var part = 0u; part < PARTS; part += 1u) {
                        let k = part * LANES + (lane & 7u);
                        let i = index + min(k, max(count, 1u) - 1u);
                        let a = triangle_v0[i].xyz - origin;
                        let e1 = triangle_e1[i].xyz;
                        let e2 = triangle_e2[i].xyz;
                        let b = a + e1;
                        let c = a + e2;
                        // Planes through the light and each edge, formed from differences: products of far corners would lose
                        // the depth of small triangles. All turned so that a ray inside has positive products, which are then
                        // proportional to barycentric coordinates.
                        let face = cross(e1, e2);
                        let depth = dot(face, a);
#if AREA
                        // Rays from different points may come from different sides: each ray turns the planes itself. These are
                        // the planes through the light's centre; with q the sum b + c becomes b + c - 2 q.
                        let side = 1.0;
                        edge0[part] = 2.0 * (e1 - e2);
                        edge1[part] = 2.0 * e2;
#else
                        let side = select(1.0, -1.0, depth < 0.0);
#endif
                        let m0 = side * cross(e1 - e2, b + c);
                        let m1 = side * cross(e2, c + a);
                        let m2 = side * cross(-e1, a + b);
                        // The slack of a single ray's test, which makes each product larger by that share of their sum.
                        const SLACK: f32 = 1e-5;
                        let slack = SLACK * (m0 + m1 + m2);
                        n0[part] = m0 + slack;
                        n1[part] = m1 + slack;
                        // The three planes add up to twice the triangle's own.
                        n_sum[part] = (side * 2.0 * (1.0 + 3.0 * SLACK)) * face;
#if AREA
                        reach[part] = depth * (2.0 * (1.0 + 3.0 * SLACK));
                        let takes_part = shaft_meets(shaft, min(a, min(b, c)), max(a, max(b, c))) && k < count;
                        taking_part |= select(0u, 1u << k, takes_part);
#else
                        reach[part] = abs(depth) * (2.0 * (1.0 + 3.0 * SLACK));
                        let in_shaft = shaft_meets(shaft, min(a, min(b, c)), max(a, max(b, c)));
                        taking_part |= select(0u, 1u << k, in_shaft && k < count && depth != 0.0);
#endif
                    }
                    var survivors = or_reduce(taking_part);
                    loop {
                        left = max(left, 1u) - 1u;
                        let k = firstTrailingBit(survivors) & 7u;
                        let any = survivors != 0u;
#if COUNTERS
                        met[5] += select(0u, 1u, any);
#endif
                        survivors &= survivors - 1u;
                        let upper = k >= LANES;
                        let at = k & (LANES - 1u);
                        let k_n0 = subgroupShuffle(select(n0[0], n0[PARTS - 1u], upper), at);
                        let k_n1 = subgroupShuffle(select(n1[0], n1[PARTS - 1u], upper), at);
                        let k_sum = subgroupShuffle(select(n_sum[0], n_sum[PARTS - 1u], upper), at);
                        let k_reach = select(3.0e38, subgroupShuffle(select(reach[0], reach[PARTS - 1u], upper), at), any);
#if AREA
                        let k_edge0 = subgroupShuffle(select(edge0[0], edge0[PARTS - 1u], upper), at);
                        let k_edge1 = subgroupShuffle(select(edge1[0], edge1[PARTS - 1u], upper), at);
#endif
                        for (var r = 0u; r < RAYS; r += 1u) {
#if AREA
                            // What moving a plane to q takes away: (2 edge x q) . d = 2 edge . (q x d).
                            let depth = k_reach - dot(k_sum, q[r]);
                            let side = select(1.0, -1.0, depth < 0.0);
                            let b0 = side * (dot(k_n0, d[r]) - dot(k_edge0, moment[r]));
                            let b1 = side * (dot(k_n1, d[r]) - dot(k_edge1, moment[r]));
                            let b = side * dot(k_sum, d[r]);
                            let blocked = b0 >= 0.0 && b1 >= 0.0 && b - b0 >= b1 && b > abs(depth) && depth != 0.0;
#else
                            let b0 = dot(k_n0, d[r]);
                            let b1 = dot(k_n1, d[r]);
                            let b = dot(k_sum, d[r]); // b0 + b1 + b2
                            let blocked = b0 >= 0.0 && b1 >= 0.0 && b - b0 >= b1 && b > k_reach;
#endif
                            alive &= ~select(0u, 1u << r, blocked);
                        }
                        if survivors == 0u {
                            break;
                        }
                    }
                    let dead = or_reduce(alive) == 0u;
                    blocker = select(blocker, entry, dead);
                    pending = select(pending, 0u, dead);
                    top = select(top, 0u, dead);
                    leaves = select(leaves, 0u, dead);
                    if leaves == 0u {
                        break;
                    }
                }
                leaves = 0u;
                more = pending != 0u;
                loop {
                    left = max(left, 1u) - 1u;
                    let node = select(0u, base + firstTrailingBit(pending), more);
#if COUNTERS
                    met[2] += select(0u, 1u, more);
#endif
                    let rest = pending & (pending - 1u);
                    let push = rest != 0u;
                    let word = base | (rest << 24u);
                    for (var w = 0u; w < WORDS; w += 1u) {
                        stack[w] = select(stack[w], word, push && lane + w * LANES == top);
                    }
                    top += select(0u, 1u, push);

                    var box_lo: array<vec3<f32>, PARTS>;
                    var box_hi: array<vec3<f32>, PARTS>;
                    var in_shaft = 0u;
                    var is_leaf = 0u;
                    for (var part = 0u; part < PARTS; part += 1u) {
                        let k = part * LANES + (lane & 7u);
                        let a = wide_nodes[16u * node + 2u * k];
                        let b = wide_nodes[16u * node + 2u * k + 1u];
                        box_lo[part] = a.xyz - origin;
                        box_hi[part] = b.xyz - origin;
                        child[part] = bitcast<u32>(a.w) | (bitcast<u32>(b.w) << 28u);
                        in_shaft |= select(0u, 1u << k, shaft_meets(shaft, box_lo[part], box_hi[part]));
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
#if COUNTERS
                        met[3] += select(0u, 1u, survivors != 0u);
#endif
                        var hits = 0u;
                        for (var r = 0u; r < RAYS; r += 1u) {
#if AREA
                            let t0 = bitcast<vec3<i32>>((k_lo - q[r]) * inverse[r]);
                            let t1 = bitcast<vec3<i32>>((k_hi - q[r]) * inverse[r]);
#else
                            let t0 = bitcast<vec3<i32>>(k_lo * inverse[r]);
                            let t1 = bitcast<vec3<i32>>(k_hi * inverse[r]);
#endif
                            let near3 = min(t0, t1);
                            let far3 = max(t0, t1);
                            let near = bitcast<f32>(max(max(near3.x, near3.y), max(near3.z, 0)));
                            let far = bitcast<f32>(min(min(far3.x, far3.y), min(far3.z, 0x3f800000))) * 1.000001;
                            hits |= select(0u, 1u << r, near <= far);
                        }
                        met_by |= select(0u, (survivors & (~survivors + 1u)), (hits & alive) != 0u);
                        survivors &= survivors - 1u;
                        if survivors == 0u {
                            break;
                        }
                    }
                    met_by = or_reduce(met_by);
                    let leaf_children = or_reduce(is_leaf);
                    leaves = select(0u, met_by & leaf_children, more);
                    pending = select(0u, met_by & ~leaf_children, more);
                    base = subgroupShuffle(child[0], 0u);
                    let pop = pending == 0u && top > 0u;
                    top -= select(0u, 1u, pop);
                    var words = stack[0];
                    for (var w = 1u; w < WORDS; w += 1u) {
                        words = select(words, stack[w], top / LANES == w);
                    }
                    let popped = subgroupShuffle(words, top & (LANES - 1u));
                    base = select(base, popped & 0xffffffu, pop);
                    pending = select(pending, popped >> 24u, pop);
                    if leaves != 0u || pending == 0u || left == 0u {
                        break;
                    }
                }
                more = leaves != 0u || pending != 0u;
            }
            if more {
                break;
            }

#if VISIBILITY
            for (var r = 0u; r < RAYS; r += 1u) {
                seen[r] += (alive >> r) & 1u;
            }
#else
            let clip2 = clip2_of(flags);
            for (var r = 0u; r < RAYS; r += 1u) {
                let r2 = dot(d[r], d[r]);
                let wi = -d[r] / sqrt(max(r2, 1e-37));
                let cos_light = -dot(wi, l_normal.xyz);
                let intensity = plain_intensity(l_normal, l_emit, flags, cos_light);
                let factor = dot(wi, shading[r]) * inverse_square(r2, clip2);
                sum[r] += intensity * select(0.0, factor, ((alive >> r) & 1u) != 0u);
            }
            // Specular lobes, of the light or of receivers, are rarer: ray by ray.
            for (var rest = alive & select(glossy, present, (flags & LIGHT_GLOSSY) != 0u); rest != 0u; rest &= rest - 1u) {
                let ray = firstTrailingBit(rest);
                let extra = add_lobes(place, list[begin + ray * LANES + lane], clip2);
                for (var r = 0u; r < RAYS; r += 1u) {
                    sum[r] += select(vec3<f32>(0.0), extra, r == ray);
                }
            }
#endif
            todo &= todo - 1u;
        }
#if VISIBILITY
#else
        for (var r = select(RAYS, 0u, kind == 0u); r < RAYS; r += 1u) {
            if ((present >> r) & 1u) != 0u {
                direct[pixel[r]] = vec4<f32>(sum[r], 0.0);
            }
        }
        for (var r = select(0u, RAYS, kind == 0u); r < RAYS; r += 1u) {
            if ((present >> r) & 1u) != 0u {
                indirect[pixel[r]] = vec4<f32>(sum[r], 0.0);
            }
        }
#endif
    }
#if COUNTERS
    // All lanes count the same, but for their rays.
    for (var i = 0u; i < 6u; i += 1u) {
        atomicAdd(&counters[i], select(0u, met[i], i == 1u || lane == 0u));
    }
#endif
    let reached = select(step.first + firstTrailingBit(todo), step.end, todo == 0u);
#if VISIBILITY
    for (var r = 0u; r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            visible[pixel[r]] = seen[r];
        }
    }
#endif
    // Receivers stand at no light (pass::shade::NO_LIGHT_LEFT) unless something is left to do.
    for (var r = select(RAYS, 0u, reached < step.end || step.round > 0u); r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            progress[pixel[r]] = vec2<u32>(reached, 0u);
        }
    }
    if reached < step.end {
        atomicAdd(&work.unfinished, countOneBits(present));
    }
}
