// A level of the pyramid: writes the light that each texel spreads on this level, and the light that rises to the next level.
// See pass/convolve.rs.
// FINE: the level is the image itself.
#include "convolve.wgsl"
#include "convolve_occupied.wgsl"
#if FINE
#include "convolve_source.wgsl"
#endif

@group(0) @binding(5) var<storage, read> moments: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> masses: array<vec4<f32>>;       // radiance, weight; divided by the kernel's sum
@group(0) @binding(7) var<storage, read_write> shapes: array<vec4<f32>>;       // axis / radius, ratio of the radii (FINE: depth), region and layer
@group(0) @binding(8) var<storage, read_write> rising: array<vec4<f32>>;       // radiance, weight; diameter, axis, layer times weight
@group(0) @binding(9) var<storage, read_write> members: array<u32>;            // region of an entry, how many pixels are its own
@group(0) @binding(10) var<storage, read> norms: array<f32>;

// Kernels this many texels wide stay at their level as a whole up to STAYS, in part up to LEAVES. Host twins in pass/convolve.rs.
const STAYS: f32 = 6.0;
const LEAVES: f32 = 8.0;
// Least width of the disc with the variance of a kernel, in diameters. Host twin: pass::convolve::levels::MIN_BREADTH.
const MIN_BREADTH: f32 = 0.5;
// Minimum share of a kernel's variance that remains after subtracting the variance of the pyramid.
const MIN_VARIANCE: f32 = 0.02;
// Minimum standard deviation that remains, in texels.
const MIN_DEVIATION: f32 = 0.4;

// Layers of one table that a texel holds lie closer together than this: those of a curved surface are 64 in order, the same layers of two
// angles of a grain 64 apart.
const LAYERS_OF_TABLE: f32 = 47.5;

struct Entry {
    light: vec4<f32>,       // radiance times weight, weight
    diameter: f32,          // pixels
    axis: vec2<f32>,        // along u; where it is longer than 1, the factor by which the kernel is narrower along v than the library states
    layer: f32,
    depth: f32,
}

// Share of an entry that is convolved at this level.
fn staying(width: f32) -> f32 {
    return 1.0 - clamp((width - STAYS) / (LEAVES - STAYS), 0.0, 1.0);
}

// Sum of a kernel over the grid: from the table, or for wider kernels from the integral.
fn norm(layer: u32, diameter: f32, axis: vec2<f32>, mean: f32) -> f32 {
    let width = min(diameter * NORM_STEPS, f32(NORM_WIDTHS - 1u));
    let low = u32(width);
    let turn = atan2(axis.y, axis.x) * (f32(NORM_ANGLES) / 1.5707964) + 4.0 * f32(NORM_ANGLES);
    let angle = u32(turn);
    let row = (layer * NORM_WIDTHS + low) * NORM_ANGLES;
    let next = select(row, row + NORM_ANGLES, low + 1u < NORM_WIDTHS);
    let a = angle % NORM_ANGLES;
    let b = (angle + 1u) % NORM_ANGLES;
    let part = turn - f32(angle);
    let sums = mix(mix(norms[row + a], norms[row + b], part), mix(norms[next + a], norms[next + b], part), width - f32(low));
    return select(sums, mean * diameter * diameter, diameter * NORM_STEPS > f32(NORM_WIDTHS - 1u));
}

// Writes the light that an entry spreads at this level and returns the share that rises.
fn settle(at: u32, entry: Entry, id: u32, held: bool, here: ConvolveStep) -> f32 {
    let layer = u32(entry.layer + 0.5);
    let stats = moments[2u * layer];
    let length = sqrt(dot(entry.axis, entry.axis));
    // The kernel's own narrowing comes on top of that of the library, which the moments contain.
    let narrowing = min(u32(moments[2u * layer + 1u].y) + steps_of(length), MAX_STEPS);
    let extra = exp2(-0.25 * (f32(narrowing) - moments[2u * layer + 1u].y));
    let breadth = max(moments[2u * layer + 1u].x * sqrt(extra), MIN_BREADTH);
    let deviations = vec2<f32>(stats.x, stats.y * extra);
    let width = entry.diameter * breadth / here.texel;
    let top = (here.flags & TOP_LEVEL) != 0u;
    let rises = held && !top;
    let share = select(1.0, staying(width), rises);
    // A kernel that cannot rise is narrowed, because the reach of a level is limited.
    let diameter = select(min(entry.diameter, LEAVES * here.texel / breadth), entry.diameter, top || rises);
    let radius = 0.5 * diameter;
    // The box filter of a texel and the splines of the upsampling widen a kernel.
    let added = (here.texel * here.texel - 1.0) / 3.0;
    let variance = max(deviations * deviations * radius * radius, vec2<f32>(1e-12));
    // Kernels narrower than this could fall between the texels; the sums over the grid do not hold for them.
    let whole_radius = radius / here.texel;
    let narrowest = MIN_DEVIATION / max(deviations, vec2<f32>(1e-6));
    let taken_off = sqrt(max(1.0 - added / variance, vec2<f32>(MIN_VARIANCE))) * whole_radius;
    let radii = min(max(taken_off, narrowest), vec2<f32>(whole_radius));
    let axis = select(vec2<f32>(1.0, 0.0), entry.axis / length, length > 1e-6);
    let whole = norm(layer, 2.0 * sqrt(radii.x * radii.y * extra), axis, stats.z);
    let spreads = diameter > 0.0 && whole > MIN_SUM;
    let weight = select(1.0, 1.0 / whole, spreads) * share;
    let there = id != 0u && entry.light.w > 0.0;
    masses[at] = select(vec4<f32>(0.0), entry.light * weight, there);
    let packed = id | (select(here.layers, layer, spreads) << 16u);
    // On the image itself the third component is the depth, on coarser levels the ratio.
#if FINE
    let third = entry.depth;
    let with_steps = packed | (narrowing << 28u);
#else
    let third = select(1.0, exp2(0.25 * f32(narrowing)) * radii.x / radii.y, spreads);
    let with_steps = packed;
#endif
    shapes[at] = vec4<f32>(select(vec2<f32>(DELTA, 0.0), axis / radii.x, spreads), third, bitcast<f32>(with_steps));
    return select(0.0, 1.0 - share, there && rises);
}

#if FINE
fn load_entry(at: u32, here: ConvolveStep) -> Entry {
    let foot = load_footprint(at, here);
    let light = source[at];
    var entry: Entry;
    entry.light = vec4<f32>(light.xyz, 1.0);
    entry.diameter = foot.diameter;
    entry.axis = foot.axis * exp2(0.25 * f32(foot.steps));
    entry.layer = foot.layer;
    entry.depth = light.w;
    return entry;
}
#else
fn load_entry(at: u32, here: ConvolveStep) -> Entry {
    let light = rising[2u * at];
    let means = rising[2u * at + 1u] / max(light.w, 1e-30);
    var entry: Entry;
    entry.light = light;
    entry.diameter = means.x;
    entry.axis = means.yz;
    entry.layer = clamp(means.w, 0.0, f32(here.layers - 1u));
    return entry;
}
#endif

// The layers of entries that were added up: the least, the greatest, that of the heaviest entry, and its weight.
fn with_layer(so_far: vec4<f32>, takes: bool, layer: f32, weight: f32) -> vec4<f32> {
    let best = select(so_far.zw, vec2<f32>(layer, weight), weight > so_far.w);
    return select(so_far, vec4<f32>(min(so_far.x, layer), max(so_far.y, layer), best), takes);
}

// Between the layers of several tables there is no mean: that of the heaviest entry stands for all.
fn mean_layer(mean: f32, layers: vec4<f32>, weight: f32) -> f32 {
    return select(mean, layers.z * weight, layers.y - layers.x > LAYERS_OF_TABLE);
}

// Number of pixels of a region among the entries.
fn votes(id: u32, ids: array<vec4<u32>, 2>, counts: array<vec4<f32>, 2>) -> f32 {
    let all = select(vec4<f32>(0.0), counts[0], ids[0] == vec4<u32>(id)) + select(vec4<f32>(0.0), counts[1], ids[1] == vec4<u32>(id));
    return select(0.0, (all.x + all.y) + (all.z + all.w), id != 0u);
}

// The region with more pixels; on a tie the lower number.
fn better(best: vec2<f32>, id: u32, ids: array<vec4<u32>, 2>, counts: array<vec4<f32>, 2>, not_this: u32) -> vec2<f32> {
    let found = select(votes(id, ids, counts), 0.0, id == not_this);
    let wins = found > best.y || (found == best.y && f32(id) < best.x);
    return select(best, vec2<f32>(f32(id), found), wins);
}

fn choose(ids: array<vec4<u32>, 2>, counts: array<vec4<f32>, 2>, not_this: u32) -> vec2<f32> {
    var best = vec2<f32>(0.0);
    best = better(best, ids[0].x, ids, counts, not_this);
    best = better(best, ids[0].y, ids, counts, not_this);
    best = better(best, ids[0].z, ids, counts, not_this);
    best = better(best, ids[0].w, ids, counts, not_this);
#if FINE
#else
    best = better(best, ids[1].x, ids, counts, not_this);
    best = better(best, ids[1].y, ids, counts, not_this);
    best = better(best, ids[1].z, ids, counts, not_this);
    best = better(best, ids[1].w, ids, counts, not_this);
#endif
    return best;
}

#if FINE
const PLANES: u32 = 1u;
fn member(at: u32) -> u32 {
    let id = region_of(at);
    return select(0u, id | (1u << 16u), id != 0u);
}
#else
const PLANES: u32 = 2u;
fn member(at: u32) -> u32 {
    return members[at];
}
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let here = steps[push.step];
    let above = steps[push.step + 1u];
    let parents = above.size.x * above.size.y;
    let tile = occupied_tile(above, group, groups);
    if tile == NO_TILE {
        return;
    }
    let parent_at = texel_of(above, tile, lane);
    if any(parent_at >= above.size) {
        return;
    }
    let parent = parent_at.x + parent_at.y * above.size.x;
    let corner = 2u * parent_at;
    let right = corner.x + 1u < here.size.x;
    let down = corner.y + 1u < here.size.y;
    let first = here.first + corner.y * here.size.x + corner.x;
    let plane = here.size.x * here.size.y;
    let across = select(0u, 1u, right);
    let below = select(0u, here.size.x, down);
    let places = vec4<u32>(first, first + across, first + below, first + across + below);
    let exists = vec4<bool>(true, right, down, right && down);

    var ids: array<vec4<u32>, 2>;
    var counts: array<vec4<f32>, 2>;
    let none = vec4<u32>(0u);
    let low = select(none, vec4<u32>(member(places.x), member(places.y), member(places.z), member(places.w)), exists);
    ids[0] = low & vec4<u32>(0xffffu);
    counts[0] = vec4<f32>(low >> vec4<u32>(16u));
#if FINE
    ids[1] = none;
    counts[1] = vec4<f32>(0.0);
#else
    let upper = places + vec4<u32>(plane);
    let high = select(none, vec4<u32>(member(upper.x), member(upper.y), member(upper.z), member(upper.w)), exists);
    ids[1] = high & vec4<u32>(0xffffu);
    counts[1] = vec4<f32>(high >> vec4<u32>(16u));
#endif
#if LAYERS
    // Every entry holds both layers, because each spreads over the other.
    let chosen0 = vec2<f32>(1.0, 1.0);
    let chosen1 = vec2<f32>(2.0, 1.0);
#else
    let chosen0 = choose(ids, counts, 0u);
    let chosen1 = choose(ids, counts, u32(chosen0.x));
#endif
    let id0 = u32(chosen0.x);
    let id1 = u32(chosen1.x);

    var light0 = vec4<f32>(0.0);
    var light1 = vec4<f32>(0.0);
    var means0 = vec4<f32>(0.0);
    var means1 = vec4<f32>(0.0);
    var layers0 = vec4<f32>(1e9, -1.0, 0.0, 0.0);
    var layers1 = layers0;
    // Entries outside every region are only cleared. A loop that runs zero times skips work on every device.
    let live = select(0u, 4u * PLANES, id0 != 0u);
    for (var i = live; i < 4u * PLANES; i += 1u) {
        let child = i & 3u;
        if (child & 1u) <= across && (child < 2u || down) {
            shapes[first + (child & 1u) * across + select(0u, below, child >= 2u) + (i / 4u) * plane] = vec4<f32>(0.0);
        }
    }
    for (var i = 0u; i < live; i += 1u) {
        let child = i & 3u;
        let there = (child & 1u) <= across && (child < 2u || down);
        let at = first + (child & 1u) * across + select(0u, below, child >= 2u) + (i / 4u) * plane;
        let id = select(0u, member(at) & 0xffffu, there);
        if there {
            let entry = load_entry(at, here);
            let share = settle(at, entry, id, id == id0 || id == id1, here);
            let light = entry.light * share;
            let means = vec4<f32>(entry.diameter, entry.axis, entry.layer) * light.w;
            // Entries that take no part may hold any value, NaN too.
            let takes0 = id != 0u && id == id0 && share > 0.0;
            let takes1 = id != 0u && id == id1 && share > 0.0;
            light0 += select(vec4<f32>(0.0), light, takes0);
            means0 += select(vec4<f32>(0.0), means, takes0);
            light1 += select(vec4<f32>(0.0), light, takes1);
            means1 += select(vec4<f32>(0.0), means, takes1);
            layers0 = with_layer(layers0, takes0, entry.layer, light.w);
            layers1 = with_layer(layers1, takes1, entry.layer, light.w);
        }
    }
    means0.w = mean_layer(means0.w, layers0, light0.w);
    means1.w = mean_layer(means1.w, layers1, light1.w);
    let at0 = above.first + parent;
    let at1 = at0 + parents;
    rising[2u * at0] = light0;
    rising[2u * at0 + 1u] = means0;
    rising[2u * at1] = light1;
    rising[2u * at1 + 1u] = means1;
    members[at0] = id0 | (u32(min(chosen0.y, 65535.0)) << 16u);
    members[at1] = id1 | (u32(min(chosen1.y, 65535.0)) << 16u);
}
