// Chooses the lights that light a cluster of shading points. See pass/light_lists.rs.
// CLASSES: chooses them for a class of pixels, by their power alone.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "lights.wgsl"
#include "stretches.wgsl"

@group(0) @binding(1) var<storage, read> lights: array<PointLight>;
@group(0) @binding(2) var<storage, read_write> listed_lights: array<PointLight>;
#if CLASSES
#else
@group(0) @binding(3) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> list: array<u32>;
@group(0) @binding(6) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(7) var<storage, read> clusters: array<vec2<u32>>;    // class, number among all
@group(0) @binding(8) var<storage, read_write> first_light: array<u32>;
#endif

// Host twins: pass::light_lists::{BY_POWER, MAX_POOL, REPRESENTATIVES}.
const BY_POWER: f32 = 0.25;
const MAX_POOL: u32 = 2048u;
const REPRESENTATIVES: u32 = 4u;

// For each light its contribution at the representatives.
var<workgroup> weights: array<f32, MAX_POOL>;
// Of the stretch of each lane: contributions, powers.
var<workgroup> of_stretch: array<vec2<f32>, 64>;

// Radiant intensity along the normal, with the lobe spread evenly; mean over channels.
fn power_of(l: PointLight) -> f32 {
    return mean3(l.emit.xyz + l.flux.xyz * l.f0.xyz * INV_PI);
}

#if CLASSES
#else
// Irradiance from a light at a shading point without shadows.
fn contribution(l: PointLight, x: vec3<f32>, n: vec3<f32>) -> f32 {
    let d = l.position.xyz - x;
    let r2 = max(dot(d, d), 1e-37);
    let cosines = max(dot(d, n), 0.0) * max(-dot(d, l.normal.xyz), 0.0) / r2;
    return power_of(l) * cosines / max(r2, frame.right.w);
}
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let chosen = frame.lists.x;
    let slots = frame.lists.y;
    let copied = slots - chosen;
    let pool = frame.pattern.w - copied;
#if CLASSES
    let class_number = index;
    let number = index;
    let seed = index;
#else
    if 64u * index >= work.total {
        return;
    }
    let class_number = clusters[index].x;
    let number = clusters[index].y;
    let slot = list[64u * index + lane];
    let present = slot != NO_POINT;
    if present {
        first_light[slot] = number * slots;
    }
    // Number of the cluster's corner in the whole image: a region of an image chooses as the whole does.
    let of_component = (frame.size.x + 8u * frame.pattern.x - 1u) / (8u * frame.pattern.x) * ((frame.size.y + 8u * frame.pattern.y - 1u) / (8u * frame.pattern.y)) * frame.pattern.z;
    let across = (frame.size.x + 8u * frame.pattern.x - 1u) / (8u * frame.pattern.x);
    let block = number % of_component / frame.pattern.z;
    let corner = vec2<u32>(8u * frame.pattern.x * (block % across), 8u * frame.pattern.y * (block / across)) + frame.within.xy;
    let seed = corner.x + (corner.y + number / of_component * frame.within.w) * frame.within.z;
#endif
    let from_pool = class_number * frame.pattern.w;
    let to = number * slots;
    for (var i = lane; i < copied; i += 64u) {
        listed_lights[to + i] = lights[from_pool + i];
    }
    // Places that no light takes emit nothing.
    for (var i = lane; i < chosen; i += 64u) {
        listed_lights[to + copied + i] = PointLight(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0));
    }

    let stretch = stretch_of(lane, pool);
    let candidates = from_pool + copied;
    var sum = vec2<f32>(0.0);
#if CLASSES
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        sum.y += power_of(lights[candidates + i]);
    }
#else
    // Representatives: one of each sixteen places, at random, or else the next one that holds a shading point.
    var x: array<vec3<f32>, REPRESENTATIVES>;
    var n: array<vec3<f32>, REPRESENTATIVES>;
    let turn = hash(key(frame.keys.x, STREAM_LISTS, seed, 1u));
    for (var r = 0u; r < REPRESENTATIVES; r += 1u) {
        let start = 16u * r + ((turn >> (4u * r)) & 15u);
        var found = NO_POINT;
        for (var k = 0u; k < 64u && found == NO_POINT; k += 1u) {
            found = list[64u * index + ((start + k) & 63u)];
        }
        x[r] = point_position[found].xyz;
        n[r] = point_shading[found].xyz;
    }
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        let l = lights[candidates + i];
        var weight = 0.0;
        for (var r = 0u; r < REPRESENTATIVES; r += 1u) {
            weight += contribution(l, x[r], n[r]);
        }
        weights[i] = weight;
        sum += vec2<f32>(weight, power_of(l));
    }
#endif
    of_stretch[lane] = sum;
    workgroupBarrier();
    var before = vec2<f32>(0.0);
    var whole = vec2<f32>(0.0);
    for (var k = 0u; k < 64u; k += 1u) {
        before = select(before, whole, k == lane);
        whole += of_stretch[k];
    }
    // Shares by contribution and by power; all by power where no light contributes.
    let by_power = select(BY_POWER, 1.0, whole.x <= 0.0);
    let factors = vec2<f32>((1.0 - by_power) / max(whole.x, 1e-37), by_power / max(whole.y, 1e-37)) * f32(chosen);

    // The shares lie one after the other on a line of length `chosen`; each of the points u, 1 + u, ... chooses the light whose share
    // holds it. Classes and passes have points in between.
    let start = hash(key(frame.keys.y, STREAM_LISTS, seed, 0u));
    let u = unit(vec2<u32>(start + frame.size.w * 0x9e3779b9u + class_number * (0xffffffffu / frame.pattern.z))).x;
    var end = dot(before, factors);
    var place = u32(max(ceil(end - u), 0.0));
    // Where the next stretch begins, by the same sums; nothing is left over behind the last one.
    let after = u32(max(ceil(dot(before + sum, factors) - u), 0.0));
    let last_place = select(min(after, chosen), chosen, lane == 63u);
    for (var i = stretch.first; i < stretch.end; i += 1u) {
        let power = power_of(lights[candidates + i]);
#if CLASSES
        let share = power * factors.y;
#else
        let share = weights[i] * factors.x + power * factors.y;
#endif
        end += share;
        let reached = min(u32(max(ceil(end - u), 0.0)), last_place);
        let next = select(reached, last_place, i + 1u == stretch.end);
        // A light that holds several points takes one place.
        if next > place {
            var l = lights[candidates + i];
            let times = f32(next - place) / max(share, 1e-30);
            l.emit = vec4<f32>(l.emit.xyz * times, l.emit.w);
            l.flux = vec4<f32>(l.flux.xyz * times, l.flux.w);
            listed_lights[to + copied + place] = l;
            place = next;
        }
    }
}
