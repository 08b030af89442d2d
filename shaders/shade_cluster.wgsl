// As shade.wgsl, for 64 receivers at once: a subgroup walks the tree for a whole cluster and one light.
// See pass/shade.rs.
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
@group(0) @binding(8) var<storage, read> receiver_shading: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> receiver_f0: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> receiver_wo: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> lights: array<PointLight>;
@group(0) @binding(12) var<storage, read> list: array<u32>;
@group(0) @binding(13) var<storage, read_write> work: Work;
@group(0) @binding(14) var<storage, read> steps: array<Step>;
@group(0) @binding(15) var<storage, read_write> progress: array<vec2<u32>>;
@group(0) @binding(16) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> specular: array<vec4<f32>>;
var<immediate> push: Push;

const LANES: u32 = 8u;
const RAYS: u32 = 8u;           // for each lane; LANES * RAYS = 64
const STACK: u32 = 128u;

fn or_reduce(x: u32) -> u32 {
    var y = x;
    y |= subgroupShuffleXor(y, 1u);
    y |= subgroupShuffleXor(y, 2u);
    y |= subgroupShuffleXor(y, 4u);
    return y;
}

fn min_reduce(x: vec3<f32>) -> vec3<f32> {
    var y = x;
    y = min(y, subgroupShuffleXor(y, 1u));
    y = min(y, subgroupShuffleXor(y, 2u));
    y = min(y, subgroupShuffleXor(y, 4u));
    return y;
}

// Adds what a visible light gives to a receiver by way of specular lobes: all of it that the diffuse sums leave out.
fn add_lobes(light: u32, p: u32, clip2: f32) {
    let l = lights[light];
    let position = receiver_position[p].xyz;
    let geometric = receiver_geometric[p];
    let shading = receiver_shading[p];
    let f0 = receiver_f0[p];
    let flags = bitcast<u32>(l.position.w);
    let d = l.position.xyz - position;
    let r2 = max(dot(d, d), 1e-37);
    let wi = d / sqrt(r2);
    let cos_light = -dot(wi, l.normal.xyz);
    let cos_receiver = max(dot(wi, shading.xyz), 0.0);
    let spot = clamp(cos_light * l.normal.w + l.emit.w, 0.0, 1.0);
    let plain = l.emit.xyz * (select(1.0, max(cos_light, 0.0), (flags & LIGHT_SURFACE) != 0u) * spot * spot);
    let light_lobe = Reflectance(vec3<f32>(0.0), l.flux.w, l.f0.xyz, l.wi.w);
    let shiny = (flags & LIGHT_GLOSSY) != 0u && cos_light > 0.0;
    let extra = select(vec3<f32>(0.0), l.flux.xyz * eval_specular(light_lobe, l.normal.xyz, l.wi.xyz, -wi) * cos_light, shiny);
    let falloff = cos_receiver / max(r2, clip2);
    indirect[p] += vec4<f32>(extra * falloff, 0.0);
    let lobe = Reflectance(vec3<f32>(0.0), geometric.w, f0.xyz, shading.w);
    let reflected = eval_specular(lobe, shading.xyz, receiver_wo[p].xyz, wi);
    specular[p] += vec4<f32>(select(vec3<f32>(0.0), (plain + extra) * falloff * reflected, f0.w > 0.0), 0.0);
}

@compute @workgroup_size(8)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(subgroup_invocation_id) lane: u32) {
    let step = steps[push.step];
    let live = atomicLoad(&work.live);
    let cluster = spread_group(group, groups);
    if cluster * 64u >= live {
        return;
    }

    var position: array<vec3<f32>, 8>;
    var geometric: array<vec3<f32>, 8>;
    var shading: array<vec3<f32>, 8>;
    var pixel: array<u32, 8>;
    var sum: array<vec3<f32>, 8>;
    var present = 0u;
    var glossy = 0u;
    for (var r = 0u; r < RAYS; r += 1u) {
        let slot = cluster * 64u + r * LANES + lane;
        pixel[r] = list[min(slot, live - 1u)];
        present |= select(0u, 1u << r, slot < live);
        position[r] = receiver_position[pixel[r]].xyz;
        geometric[r] = receiver_geometric[pixel[r]].xyz;
        shading[r] = receiver_shading[pixel[r]].xyz;
        glossy |= select(0u, 1u << r, receiver_f0[pixel[r]].w > 0.0);
        if step.fresh == 1u && slot < live {
            direct[pixel[r]] = vec4<f32>(0.0);
            indirect[pixel[r]] = vec4<f32>(0.0);
            specular[pixel[r]] = vec4<f32>(0.0);
        }
    }

    var stack: array<u32, 128>;
    // Every loop below takes from one budget; what is left when it ends is carried on by the kernel for single rays.
    var left = 50000u;
    var light = step.first;
    while light < step.end && left > 0u {
        let l_position = lights[light].position;
        let l_normal = lights[light].normal;
        let l_emit = lights[light].emit;
        let flags = bitcast<u32>(l_position.w);
        let surface = (flags & LIGHT_SURFACE) != 0u;
        let origin = l_position.xyz;
        let dark = mean3(l_emit.xyz) <= 0.0 && (flags & LIGHT_GLOSSY) == 0u;

        var d: array<vec3<f32>, 8>;
        var inverse: array<vec3<f32>, 8>;
        var alive = 0u;
        var lo = vec3<f32>(3.0e38);
        var hi = vec3<f32>(-3.0e38);
        for (var r = 0u; r < RAYS; r += 1u) {
            d[r] = position[r] - origin;
            let cos_light = dot(d[r], l_normal.xyz);
            let faces = dot(d[r], geometric[r]) < 0.0 && (cos_light > 0.0 || !surface);
            let lit = faces && !dark && ((present >> r) & 1u) != 0u;
            alive |= select(0u, 1u << r, lit);
            lo = select(lo, min(lo, d[r]), lit);
            hi = select(hi, max(hi, d[r]), lit);
            let tiny = vec3<f32>(1e-30);
            inverse[r] = 1.0 / select(d[r], select(tiny, -tiny, d[r] < vec3<f32>(0.0)), abs(d[r]) < tiny);
        }
        lo = min_reduce(lo);
        hi = -min_reduce(-hi);
        let began = alive;
        // The shaft: interval of d for each axis. Where it spans 0 the axis gives no bound on t.
        let positive = lo > vec3<f32>(0.0);
        let bounded = positive | (hi < vec3<f32>(0.0));
        let i_lo = select(vec3<f32>(0.0), 1.0 / lo, bounded);
        let i_hi = select(vec3<f32>(0.0), 1.0 / hi, bounded);
        let unbounded = select(vec3<f32>(3.0e38), vec3<f32>(0.0), bounded);
        // All rays run in the box of the light and the receivers.
        let all_lo = min(lo, vec3<f32>(0.0));
        let all_hi = max(hi, vec3<f32>(0.0));

        var top = 0u;
        let any_alive = or_reduce(alive);
        stack[0] = 0u;
        top = select(0u, 1u, any_alive != 0u);
        while top > 0u && left > 0u {
            left -= 1u;
            top -= 1u;
            let entry = stack[top];
            let count = entry >> 28u;
            let index = entry & 0x0fffffffu;
            // An inner node: eight boxes against the shaft, the survivors against the rays.
            for (var inner = select(0u, 1u, count == 0u); inner > 0u; inner -= 1u) {
                let a = wide_nodes[16u * index + 2u * (lane & 7u)];
                let b = wide_nodes[16u * index + 2u * (lane & 7u) + 1u];
                let box_lo = a.xyz - origin;
                let box_hi = b.xyz - origin;
                let near_side = select(box_hi, box_lo, positive);
                let far_side = select(box_lo, box_hi, positive);
                let enter = min(near_side * i_lo, near_side * i_hi);
                let exit = max(far_side * i_lo, far_side * i_hi) + unbounded;
                let t_near = max(max(enter.x, enter.y), max(enter.z, 0.0));
                let t_far = min(min(exit.x, exit.y), min(exit.z, 1.0)) * 1.000002;
                let overlaps = all(box_lo <= all_hi) && all(box_hi >= all_lo);
                let child = bitcast<u32>(a.w) | (bitcast<u32>(b.w) << 28u);
                var survivors = or_reduce(select(0u, 1u << lane, overlaps && t_near <= t_far));
                while survivors != 0u {
                    left = max(left, 1u) - 1u;
                    let k = firstTrailingBit(survivors);
                    survivors &= survivors - 1u;
                    let k_lo = subgroupShuffle(box_lo, k);
                    let k_hi = subgroupShuffle(box_hi, k);
                    let k_child = subgroupShuffle(child, k);
                    var met = 0u;
                    for (var r = 0u; r < RAYS; r += 1u) {
                        let t0 = k_lo * inverse[r];
                        let t1 = k_hi * inverse[r];
                        let n3 = min(t0, t1);
                        let f3 = max(t0, t1);
                        let n = max(max(n3.x, n3.y), max(n3.z, 0.0));
                        let f = min(min(f3.x, f3.y), min(f3.z, 1.0)) * 1.000001;
                        met |= select(0u, 1u << r, n <= f);
                    }
                    let push_it = or_reduce(met & alive) != 0u;
                    stack[top] = k_child;
                    top += select(0u, 1u, push_it);
                }
            }
            // A leaf: eight triangles set up at once, each tested against the rays.
            for (var leaf = select(0u, 1u, count != 0u); leaf > 0u; leaf -= 1u) {
                let i = index + min(lane, count - 1u);
                let a = triangle_v0[i].xyz - origin;
                let e1 = triangle_e1[i].xyz;
                let e2 = triangle_e2[i].xyz;
                let b = a + e1;
                let c = a + e2;
                // Edge planes through the light, formed from differences; the third from the face's plane.
                var n0 = cross(e1 - e2, b + c);
                var n1 = cross(e2, c + a);
                var n2 = cross(-e1, a + b);
                var face = cross(e1, e2);
                var depth = dot(face, a);
                let flip = select(1.0, -1.0, depth < 0.0);
                n0 *= flip;
                n1 *= flip;
                n2 *= flip;
                face *= flip;
                depth *= flip;
                let tri_lo = min(a, min(b, c));
                let tri_hi = max(a, max(b, c));
                let near_side = select(tri_hi, tri_lo, positive);
                let far_side = select(tri_lo, tri_hi, positive);
                let enter = min(near_side * i_lo, near_side * i_hi);
                let exit = max(far_side * i_lo, far_side * i_hi) + unbounded;
                let t_near = max(max(enter.x, enter.y), max(enter.z, 0.0));
                let t_far = min(min(exit.x, exit.y), min(exit.z, 1.0)) * 1.000002;
                let overlaps = all(tri_lo <= all_hi) && all(tri_hi >= all_lo) && lane < count && depth > 0.0;
                var survivors = or_reduce(select(0u, 1u << lane, overlaps && t_near <= t_far));
                while survivors != 0u {
                    left = max(left, 1u) - 1u;
                    let k = firstTrailingBit(survivors);
                    survivors &= survivors - 1u;
                    let k0 = subgroupShuffle(n0, k);
                    let k1 = subgroupShuffle(n1, k);
                    let k2 = subgroupShuffle(n2, k);
                    let kn = subgroupShuffle(face, k);
                    let kd = subgroupShuffle(depth, k);
                    for (var r = 0u; r < RAYS; r += 1u) {
                        let inside = min(dot(k0, d[r]), min(dot(k1, d[r]), dot(k2, d[r]))) >= 0.0;
                        let blocked = inside && dot(kn, d[r]) > kd;
                        alive &= ~select(0u, 1u << r, blocked);
                    }
                }
                top = select(0u, top, or_reduce(alive) != 0u);
            }
        }
        if top > 0u {
            break;
        }

        let clip2 = select(0.0, frame.right.w, (flags & LIGHT_CLIPPED) != 0u);
        for (var r = 0u; r < RAYS; r += 1u) {
            let r2 = dot(d[r], d[r]);
            let inverse_length = 1.0 / sqrt(max(r2, 1e-37));
            let cos_light = dot(d[r], l_normal.xyz) * inverse_length;
            let cos_receiver = max(-dot(d[r], shading[r]) * inverse_length, 0.0);
            let spot = clamp(cos_light * l_normal.w + l_emit.w, 0.0, 1.0);
            let intensity = l_emit.xyz * (select(1.0, max(cos_light, 0.0), surface) * spot * spot);
            let visible = ((alive >> r) & 1u) != 0u && r2 > 0.0;
            sum[r] += intensity * select(0.0, cos_receiver / max(max(r2, clip2), 1e-37), visible);
        }
        // Specular lobes, of the light or of receivers, are rare: ray by ray, straight to memory.
        let lobes = alive & select(glossy, present, (flags & LIGHT_GLOSSY) != 0u);
        for (var rest = lobes; rest != 0u; rest &= rest - 1u) {
            let p = list[cluster * 64u + firstTrailingBit(rest) * LANES + lane];
            add_lobes(light, p, clip2);
        }
        light += 1u;
    }
    // The lights of a chunk have equally many reflections behind them.
    let first_bounce = lights[step.first].f0.w == 0.0;
    for (var r = 0u; r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            let p = pixel[r];
            direct[p] = vec4<f32>(direct[p].xyz + select(vec3<f32>(0.0), sum[r], first_bounce), 0.0);
            indirect[p] = vec4<f32>(indirect[p].xyz + select(sum[r], vec3<f32>(0.0), first_bounce), 0.0);
            progress[p] = vec2<u32>(light, 0u);
            if light < step.end {
                atomicAdd(&work.unfinished, 1u);
            }
        }
    }
}
