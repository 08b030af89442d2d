// Chooses the lights of a pool that the clusters of a region weigh. See pass/light_regions.rs.
// WIDE: by a workgroup for each region, where the regions of an image are too few to fill the device.
#include "frame.wgsl"
#include "math.wgsl"
#include "work.wgsl"
#include "regions.wgsl"
#include "representatives.wgsl"
#include "choice.wgsl"
#if WIDE
#include "together.wgsl"
#endif

@group(0) @binding(1) var<storage, read> places: array<u32>;        // slot of each place of each cluster
@group(0) @binding(2) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> point_shading: array<vec4<f32>>;
// Of each light after reflections, class by class: position and power; normal.
@group(0) @binding(4) var<storage, read> candidates: array<vec4<f32>>;
// Of each light that a region chose: position and power times its factor; normal, bits of its number in the pool.
@group(0) @binding(5) var<storage, read_write> region_lights: array<vec4<f32>>;

// Host twins: pass::light_regions::{BY_BOUND, NEARER}.
const BY_BOUND: f32 = 0.2;
const NEARER: f32 = 0.25;

// Slot of a point of a cluster, from a place on; NO_POINT: there is none.
fn point_of_cluster(cluster: u32, start: u32) -> u32 {
    var found = NO_POINT;
    for (var k = 0u; k < 64u && found == NO_POINT; k += 1u) {
        found = places[64u * cluster + ((start + k) & 63u)];
    }
    return found;
}

// Points of four clusters side by side.
fn points_of_row(region: Region, row: u32) -> vec4<u32> {
    var slots = vec4<u32>(NO_POINT);
    for (var k = 0u; k < REGION; k += 1u) {
        let block = REGION * region.at + vec2<u32>(k, row);
        if all(block < region.blocks) {
            let corner = 8u * frame.pattern.xy * block + frame.within.xy;
            let start = hash(key(frame.keys.x, STREAM_LISTS, corner.x + corner.y * frame.within.z, 3u)) & 63u;
            slots[k] = point_of_cluster(cluster_of(region, block), start);
        }
    }
    return slots;
}

fn inverse_of(sums: vec4<f32>) -> vec4<f32> {
    return select(vec4<f32>(0.0), 1.0 / max(sums, vec4<f32>(1e-37)), sums > vec4<f32>(0.0));
}

// Other points of the region may be nearer to the light than its representatives.
fn bound_of(position: vec4<f32>, at0: Representatives, at1: Representatives, at2: Representatives, at3: Representatives) -> f32 {
    let nearest = min(min(nearest2(position, at0), nearest2(position, at1)), min(nearest2(position, at2), nearest2(position, at3)));
    return bound_at(NEARER * nearest);
}

// A light of a region that takes the points from `place` on, before `end`: it holds one place, the others have no power.
fn write_light(region: u32, place: u32, end: u32, position: vec4<f32>, normal: vec3<f32>, power: f32, of_pool: u32) {
    let first = REGION_LIGHTS * region;
    region_lights[2u * (first + place)] = vec4<f32>(position.xyz, power);
    region_lights[2u * (first + place) + 1u] = vec4<f32>(normal, bitcast<f32>(of_pool));
    for (var k = place + 1u; k < end; k += 1u) {
        region_lights[2u * (first + k)] = vec4<f32>(position.xyz, 0.0);
        region_lights[2u * (first + k) + 1u] = vec4<f32>(normal, bitcast<f32>(of_pool));
    }
}

#if WIDE
// Share and number of 64 lights.
var<workgroup> asked: array<vec2<f32>, 64>;
#endif

// An invocation takes a region and class, or a workgroup does.
#if WIDE
const STRIDE: u32 = 64u;
@compute @workgroup_size(64)
#else
const STRIDE: u32 = 1u;
@compute @workgroup_size(16)
#endif
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
#if WIDE
    let index = group.x + group.y * groups.x;
    let own = lane;
#else
    let index = (group.x + group.y * groups.x) * 16u + lane;
    let own = 0u;
#endif
    if REGION_LIGHTS * index >= arrayLength(&region_lights) / 2u {
        return;
    }
    let region = region_at(index);
    let slots0 = points_of_row(region, 0u);
    let slots1 = points_of_row(region, 1u);
    let slots2 = points_of_row(region, 2u);
    let slots3 = points_of_row(region, 3u);
    let none = vec4<u32>(NO_POINT);
    // One that is missing stands where another one does, and has no part. NO_POINT is the greatest number.
    let least = min(min(slots0, slots1), min(slots2, slots3));
    let first = min(min(least.x, least.y), min(least.z, least.w));
    let other = vec4<u32>(select(first, 0u, first == NO_POINT));
    let at0 = representatives_at(select(slots0, other, slots0 == none));
    let at1 = representatives_at(select(slots1, other, slots1 == none));
    let at2 = representatives_at(select(slots2, other, slots2 == none));
    let at3 = representatives_at(select(slots3, other, slots3 == none));

    let pool = frame.pattern.w - (frame.lists.y - frame.lists.x);
    let begin = region.class_number * pool;
    let end = begin + pool;
    var sum0 = vec4<f32>(0.0);
    var sum1 = vec4<f32>(0.0);
    var sum2 = vec4<f32>(0.0);
    var sum3 = vec4<f32>(0.0);
    var bounds = 0.0;
    for (var i = begin + own; i < end; i += STRIDE) {
        let position = candidates[2u * i];
        let normal = candidates[2u * i + 1u];
        sum0 += position.w * contributions(position, normal, at0);
        sum1 += position.w * contributions(position, normal, at1);
        sum2 += position.w * contributions(position, normal, at2);
        sum3 += position.w * contributions(position, normal, at3);
        bounds += position.w * bound_of(position, at0, at1, at2, at3);
    }
#if WIDE
    sum0 = sum_of_all(sum0, lane);
    sum1 = sum_of_all(sum1, lane);
    sum2 = sum_of_all(sum2, lane);
    sum3 = sum_of_all(sum3, lane);
    bounds = sum_of_all(vec4<f32>(bounds), lane).x;
#endif
    // Each representative counts alike, however little light it has.
    var scale0 = select(inverse_of(sum0), vec4<f32>(0.0), slots0 == none);
    var scale1 = select(inverse_of(sum1), vec4<f32>(0.0), slots1 == none);
    var scale2 = select(inverse_of(sum2), vec4<f32>(0.0), slots2 == none);
    var scale3 = select(inverse_of(sum3), vec4<f32>(0.0), slots3 == none);
    let one = vec4<f32>(1.0);
    let zero = vec4<f32>(0.0);
    let lit = dot(one, select(zero, one, scale0 > zero) + select(zero, one, scale1 > zero) + select(zero, one, scale2 > zero) + select(zero, one, scale3 > zero));
    let by_bound = select(BY_BOUND, 1.0, lit == 0.0);
    let of_each = (1.0 - by_bound) / max(lit, 1.0) * f32(REGION_LIGHTS);
    scale0 *= of_each;
    scale1 *= of_each;
    scale2 *= of_each;
    scale3 *= of_each;
    let of_bound = by_bound / max(bounds, 1e-37) * f32(REGION_LIGHTS);

    var choice = Choice(REGION_LIGHTS, f32(REGION_LIGHTS));
    let numbers = numbers_of(region.class_number, 4u);
    var place = 0u;
#if WIDE
    // All compute the shares of 64 lights, then one invocation asks these.
    for (var block = begin; block < end; block += 64u) {
        let i = block + lane;
        let at = select(begin, i, i < end);
#else
    for (var i = begin; i < end; i += 1u) {
        let at = i;
#endif
        let position = candidates[2u * at];
        let normal = candidates[2u * at + 1u];
        let weight = dot(contributions(position, normal, at0), scale0) + dot(contributions(position, normal, at1), scale1)
            + dot(contributions(position, normal, at2), scale2) + dot(contributions(position, normal, at3), scale3);
        let share = position.w * (weight + of_bound * bound_of(position, at0, at1, at2, at3));
#if WIDE
        asked[lane] = vec2<f32>(share, number_of(numbers, at - begin));
        workgroupBarrier();
        let count = select(0u, min(64u, end - block), lane == 0u);
        for (var k = 0u; k < count; k += 1u) {
            let taken = take(&choice, asked[k].x, asked[k].y);
            if taken > 0u {
                let of_pool = block + k - begin;
                let light = candidates[2u * (block + k)];
                let power = light.w * (f32(taken) / max(asked[k].x, 1e-30));
                write_light(index, place, REGION_LIGHTS - choice.points, light, candidates[2u * (block + k) + 1u].xyz, power, of_pool);
                place = REGION_LIGHTS - choice.points;
            }
        }
        workgroupBarrier();
#else
        let taken = take(&choice, share, number_of(numbers, i - begin));
        if taken > 0u {
            let power = position.w * (f32(taken) / max(share, 1e-30));
            write_light(index, place, REGION_LIGHTS - choice.points, position, normal.xyz, power, i - begin);
            place = REGION_LIGHTS - choice.points;
        }
#endif
    }
#if WIDE
    if lane > 0u {
        return;
    }
#endif
    for (; place < REGION_LIGHTS; place += 1u) {
        region_lights[2u * (REGION_LIGHTS * index + place)] = vec4<f32>(0.0);
        region_lights[2u * (REGION_LIGHTS * index + place) + 1u] = vec4<f32>(0.0);
    }
}
