// Chooses the lights that light a cluster of shading points. See pass/light_lists.rs. Three kernels, one after the other.
// POOL: collects what the choice needs to know of each light of the pool.
// CHOOSE: chooses. Without either: copies the chosen lights into the list of each cluster.
// CLASSES: lists of classes of pixels, chosen by power alone.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "lights.wgsl"

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
#endif
#else
@group(0) @binding(1) var<storage, read> lights: array<PointLight>;
@group(0) @binding(4) var<storage, read_write> listed_lights: array<PointLight>;
@group(0) @binding(5) var<storage, read_write> first_light: array<u32>;
#endif
#if CLASSES
#else
@group(0) @binding(6) var<storage, read> list: array<u32>;
@group(0) @binding(7) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(8) var<storage, read> clusters: array<vec2<u32>>;    // class, number among all
#endif
#endif

// Host twins: pass::light_lists::{BY_POWER, SOFT, WEIGHED}.
const BY_POWER: f32 = 0.35;
const SOFT: f32 = 0.2;
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
// Four representatives, a component of all four in a vector.
struct Representatives {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    nx: vec4<f32>,
    ny: vec4<f32>,
    nz: vec4<f32>,
}

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
    let a = representative(cluster, turn, first);
    let b = representative(cluster, turn, first + 1u);
    let c = representative(cluster, turn, first + 2u);
    let d = representative(cluster, turn, first + 3u);
    let p = transpose(mat4x4<f32>(point_position[a], point_position[b], point_position[c], point_position[d]));
    let n = transpose(mat4x4<f32>(point_shading[a], point_shading[b], point_shading[c], point_shading[d]));
    return Representatives(p[0], p[1], p[2], n[0], n[1], n[2]);
}

// Sum of the irradiances from a light of power 1 at the representatives, without shadows.
fn contribution(position: vec4<f32>, normal: vec4<f32>, at: Representatives) -> f32 {
    let x = position.x - at.x;
    let y = position.y - at.y;
    let z = position.z - at.z;
    let r2 = max(x * x + y * y + z * z, vec4<f32>(1e-30));
    let soft = SOFT * sqrt(r2);
    let cos_point = max(x * at.nx + y * at.ny + z * at.nz + soft, vec4<f32>(0.0));
    let cos_light = max(soft - (x * normal.x + y * normal.y + z * normal.z), vec4<f32>(0.0));
    let each = cos_point * cos_light / (r2 * max(r2, vec4<f32>(max(frame.right.w, 1e-7))));
    return each.x + each.y + each.z + each.w;
}
#endif

// An invocation takes a cluster, or a class.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.x + group.y * groups.x) * 64u + lane;
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
    let number = clusters[index].y;
    // Number of the cluster's corner in the whole image: a region of an image chooses as the whole does.
    let block_size = 8u * frame.pattern.xy;
    let blocks = (frame.size.xy + block_size - 1u) / block_size;
    let of_component = blocks.x * blocks.y * frame.pattern.z;
    let block = number % of_component / frame.pattern.z;
    let corner = block_size * vec2<u32>(block % blocks.x, block / blocks.x) + frame.within.xy;
    let seed = corner.x + (corner.y + number / of_component * frame.within.w) * frame.within.z;
    let turn = hash(key(frame.keys.x, STREAM_LISTS, seed, 1u));
    let these = representatives(index, turn, 0u);
    let those = representatives(index, turn, 4u);
#endif
    // Every `stride`-th light of the pool is weighed.
    let stride = (pool + WEIGHED - 1u) / WEIGHED;
    let begin = class_number * pool;
    let first = begin + hash(key(frame.keys.x, STREAM_LISTS, class_number, 2u)) % max(stride, 1u);
    let end = begin + pool;

    // Contributions and powers.
    var whole = vec2<f32>(0.0);
    for (var i = first; i < end; i += stride) {
        let position = candidates[2u * i];
        var weight = 0.0;
#if CLASSES
#else
        let normal = candidates[2u * i + 1u];
        weight = position.w * (contribution(position, normal, these) + contribution(position, normal, those));
#endif
        whole += vec2<f32>(weight, position.w);
    }
    // Shares by contribution and by power; all by power where no light contributes.
    let by_power = select(BY_POWER, 1.0, whole.x <= 0.0);
    let factors = vec2<f32>((1.0 - by_power) / max(whole.x, 1e-37), by_power / max(whole.y, 1e-37)) * f32(chosen);

    // The shares lie one after the other on a line of length `chosen`; each of the points u, 1 + u, ... chooses the light whose share
    // holds it. Classes and passes have points in between.
    let start = hash(key(frame.keys.y, STREAM_LISTS, 0u, 0u));
    let u = unit(vec2<u32>(start + frame.size.w * 0x9e3779b9u + class_number * (0xffffffffu / frame.pattern.z))).x;
    var reached = 0.0;
    var place = 0u;
    for (var i = first; i < end; i += stride) {
        let position = candidates[2u * i];
        var share = position.w * factors.y;
#if CLASSES
#else
        let normal = candidates[2u * i + 1u];
        share += position.w * (contribution(position, normal, these) + contribution(position, normal, those)) * factors.x;
#endif
        reached += share;
        let next = min(u32(max(ceil(reached - u), 0.0)), chosen);
        // A light that holds several points takes one place, the others emit nothing.
        let times = f32(stride * (next - min(next, place))) / max(share, 1e-30);
        for (; place < next; place += 1u) {
            chosen_lights[index * chosen + place] = vec2<u32>(i - begin, bitcast<u32>(times));
            for (var rest = next - place; rest > 1u; rest -= 1u) {
                place += 1u;
                chosen_lights[index * chosen + place] = vec2<u32>(NO_POINT, 0u);
            }
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
        let emit = lights[from_light].emit;
        let flux = lights[from_light].flux;
        let at = number * slots + i;
        listed_lights[at].position = lights[from_light].position;
        listed_lights[at].normal = lights[from_light].normal;
        listed_lights[at].emit = vec4<f32>(emit.xyz * times, emit.w);
        listed_lights[at].wi = lights[from_light].wi;
        listed_lights[at].flux = vec4<f32>(flux.xyz * times, flux.w);
        listed_lights[at].f0 = lights[from_light].f0;
    }
}
#endif
#endif
