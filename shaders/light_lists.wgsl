// Chooses the lights that light a cluster of shading points. See pass/light_lists.rs. Three kernels, one after the other.
// POOL: collects what the choice needs to know of each light of the pool.
// CHOOSE: chooses. Without either: writes the list of each cluster.
// CLASSES: lists of classes of pixels, chosen by power alone. REGIONS: clusters choose from the lights of their region. WIDE: a workgroup
// takes a cluster, where they are too few to fill the device by an invocation each.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "lights.wgsl"
#if CHOOSE
#include "choice.wgsl"
#if CLASSES
#else
#include "representatives.wgsl"
#if WIDE
#include "together.wgsl"
#endif
#if REGIONS
#include "regions.wgsl"
#endif
#endif
#endif

#if POOL
@group(0) @binding(1) var<storage, read> lights: array<PointLight>;
// Of each light after reflections, class by class: position and power; normal.
@group(0) @binding(2) var<storage, read_write> candidates: array<vec4<f32>>;
#else
// Of each light of a list its number among the lights after reflections of the class, NO_POINT: none; and bits of the factor of what it
// emits.
@group(0) @binding(3) var<storage, read_write> chosen_lights: array<vec2<u32>>;
#if CHOOSE
@group(0) @binding(2) var<storage, read> candidates: array<vec4<f32>>;
#if CLASSES
#else
@group(0) @binding(4) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_shading: array<vec4<f32>>;
#if REGIONS
@group(0) @binding(9) var<storage, read> region_lights: array<vec4<f32>>;   // see light_regions.wgsl
#endif
#endif
#else
@group(0) @binding(4) var<storage, read_write> listed_lights: array<vec2<u32>>;     // see listed_light.wgsl
@group(0) @binding(5) var<storage, read_write> first_light: array<u32>;
#endif
#if CLASSES
#else
@group(0) @binding(6) var<storage, read> list: array<u32>;
@group(0) @binding(7) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(8) var<storage, read> clusters: array<vec2<u32>>;    // class, number among all
#endif
#endif

// Host twin: pass::light_lists::BY_BOUND.
const BY_BOUND: f32 = 0.2;
// Most lights that a cluster weighs. Host twin: pass::light_regions::CHOSEN.
const WEIGHED: u32 = 256u;

#if POOL
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let copied = frame.lists.y - frame.lists.x;
    let pool = frame.pattern.w - copied;
    if index >= pool * frame.pattern.z {
        return;
    }
    let l = lights[index / pool * frame.pattern.w + copied + index % pool];
    // Radiant intensity along the normal, with the lobe spread evenly; mean over channels.
    let power = mean3(l.emit.xyz + l.flux.xyz * l.f0.xyz * INV_PI);
    candidates[2u * index] = vec4<f32>(l.position.xyz, power);
    candidates[2u * index + 1u] = vec4<f32>(l.normal.xyz, 0.0);
}
#else
#if CHOOSE
#if CLASSES
#else
// Slot of a representative: from one of eight places, at random, or else from the next place that holds a shading point.
fn representative(cluster: u32, turn: u32, r: u32) -> u32 {
    let start = 8u * r + ((turn >> (4u * r)) & 7u);
    var found = NO_POINT;
    for (var k = 0u; k < 64u && found == NO_POINT; k += 1u) {
        found = list[64u * cluster + ((start + k) & 63u)];
    }
    return found;
}

fn representatives(cluster: u32, turn: u32, first: u32) -> Representatives {
    return representatives_at(vec4<u32>(
        representative(cluster, turn, first),
        representative(cluster, turn, first + 1u),
        representative(cluster, turn, first + 2u),
        representative(cluster, turn, first + 3u),
    ));
}

// Squared distance of a light from the box around the points of a cluster.
fn from_box(position: vec3<f32>, low: vec3<f32>, high: vec3<f32>) -> f32 {
    let off = max(max(low - position, position - high), vec3<f32>(0.0));
    return dot(off, off);
}

// Sum over the representatives.
fn contribution(position: vec4<f32>, normal: vec4<f32>, these: Representatives, those: Representatives) -> f32 {
    return dot(contributions(position, normal, these) + contributions(position, normal, those), vec4<f32>(1.0));
}
#endif

// Position and power, or normal, of the lights that are weighed.
fn weighed_light(i: u32) -> vec4<f32> {
#if REGIONS
    return region_lights[i];
#else
    return candidates[i];
#endif
}

// Writes a light into the places from `place` on, before `end`: it holds one place, the others emit nothing.
fn write_light(list: u32, place: u32, end: u32, of_pool: u32, times: f32) {
    let first = list * frame.lists.x;
    chosen_lights[first + place] = vec2<u32>(of_pool, bitcast<u32>(times));
    for (var k = place + 1u; k < end; k += 1u) {
        chosen_lights[first + k] = vec2<u32>(NO_POINT, 0u);
    }
}

#if WIDE
// Contribution and bound of each light, then share and number.
var<workgroup> asked: array<vec2<f32>, WEIGHED>;
const STRIDE: u32 = 64u;
#else
const STRIDE: u32 = 1u;
#endif

// An invocation takes a cluster, or a class.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
#if WIDE
    let index = group.x + group.y * groups.x;
    let own = lane;
#else
    let index = (group.x + group.y * groups.x) * 64u + lane;
    let own = 0u;
#endif
    let chosen = frame.lists.x;
    let pool = frame.pattern.w - (frame.lists.y - chosen);
#if CLASSES
    let class_number = index;
    if index >= frame.pattern.z {
        return;
    }
#else
    if 64u * index >= work.total {
        return;
    }
    let class_number = clusters[index].x;
    let cluster = clusters[index].y;
    // Number of the cluster's corner in the whole image: a region of an image chooses as the whole does.
    let block_size = 8u * frame.pattern.xy;
    let blocks = (frame.size.xy + block_size - 1u) / block_size;
    let of_component = blocks.x * blocks.y * frame.pattern.z;
    let block = cluster % of_component / frame.pattern.z;
    let corner = block_size * vec2<u32>(block % blocks.x, block / blocks.x) + frame.within.xy;
    let seed = corner.x + (corner.y + cluster / of_component * frame.within.w) * frame.within.z;
    let turn = hash(key(frame.keys.x, STREAM_LISTS, seed, 1u));
    let these = representatives(index, turn, 0u);
    let those = representatives(index, turn, 4u);
#endif
#if REGIONS
    let begin = REGION_LIGHTS * region_of_cluster(cluster);
    let end = begin + REGION_LIGHTS;
#else
    let begin = class_number * pool;
    let end = begin + pool;
#endif

    // Contributions, and bounds of them; of a class, powers.
    var whole = vec2<f32>(0.0);
#if CLASSES
#else
#if WIDE
#else
    var weights: array<f32, WEIGHED>;
    var bounds: array<f32, WEIGHED>;
#endif
    var low = vec3<f32>(3.0e38);
    var high = vec3<f32>(-3.0e38);
    for (var k = own; k < 64u; k += STRIDE) {
        let slot = list[64u * index + k];
        let point = point_position[select(slot, 0u, slot == NO_POINT)].xyz;
        low = min(low, select(point, vec3<f32>(3.0e38), slot == NO_POINT));
        high = max(high, select(point, vec3<f32>(-3.0e38), slot == NO_POINT));
    }
#if WIDE
    low = least_of_all(low, lane);
    high = -least_of_all(-high, lane);
#endif
#endif
    for (var i = begin + own; i < end; i += STRIDE) {
        let position = weighed_light(2u * i);
        var weight = 0.0;
        var bound = position.w;
#if CLASSES
#else
        let normal = weighed_light(2u * i + 1u);
        weight = position.w * contribution(position, normal, these, those);
        bound *= bound_at(from_box(position.xyz, low, high));
#if WIDE
        asked[i - begin] = vec2<f32>(weight, bound);
#else
        weights[i - begin] = weight;
        bounds[i - begin] = bound;
#endif
#endif
        whole += vec2<f32>(weight, bound);
    }
#if WIDE
    whole = sum_of_all(vec4<f32>(whole, 0.0, 0.0), lane).xy;
#endif
    // Shares by contribution and by bound; all by bound where no light contributes.
    let by_bound = select(BY_BOUND, 1.0, whole.x <= 0.0);
    let factors = vec2<f32>((1.0 - by_bound) / max(whole.x, 1e-37), by_bound / max(whole.y, 1e-37)) * f32(chosen);

    var choice = Choice(chosen, f32(chosen));
    let numbers = numbers_of(class_number, 0u);
    var place = 0u;
#if WIDE
    for (var i = begin + lane; i < end; i += 64u) {
        var of_pool = i - begin;
#if REGIONS
        of_pool = bitcast<u32>(region_lights[2u * i + 1u].w);
#endif
        asked[i - begin] = vec2<f32>(dot(asked[i - begin], factors), number_of(numbers, of_pool));
    }
    workgroupBarrier();
    // One invocation asks the lights.
    if lane > 0u {
        return;
    }
#endif
    for (var i = begin; i < end; i += 1u) {
#if WIDE
        let share = asked[i - begin].x;
        let number = asked[i - begin].y;
#else
        let power = weighed_light(2u * i).w;
        var share = power * factors.y;
        var of_pool = i - begin;
#if CLASSES
#else
        share = weights[i - begin] * factors.x + bounds[i - begin] * factors.y;
#endif
#if REGIONS
        of_pool = bitcast<u32>(region_lights[2u * i + 1u].w);
#endif
        let number = number_of(numbers, of_pool);
#endif
        let taken = take(&choice, share, number);
        if taken > 0u {
#if WIDE
            let power = weighed_light(2u * i).w;
            var of_pool = i - begin;
#if REGIONS
            of_pool = bitcast<u32>(region_lights[2u * i + 1u].w);
#endif
#endif
            var times = f32(taken) / max(share, 1e-30);
#if REGIONS
            // Chosen twice, it stands for more.
            times *= power / max(candidates[2u * (class_number * pool + of_pool)].w, 1e-37);
#endif
            write_light(index, place, chosen - choice.points, of_pool, times);
            place = chosen - choice.points;
        }
    }
    for (; place < chosen; place += 1u) {
        chosen_lights[index * chosen + place] = vec2<u32>(NO_POINT, 0u);
    }
}
#else
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x + group.y * groups.x;
    let chosen = frame.lists.x;
    let slots = frame.lists.y;
    let copied = slots - chosen;
#if CLASSES
    let class_number = index;
    let number = index;
#else
    if 64u * index >= work.total {
        return;
    }
    let class_number = clusters[index].x;
    let number = clusters[index].y;
    let slot = list[64u * index + lane];
    if slot != NO_POINT {
        first_light[slot] = number * slots;
    }
#endif
    for (var i = lane; i < slots; i += 64u) {
        // The lights before those after reflections are taken over as they are.
        let is_chosen = i >= copied;
        let choice = chosen_lights[index * chosen + select(0u, i - copied, is_chosen)];
        let none = is_chosen && choice.x == NO_POINT;
        let from_light = class_number * frame.pattern.w + select(i, copied + select(choice.x, 0u, none), is_chosen);
        let times = select(select(1.0, bitcast<f32>(choice.y), is_chosen), 0.0, none);
        listed_lights[number * slots + i] = vec2<u32>(from_light, bitcast<u32>(times));
    }
}
#endif
#endif
