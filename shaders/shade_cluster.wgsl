// As shade.wgsl, for 64 shading points at once: a subgroup walks the tree for a whole cluster and one light.
// See pass/shade.rs.
// ALPHA: some surfaces let light pass; not with VISIBILITY.
// VISIBILITY: only counts the lights visible to each shading point. See pass/visibility.rs.
// COUNTERS: with VISIBILITY, also counts visited nodes and tests.
// AREA: with VISIBILITY, the lights are area lights and each ray goes to its own point of one.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "bsdf.wgsl"
#include "lights.wgsl"
#include "point.wgsl"
#include "triangle.wgsl"
#include "subgroup.wgsl"
#include "cluster_walk.wgsl"
#include "shaft.wgsl"
#if ALPHA
#include "alpha.wgsl"
#endif
#if AREA
#include "area.wgsl"
#endif
#if VISIBILITY
#else
#include "light_at.wgsl"
#include "listed_light.wgsl"
#endif

@group(0) @binding(6) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> point_geometric: array<vec4<f32>>;
#if VISIBILITY
#else
@group(0) @binding(8) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> point_wo: array<vec4<f32>>;
#endif
@group(0) @binding(11) var<storage, read> lights: array<PointLight>;
@group(0) @binding(12) var<storage, read> list: array<u32>;
@group(0) @binding(13) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(14) var<storage, read> steps: array<Step>;
@group(0) @binding(15) var<storage, read_write> progress: array<vec2<u32>>;
#if VISIBILITY
@group(0) @binding(16) var<storage, read_write> visible: array<u32>;
#if COUNTERS
// Pairs of a cluster and a light; their rays; tested nodes, children, leaves and triangles.
@group(0) @binding(17) var<storage, read_write> counters: array<atomic<u32>, 6>;
#endif
#else
@group(0) @binding(16) var<storage, read_write> direct: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> indirect: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> specular: array<vec4<f32>>;
// Of each class its first cluster and first shading point; if the list is in screen order, of each cluster its class.
@group(0) @binding(19) var<storage, read> classes: array<vec2<u32>>;
// The first light of each shading point; the same for all of a cluster.
@group(0) @binding(20) var<storage, read> first_light: array<u32>;
@group(0) @binding(29) var<storage, read> listed_lights: array<vec2<u32>>;
#endif
var<immediate> push: Push;

#if VISIBILITY
#else
// Light from a visible light through specular lobes: returns the irradiance by the light's own lobe, and adds the radiance that
// the shading point's lobe reflects to `specular`. `passes`: share of the light that the surfaces on its way let pass.
fn add_lobes(light: u32, p: u32, clip2: f32, passes: f32) -> vec3<f32> {
    let l = listed_light(light);
    let geometric = point_geometric[p];
    let shading = point_shading[p];
    let f0 = point_f0[p];
    let wo = point_wo[p];
    let flags = bitcast<u32>(l.position.w);
    let d = l.position.xyz - point_position[p].xyz;
    let r2 = dot(d, d);
    let wi = d / sqrt(max(r2, 1e-37));
    let cos_light = -dot(wi, l.normal.xyz);
    let plain = plain_intensity(l.normal, l.emit, flags, cos_light);
    let extra = lobe_intensity(l, wi, cos_light);
    let cosine = max(dot(wi, shading.xyz), 0.0);
    let falloff = inverse_square(r2, clip2);
    let divided = highlight_falloff(l.f0, l.wi, flags, r2, cos_light, lobe_density(shading.w, shading.xyz, wo.xyz, wi));
    let splats = has_flag(wo.w, SPLATS);
    let own = select(falloff, inverse_square(r2, SPLAT_CLIP * clip2), splats);
    let factor = passes * cosine * select(own, divided, has_flag(wo.w, LOBE_SAMPLED));
    let shows = has_flag(wo.w, GLOSSY) && (l.f0.w == 0.0 || !splats);
    let reflected = eval_specular(point_lobe(geometric, shading, f0), shading.xyz, wo.xyz, wi);
    specular[p] += vec4<f32>(select(vec3<f32>(0.0), (plain + extra) * factor * reflected, shows), 0.0);
    return extra * (passes * cosine * falloff);
}
#endif

// Maximum of n . d over n and d in boxes.
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
    let lights_at = 0u;
#else
    // A cluster takes shading points of one class of pixels, which has lights of its own.
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
#endif
    if begin >= end {
        return;
    }
    var slot: array<u32, RAYS>;
    var present = 0u;
    // Slots without a shading point, and slots beyond the last, repeat another shading point and take no part.
    var some = NO_POINT;
    for (var r = 0u; r < RAYS; r += 1u) {
        let place = begin + r * LANES + lane;
        slot[r] = select(NO_POINT, list[min(place, end - 1u)], place < end);
        present |= select(0u, 1u << r, slot[r] != NO_POINT);
        some = min(some, slot[r]);
    }
    some = min_reduce_u32(some);
#if VISIBILITY
#else
    let lights_at = first_light[some];
#endif
    // A cluster starts again with the light that it did not finish; all its shading points have the same progress.
    let start = select(step.first, progress[some].x, step.round > 0u);
    if start >= step.end {
        return;
    }
    let clears = step.clears == 1u && step.round == 0u;

    var position: array<vec3<f32>, RAYS>;
    var geometric: array<vec3<f32>, RAYS>;
#if VISIBILITY
    var seen: array<u32, RAYS>;
#else
    var shading: array<vec3<f32>, RAYS>;
    var sum: array<vec3<f32>, RAYS>;
    var glossy = 0u;
    var soft = 0u;
    // Segments of the eye paths to them, four bits each.
    var used = vec2<u32>(0u);
#endif
    var lo = vec3<f32>(3.0e38);
    var hi = vec3<f32>(-3.0e38);
    var geometric_lo = vec3<f32>(1.0);
    var geometric_hi = vec3<f32>(-1.0);
    var shading_lo = vec3<f32>(1.0);
    var shading_hi = vec3<f32>(-1.0);
    for (var r = 0u; r < RAYS; r += 1u) {
        let p = select(slot[r], some, slot[r] == NO_POINT);
        slot[r] = p;
        position[r] = point_position[p].xyz;
        geometric[r] = point_geometric[p].xyz;
        lo = min(lo, position[r]);
        hi = max(hi, position[r]);
        geometric_lo = min(geometric_lo, geometric[r]);
        geometric_hi = max(geometric_hi, geometric[r]);
#if VISIBILITY
        seen[r] = select(visible[p], 0u, clears);
#else
        shading[r] = point_shading[p].xyz;
        shading_lo = min(shading_lo, shading[r]);
        shading_hi = max(shading_hi, shading[r]);
        let word = point_wo[p].w;
        glossy |= select(0u, 1u << r, has_flag(word, GLOSSY)) & present;
        soft |= select(0u, 1u << r, has_flag(word, SOFT));
        used[r / 8u] |= segments_of(word) << (4u * (r & 7u));
#endif
    }
#if VISIBILITY
#else
    // With a SIMD driver a loop that runs zero times costs less than an `if`, of which all lanes execute both sides.
    for (var r = select(RAYS, 0u, clears); r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            specular[slot[r]] = vec4<f32>(0.0);
        }
    }
#endif
    lo = min_reduce(lo);
    hi = max_reduce(hi);
    geometric_lo = min_reduce(geometric_lo);
    geometric_hi = max_reduce(geometric_hi);

    // Lane k tests whether light k may reach the cluster.
    let count = step.end - step.first;
    var todo = 0u;
#if VISIBILITY
    for (var base = 0u; base < count; base += LANES) {
        let i = base + lane;
#if AREA
        let area = area_light(lights[lights_at + step.first + min(i, count - 1u)]);
        let d_lo = area.centre - area.extent - hi;
        let d_hi = area.centre + area.extent - lo;
        let faces = greatest_dot(geometric_lo, geometric_hi, d_lo, d_hi) > 0.0;
#else
        let to_light = lights[lights_at + step.first + min(i, count - 1u)].position.xyz;
        let faces = greatest_dot(geometric_lo, geometric_hi, to_light - hi, to_light - lo) > 0.0;
#endif
        todo |= select(0u, 1u << (i & 31u), faces && i < count && step.first + i >= start);
    }
#else
    shading_lo = min_reduce(shading_lo);
    shading_hi = max_reduce(shading_hi);
    for (var base = 0u; base < count; base += LANES) {
        let i = base + lane;
        let l = listed_light(lights_at + step.first + min(i, count - 1u));
        let d_lo = l.position.xyz - hi;
        let d_hi = l.position.xyz - lo;
        let flags = bitcast<u32>(l.position.w);
        let faces = greatest_dot(geometric_lo, geometric_hi, d_lo, d_hi) > 0.0
            && greatest_dot(shading_lo, shading_hi, d_lo, d_hi) > 0.0;
        let reaches = (flags & LIGHT_SURFACE) == 0u || greatest_dot(l.normal.xyz, l.normal.xyz, -d_hi, -d_lo) > 0.0;
        // Upper bound of the irradiance, at the nearest point of the cluster's box.
        let nearest = max(max(d_lo, -d_hi), vec3<f32>(0.0));
        let greatest = max(l.emit.x, max(l.emit.y, l.emit.z)) / max(max(dot(nearest, nearest), clip2_of(flags)), 1e-37);
        let glossy_light = (flags & LIGHT_GLOSSY) != 0u && mean3(l.flux.xyz) > 0.0;
        let counts = (glossy_light || greatest > frame.pixel_offset.w) && l.f0.w <= f32(step.bounces);
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
    // All visits share one budget. The next round continues the lights that exceed it.
    var left = step.steps;
    var blocker = 0u;
#if VISIBILITY
    let kinds = vec2<u32>(0u, 1u);
#else
    // First the lights of emitters, then those after reflections; the first chunk starts the sums of both.
    let directly = clamp(frame.depths[1].y, step.first, step.end) - step.first;
    let direct_lights = select((1u << (directly & 31u)) - 1u, 0xffffffffu, directly >= 32u);
    let kinds = vec2<u32>(select(0u, 1u, directly == 0u && !clears), select(2u, 1u, directly == count && !clears));
#endif
    for (var kind = kinds.x; kind < kinds.y; kind += 1u) {
#if VISIBILITY
        let of_kind = todo;
#else
        for (var r = 0u; r < RAYS; r += 1u) {
            sum[r] = vec3<f32>(0.0);
        }
        for (var r = select(0u, RAYS, clears); r < RAYS; r += 1u) {
            sum[r] = select(indirect[slot[r]].xyz, direct[slot[r]].xyz, kind == 0u);
        }
        let of_kind = select(~direct_lights, direct_lights, kind == 0u);
#endif
        while (todo & of_kind) != 0u && left > 0u {
            let at_light = lights_at + step.first + firstTrailingBit(todo & of_kind);
#if AREA
            let area = area_light(lights[at_light]);
            let origin = area.centre;
            // Start points of the rays relative to the light's centre, and their moments q x d.
            var q: array<vec3<f32>, RAYS>;
            var moment: array<vec3<f32>, RAYS>;
#else
#if VISIBILITY
            let l_position = lights[at_light].position;
#else
            let listed = listed_lights[at_light];
            let l_position = lights[listed.x].position;
#endif
            let origin = l_position.xyz;
#endif
#if VISIBILITY
#else
            let l_normal = lights[listed.x].normal;
            let l_emit = vec4<f32>(lights[listed.x].emit.xyz * bitcast<f32>(listed.y), lights[listed.x].emit.w);
            let flags = bitcast<u32>(l_position.w);
            let surface = (flags & LIGHT_SURFACE) != 0u;
            let slack = step.bounces - min(u32(lights[listed.x].f0.w), step.bounces);
#endif

            // Rays run from the light (t = 0) to the shading points (t = 1).
            var d: array<vec3<f32>, RAYS>;
            var inverse: array<vec3<f32>, RAYS>;
            var alive = 0u;
#if ALPHA
            // Share of each ray's light that the surfaces on its way let pass.
            var passes: array<f32, RAYS>;
            for (var r = 0u; r < RAYS; r += 1u) {
                passes[r] = 1.0;
            }
#endif
            for (var r = 0u; r < RAYS; r += 1u) {
#if AREA
                let point = area_point(area, slot[r], at_light);
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
                let short = ((used[r / 8u] >> (4u * (r & 7u))) & 15u) <= slack;
                let lit = faces && reaches && short && ((present >> r) & 1u) != 0u;
#endif
                alive |= select(0u, 1u << r, lit);
                inverse[r] = safe_inverse(d[r]);
            }
#if VISIBILITY
#else
            // Of a light whose shadows are convolved, only highlights are shown.
            let apart = select(0u, soft, (flags & LIGHT_SOFT) != 0u);
            alive &= ~apart | glossy;
#endif
#if COUNTERS
            met[0] += 1u;
            met[1] += countOneBits(alive);
#endif
#if AREA
            let shaft = make_shaft(lo - origin, hi - origin, area.extent);
#else
            let shaft = make_shaft(lo - origin, hi - origin);
#endif

            // The root is pending unless no ray is alive.
            var walk: Walk;
            walk.pending = select(0u, 1u, or_reduce(alive) != 0u);
            // The leaf that blocked the last cluster-light pair is tried first: it often blocks this one too.
            var child: array<u32, PARTS>;
            for (var part = 0u; part < PARTS; part += 1u) {
                child[part] = blocker;
            }
            var leaves = select(0u, 1u, walk.pending != 0u && blocker != 0u);
            var more = walk.pending != 0u;
#if ALPHA
            // The walk will meet this leaf again, so that its surfaces that let light pass wait until then.
            var first = true;
            // Each lane holds a leaf with such surfaces: its first triangle, and the mask of those in the shaft. They are looked up when the
            // walk ends or no lane is left. In the walk's loops the code of the look-up took longer than all other code (lavapipe),
            // where it ran and where it did not.
            var waiting = vec2<u32>(0u);
            var waiting_count = 0u;
            loop {
#endif
            while more && left > 0u {
                // Leaves: lane k sets up triangle k; triangles in the shaft are tested against the rays.
                loop {
                    left = max(left, 1u) - 1u;
                    let leaf = firstTrailingBit(leaves) & 7u;
                    let entry = u32_of(&child, leaf);
                    let count = select(0u, entry >> 28u, leaves != 0u);
#if COUNTERS
                    met[4] += select(0u, 1u, leaves != 0u);
#endif
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
                        let triangle = set_up_triangle(index + min(k, max(count, 1u) - 1u), origin);
                        planes[part] = triangle.planes;
                        let in_shaft = shaft_meets(shaft, triangle.lo, triangle.hi);
#if AREA
                        taking_part |= select(0u, 1u << k, in_shaft && k < count);
#else
                        taking_part |= select(0u, 1u << k, in_shaft && k < count && triangle.planes.reach != 0.0);
#endif
                    }
                    var survivors = or_reduce(taking_part);
#if ALPHA
                    lets_pass = or_reduce(lets_pass);
                    var partly = select(survivors & lets_pass, 0u, first);
                    survivors &= ~lets_pass;
#endif
                    loop {
                        left = max(left, 1u) - 1u;
                        let k = firstTrailingBit(survivors) & 7u;
                        let any = survivors != 0u;
#if COUNTERS
                        met[5] += select(0u, 1u, any);
#endif
                        survivors &= survivors - 1u;
                        let k_planes = planes_of(&planes, k);
                        let reach = select(3.0e38, k_planes.reach, any);
                        for (var r = 0u; r < RAYS; r += 1u) {
#if AREA
                            // The planes move to q: (2 edge x q) . d = 2 edge . (q x d).
                            let depth = reach - dot(k_planes.n_sum, q[r]);
                            let side = select(1.0, -1.0, depth < 0.0);
                            let moves = vec3<f32>(dot(k_planes.edge0, moment[r]), dot(k_planes.edge1, moment[r]), 0.0);
                            let b = side * (products(k_planes, d[r]) - moves);
                            let blocked = passes_inside(b) && b.z > abs(depth) && depth != 0.0;
#else
                            let b = products(k_planes, d[r]);
                            let blocked = passes_inside(b) && b.z > reach;
#endif
                            alive &= ~select(0u, 1u << r, blocked);
                        }
                        if survivors == 0u {
                            break;
                        }
                    }
                    let dead = or_reduce(alive) == 0u;
                    blocker = select(blocker, entry, dead);
                    walk.pending = select(walk.pending, 0u, dead);
                    walk.top = select(walk.top, 0u, dead);
                    leaves = select(leaves, 0u, dead);
#if ALPHA
                    let waits = partly != 0u;
                    waiting = select(waiting, vec2<u32>(index, partly), waits && lane == waiting_count);
                    waiting_count = select(waiting_count + select(0u, 1u, waits), 0u, dead);
                    if leaves == 0u || waiting_count == WAITING_LEAVES {
                        break;
                    }
#else
                    if leaves == 0u {
                        break;
                    }
#endif
                }
#if ALPHA
                first = false;
                if waiting_count == WAITING_LEAVES {
                    break;
                }
#endif
                leaves = 0u;
                more = walk.pending != 0u;
                loop {
                    left = max(left, 1u) - 1u;
                    let node = select(0u, walk.base + firstTrailingBit(walk.pending), more);
#if COUNTERS
                    met[2] += select(0u, 1u, more);
#endif
                    push_rest(&walk, walk.pending & (walk.pending - 1u), lane);

                    var box_lo: array<vec3<f32>, PARTS>;
                    var box_hi: array<vec3<f32>, PARTS>;
                    var in_shaft = 0u;
                    var is_leaf = 0u;
                    for (var part = 0u; part < PARTS; part += 1u) {
                        let k = number_of(part, lane);
                        let loaded = load_child(node, k, origin);
                        box_lo[part] = loaded.lo;
                        box_hi[part] = loaded.hi;
                        child[part] = loaded.entry;
                        in_shaft |= select(0u, 1u << k, shaft_meets(shaft, loaded.lo, loaded.hi));
                        is_leaf |= select(0u, 1u << k, is_leaf_entry(loaded.entry));
                    }
                    var survivors = or_reduce(in_shaft);
                    var met_by = 0u;
                    loop {
                        left = max(left, 1u) - 1u;
                        let k = firstTrailingBit(survivors) & 7u;
                        let k_lo = vec3_of(&box_lo, k);
                        let k_hi = vec3_of(&box_hi, k);
#if COUNTERS
                        met[3] += select(0u, 1u, survivors != 0u);
#endif
                        var hits = 0u;
                        for (var r = 0u; r < RAYS; r += 1u) {
#if AREA
                            let meets = slabs_meet((k_lo - q[r]) * inverse[r], (k_hi - q[r]) * inverse[r], 1.0);
#else
                            let meets = slabs_meet(k_lo * inverse[r], k_hi * inverse[r], 1.0);
#endif
                            hits |= select(0u, 1u << r, meets);
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
                    walk.pending = select(0u, met_by & ~leaf_children, more);
                    walk.base = subgroupShuffle(child[0], 0u);
                    _ = pop_if_done(&walk);
                    if leaves != 0u || walk.pending == 0u || left == 0u {
                        break;
                    }
                }
                more = leaves != 0u || walk.pending != 0u;
            }
#if ALPHA
            for (; waiting_count > 0u; waiting_count -= 1u) {
                let first_triangle = subgroupShuffle(waiting.x, waiting_count - 1u);
                for (var partly = subgroupShuffle(waiting.y, waiting_count - 1u); partly != 0u; partly &= partly - 1u) {
                    left = max(left, 1u + ALPHA_VISITS) - 1u - ALPHA_VISITS;
                    let triangle = first_triangle + firstTrailingBit(partly);
                    let planes = set_up_triangle(triangle, origin).planes;
                    var met_rays = 0u;
                    for (var r = 0u; r < RAYS; r += 1u) {
                        let b = products(planes, d[r]);
                        met_rays |= select(0u, 1u << r, passes_inside(b) && b.z > planes.reach);
                    }
                    met_rays &= alive;
                    // Most such surfaces let the same share pass everywhere. With a pattern, the test for single rays tells where each
                    // ray meets the triangle.
                    let even = !is_patterned(triangle);
                    let even_share = 1.0 - coverage_at(triangle, 0.0, 0.0);
                    for (var r = 0u; r < RAYS; r += 1u) {
                        passes[r] *= select(1.0, even_share, even && ((met_rays >> r) & 1u) != 0u);
                    }
                    for (var rest = select(met_rays, 0u, even); rest != 0u; rest &= rest - 1u) {
                        let ray = firstTrailingBit(rest);
                        let at = point_position[list[begin + ray * LANES + lane]].xyz;
                        let hit = intersect_triangle(triangle, at, origin - at, 1.0);
                        let share = select(1.0, 1.0 - coverage_at(triangle, hit.u, hit.v), hit.ok);
                        for (var r = 0u; r < RAYS; r += 1u) {
                            passes[r] *= select(1.0, share, r == ray);
                        }
                    }
                    for (var r = 0u; r < RAYS; r += 1u) {
                        alive &= ~select(0u, 1u << r, passes[r] <= 0.0);
                    }
                }
            }
            more = more && or_reduce(alive) != 0u;
            if !more || left == 0u {
                break;
            }
            }
#endif
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
#if ALPHA
                let factor = dot(wi, shading[r]) * inverse_square(r2, clip2) * passes[r];
#else
                let factor = dot(wi, shading[r]) * inverse_square(r2, clip2);
#endif
                sum[r] += intensity * select(0.0, factor, (((alive & ~apart) >> r) & 1u) != 0u);
            }
            // Specular lobes, of the light or of shading points, are rarer: ray by ray.
            for (var rest = alive & select(glossy, present, (flags & LIGHT_GLOSSY) != 0u); rest != 0u; rest &= rest - 1u) {
                let ray = firstTrailingBit(rest);
#if ALPHA
                var share = 1.0;
                for (var r = 0u; r < RAYS; r += 1u) {
                    share = select(share, passes[r], r == ray);
                }
                let extra = add_lobes(at_light, list[begin + ray * LANES + lane], clip2, share);
#else
                let extra = add_lobes(at_light, list[begin + ray * LANES + lane], clip2, 1.0);
#endif
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
                direct[slot[r]] = vec4<f32>(sum[r], 0.0);
            }
        }
        for (var r = select(0u, RAYS, kind == 0u); r < RAYS; r += 1u) {
            if ((present >> r) & 1u) != 0u {
                indirect[slot[r]] = vec4<f32>(sum[r], 0.0);
            }
        }
#endif
    }
#if COUNTERS
    // All lanes have the same counts, except for their rays.
    for (var i = 0u; i < 6u; i += 1u) {
        atomicAdd(&counters[i], select(0u, met[i], i == 1u || lane == 0u));
    }
#endif
    let reached = select(step.first + firstTrailingBit(todo), step.end, todo == 0u);
#if VISIBILITY
    for (var r = 0u; r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            visible[slot[r]] = seen[r];
        }
    }
#endif
    // Their progress says that no light is left (pass::shade::NO_LIGHT_LEFT) unless it is set here.
    for (var r = select(RAYS, 0u, reached < step.end || step.round > 0u); r < RAYS; r += 1u) {
        if ((present >> r) & 1u) != 0u {
            progress[slot[r]] = vec2<u32>(reached, 0u);
        }
    }
    if reached < step.end {
        atomicAdd(&work.unfinished, countOneBits(present));
    }
}
