// As shade.wgsl, for 64 receivers at once: a subgroup walks the tree for a whole cluster and one light.
// See pass/shade.rs.
// VISIBILITY: only counts the lights that each receiver sees. See pass/visibility.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "lights.wgsl"
#include "receiver.wgsl"

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
#else
@group(0) @binding(16) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> specular: array<vec4<f32>>;
#endif
var<immediate> push: Push;

// Lanes of the subgroup, and rays that each lane holds: 64 together.
#if LANES16
const LANES: u32 = 16u;
const RAYS: u32 = 4u;
#else
const LANES: u32 = 8u;
const RAYS: u32 = 8u;
#endif
// Entries of the stack; the host takes this kernel only where the tree needs no more (accel::wide::WideBvh::stack_bound).
const STACK: u32 = 128u;

// Reductions by shuffles between fixed lanes: on a driver that runs lanes as one vector each is a single instruction.
fn or_reduce(x: u32) -> u32 {
    var y = x;
    y |= subgroupShuffleXor(y, 1u);
    y |= subgroupShuffleXor(y, 2u);
    y |= subgroupShuffleXor(y, 4u);
#if LANES16
    y |= subgroupShuffleXor(y, 8u);
#endif
    return y;
}

fn min_reduce(x: vec3<f32>) -> vec3<f32> {
    var y = x;
    y = min(y, subgroupShuffleXor(y, 1u));
    y = min(y, subgroupShuffleXor(y, 2u));
    y = min(y, subgroupShuffleXor(y, 4u));
#if LANES16
    y = min(y, subgroupShuffleXor(y, 8u));
#endif
    return y;
}

// The interval of rays in a shaft: of d on each axis, from the light at the origin.
struct Shaft {
    positive: vec3<bool>,   // all d above 0
    inverse_lo: vec3<f32>,  // 1 / the interval's ends; 0 on an axis whose interval spans 0, which bounds no t
    inverse_hi: vec3<f32>,
    unbounded: vec3<f32>,   // huge on such an axis, else 0
    lo: vec3<f32>,          // the box of the light and all receivers
    hi: vec3<f32>,
}

// Whether any point t d, 0 <= t <= 1, of the shaft may lie in a box. Says yes rather too often.
fn shaft_meets(shaft: Shaft, lo: vec3<f32>, hi: vec3<f32>) -> bool {
    let near_side = select(hi, lo, shaft.positive);
    let far_side = select(lo, hi, shaft.positive);
    let enter = min(near_side * shaft.inverse_lo, near_side * shaft.inverse_hi);
    let exit = max(far_side * shaft.inverse_lo, far_side * shaft.inverse_hi) + shaft.unbounded;
    let t_near = max(max(enter.x, enter.y), max(enter.z, 0.0));
    let t_far = min(min(exit.x, exit.y), min(exit.z, 1.0)) * 1.000002;
    return all(lo <= shaft.hi) && all(hi >= shaft.lo) && t_near <= t_far;
}

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
    let spot = clamp(cos_light * l.normal.w + l.emit.w, 0.0, 1.0);
    let plain = l.emit.xyz * (select(1.0, max(cos_light, 0.0), (flags & LIGHT_SURFACE) != 0u) * spot * spot);
    let light_lobe = Reflectance(vec3<f32>(0.0), l.flux.w, l.f0.xyz, l.wi.w);
    let shiny = (flags & LIGHT_GLOSSY) != 0u && cos_light > 0.0;
    let extra = select(vec3<f32>(0.0), l.flux.xyz * eval_specular(light_lobe, l.normal.xyz, l.wi.xyz, -wi) * cos_light, shiny);
    let factor = max(dot(wi, shading.xyz), 0.0) * (1.0 / max(max(r2, clip2), 1e-37));
    let lobe = Reflectance(vec3<f32>(0.0), geometric.w, f0.xyz, shading.w);
    let reflected = eval_specular(lobe, shading.xyz, receiver_wo[p].xyz, wi);
    specular[p] += vec4<f32>(select(vec3<f32>(0.0), (plain + extra) * factor * reflected, f0.w > 0.0), 0.0);
    return extra * factor;
}
#endif

#if LANES16
@compute @workgroup_size(16)
#else
@compute @workgroup_size(8)
#endif
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let step = steps[push.step];
    let live = atomicLoad(&work.live);
    let cluster = spread_group(group, groups);
    if cluster * 64u >= live {
        return;
    }
    // A cluster goes on with the light that it did not finish, from the start; all its receivers stand at the same one.
    let start = select(step.first, progress[list[cluster * 64u]].x, step.round > 0u);
    if start >= step.end {
        return;
    }
    let fresh = step.fresh == 1u && step.round == 0u;

    var position: array<vec3<f32>, RAYS>;
    var geometric: array<vec3<f32>, RAYS>;
    var pixel: array<u32, RAYS>;
    var present = 0u;
#if VISIBILITY
    var seen: array<u32, RAYS>;
#else
    var shading: array<vec3<f32>, RAYS>;
    var sum: array<vec3<f32>, RAYS>;
    var glossy = 0u;
    // The lights of a chunk have equally many reflections behind them.
    let first_bounce = lights[step.first].f0.w == 0.0;
#endif
    for (var r = 0u; r < RAYS; r += 1u) {
        let slot = cluster * 64u + r * LANES + lane;
        let p = list[min(slot, live - 1u)];
        pixel[r] = p;
        position[r] = receiver_position[p].xyz;
        geometric[r] = receiver_geometric[p].xyz;
        present |= select(0u, 1u << r, slot < live);
#if VISIBILITY
        seen[r] = select(visible[p], 0u, fresh);
#else
        shading[r] = receiver_shading[p].xyz;
        glossy |= select(0u, 1u << r, slot < live && receiver_f0[p].w > 0.0);
        if fresh && slot < live {
            direct[p] = vec4<f32>(0.0);
            indirect[p] = vec4<f32>(0.0);
            specular[p] = vec4<f32>(0.0);
        }
        sum[r] = select(indirect[p].xyz, direct[p].xyz, first_bounce) * select(1.0, 0.0, fresh);
#endif
    }

    // Every visit takes from one budget. What is left when it is spent is carried on by the kernel for single rays.
    var left = step.steps;
    var light = start;
    while light < step.end && left > 0u {
        let l_position = lights[light].position;
        let origin = l_position.xyz;
#if VISIBILITY
#else
        let l_normal = lights[light].normal;
        let l_emit = lights[light].emit;
        let flags = bitcast<u32>(l_position.w);
        let surface = (flags & LIGHT_SURFACE) != 0u;
        let dark = mean3(l_emit.xyz) <= 0.0 && ((flags & LIGHT_GLOSSY) == 0u || mean3(lights[light].flux.xyz) <= 0.0);
#endif

        // Rays run from the light (t = 0) to the receivers (t = 1).
        var d: array<vec3<f32>, RAYS>;
        var inverse: array<vec3<f32>, RAYS>;
        var alive = 0u;
        var lo = vec3<f32>(3.0e38);
        var hi = vec3<f32>(-3.0e38);
        for (var r = 0u; r < RAYS; r += 1u) {
            d[r] = position[r] - origin;
#if VISIBILITY
            let lit = dot(d[r], geometric[r]) < 0.0 && ((present >> r) & 1u) != 0u;
#else
            let faces = dot(d[r], geometric[r]) < 0.0 && dot(d[r], shading[r]) < 0.0;
            let reaches = !surface || dot(d[r], l_normal.xyz) > 0.0;
            let lit = faces && reaches && !dark && ((present >> r) & 1u) != 0u;
#endif
            alive |= select(0u, 1u << r, lit);
            lo = select(lo, min(lo, d[r]), lit);
            hi = select(hi, max(hi, d[r]), lit);
            let tiny = vec3<f32>(1e-30);
            inverse[r] = 1.0 / select(d[r], select(tiny, -tiny, d[r] < vec3<f32>(0.0)), abs(d[r]) < tiny);
        }
        lo = min_reduce(lo);
        hi = -min_reduce(-hi);
        let positive = lo > vec3<f32>(0.0);
        let bounded = positive | (hi < vec3<f32>(0.0));
        var shaft: Shaft;
        shaft.positive = positive;
        shaft.inverse_lo = select(vec3<f32>(0.0), 1.0 / lo, bounded);
        shaft.inverse_hi = select(vec3<f32>(0.0), 1.0 / hi, bounded);
        shaft.unbounded = select(vec3<f32>(3.0e38), vec3<f32>(0.0), bounded);
        shaft.lo = min(lo, vec3<f32>(0.0));
        shaft.hi = max(hi, vec3<f32>(0.0));

        // A word of the stack: children of one node that are still to be visited, as the first child's node and, from bit 24,
        // a mask. Lane i holds word i (of the upper eight: word 8 + i).
        var low = 0u;
        var high = 0u;
        var top = 0u;
        var base = 0u;
        var pending = select(0u, 1u, or_reduce(alive) != 0u);
        while pending != 0u && left > 0u {
            var leaves = 0u;
            var child = 0u;
            loop {
                left = max(left, 1u) - 1u;
                let node = base + firstTrailingBit(pending);
                let rest = pending & (pending - 1u);
                let push = rest != 0u;
                let word = base | (rest << 24u);
                low = select(low, word, push && lane == top);
                high = select(high, word, push && lane + 8u == top);
                top += select(0u, 1u, push);

                let a = wide_nodes[16u * node + 2u * (lane & 7u)];
                let b = wide_nodes[16u * node + 2u * (lane & 7u) + 1u];
                let box_lo = a.xyz - origin;
                let box_hi = b.xyz - origin;
                child = bitcast<u32>(a.w) | (bitcast<u32>(b.w) << 28u);
                var survivors = or_reduce(select(0u, 1u << (lane & 7u), shaft_meets(shaft, box_lo, box_hi)));
                var met_by = 0u;
                loop {
                    left = max(left, 1u) - 1u;
                    let k = firstTrailingBit(survivors) & 7u;
                    let k_lo = subgroupShuffle(box_lo, k);
                    let k_hi = subgroupShuffle(box_hi, k);
                    var met = 0u;
                    for (var r = 0u; r < RAYS; r += 1u) {
                        let t0 = bitcast<vec3<i32>>(k_lo * inverse[r]);
                        let t1 = bitcast<vec3<i32>>(k_hi * inverse[r]);
                        let near3 = min(t0, t1);
                        let far3 = max(t0, t1);
                        let near = bitcast<f32>(max(max(near3.x, near3.y), max(near3.z, 0)));
                        let far = bitcast<f32>(min(min(far3.x, far3.y), min(far3.z, 0x3f800000))) * 1.000001;
                        met |= select(0u, 1u << r, near <= far);
                    }
                    met_by |= select(0u, (survivors & (~survivors + 1u)), (met & alive) != 0u);
                    survivors &= survivors - 1u;
                    if survivors == 0u {
                        break;
                    }
                }
                met_by = or_reduce(met_by);
                let is_leaf = or_reduce(select(0u, 1u << (lane & 7u), child >= 0x10000000u));
                leaves = met_by & is_leaf;
                pending = met_by & ~is_leaf;
                base = subgroupShuffle(child, 0u);
                let pop = pending == 0u && top > 0u;
                top -= select(0u, 1u, pop);
                let popped = subgroupShuffle(select(low, high, top >= 8u), top & 7u);
                base = select(base, popped & 0xffffffu, pop);
                pending = select(pending, popped >> 24u, pop);
                if leaves != 0u || pending == 0u || left == 0u {
                    break;
                }
            }
            // Leaves: lane k sets up triangle k; those in the shaft are tested against the rays.
            loop {
                left = max(left, 1u) - 1u;
                let entry = subgroupShuffle(child, firstTrailingBit(leaves) & 7u);
                let count = select(0u, entry >> 28u, leaves != 0u);
                leaves &= leaves - 1u;
                let index = entry & 0x0fffffffu;
                let i = index + min(lane & 7u, max(count, 1u) - 1u);
                let a = triangle_v0[i].xyz - origin;
                let e1 = triangle_e1[i].xyz;
                let e2 = triangle_e2[i].xyz;
                let b = a + e1;
                let c = a + e2;
                // Planes through the light and each edge, formed from differences: products of far corners would lose
                // the depth of small triangles. All turned so that a ray inside has positive products.
                let face = cross(e1, e2);
                let depth = dot(face, a);
                let side = select(1.0, -1.0, depth < 0.0);
                let m0 = side * cross(e1 - e2, b + c);
                let m1 = side * cross(e2, c + a);
                let m2 = side * cross(-e1, a + b);
                // The slack of a single ray's test.
                let slack = 1e-5 * (m0 + m1 + m2);
                let n0 = m0 + slack;
                let n1 = m1 + slack;
                let n2 = m2 + slack;
                let in_shaft = shaft_meets(shaft, min(a, min(b, c)), max(a, max(b, c)));
                let takes_part = in_shaft && (lane & 7u) < count && depth != 0.0;
                var survivors = or_reduce(select(0u, 1u << (lane & 7u), takes_part));
                loop {
                    left = max(left, 1u) - 1u;
                    let k = firstTrailingBit(survivors) & 7u;
                    let any = survivors != 0u;
                    survivors &= survivors - 1u;
                    let k_n0 = subgroupShuffle(n0, k);
                    let k_n1 = subgroupShuffle(n1, k);
                    let k_n2 = subgroupShuffle(n2, k);
                    let k_face = subgroupShuffle(side * face, k);
                    let k_depth = select(3.0e38, subgroupShuffle(side * depth, k), any);
                    for (var r = 0u; r < RAYS; r += 1u) {
                        let b0 = dot(k_n0, d[r]);
                        let b1 = dot(k_n1, d[r]);
                        let b2 = dot(k_n2, d[r]);
                        let blocked = b0 >= 0.0 && b1 >= 0.0 && b2 >= 0.0 && dot(k_face, d[r]) > k_depth;
                        alive &= ~select(0u, 1u << r, blocked);
                    }
                    if survivors == 0u {
                        break;
                    }
                }
                let dead = or_reduce(alive) == 0u;
                pending = select(pending, 0u, dead);
                top = select(top, 0u, dead);
                leaves = select(leaves, 0u, dead);
                if leaves == 0u {
                    break;
                }
            }
        }
        top = select(0u, 1u, pending != 0u);
        if top > 0u {
            break;
        }

#if VISIBILITY
        for (var r = 0u; r < RAYS; r += 1u) {
            seen[r] += (alive >> r) & 1u;
        }
#else
        let clip2 = select(0.0, frame.right.w, (flags & LIGHT_CLIPPED) != 0u);
        for (var r = 0u; r < RAYS; r += 1u) {
            let r2 = dot(d[r], d[r]);
            let wi = -d[r] / sqrt(max(r2, 1e-37));
            let cos_light = -dot(wi, l_normal.xyz);
            let spot = clamp(cos_light * l_normal.w + l_emit.w, 0.0, 1.0);
            let intensity = l_emit.xyz * (select(1.0, max(cos_light, 0.0), surface) * spot * spot);
            let factor = dot(wi, shading[r]) * (1.0 / max(max(r2, clip2), 1e-37));
            sum[r] += intensity * select(0.0, factor, ((alive >> r) & 1u) != 0u);
        }
        // Specular lobes, of the light or of receivers, are rarer: ray by ray.
        for (var rest = alive & select(glossy, present, (flags & LIGHT_GLOSSY) != 0u); rest != 0u; rest &= rest - 1u) {
            let ray = firstTrailingBit(rest);
            let extra = add_lobes(light, list[cluster * 64u + ray * LANES + lane], clip2);
            for (var r = 0u; r < RAYS; r += 1u) {
                sum[r] += select(vec3<f32>(0.0), extra, r == ray);
            }
        }
#endif
        light += 1u;
    }
    for (var r = 0u; r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            let p = pixel[r];
#if VISIBILITY
            visible[p] = seen[r];
#else
            if first_bounce {
                direct[p] = vec4<f32>(sum[r], 0.0);
            } else {
                indirect[p] = vec4<f32>(sum[r], 0.0);
            }
#endif
            progress[p] = vec2<u32>(light, 0u);
            if light < step.end {
                atomicAdd(&work.unfinished, 1u);
            }
        }
    }
}
