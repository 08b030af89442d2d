// Spreads over their neighbours what unlikely components show. See pass/unlikely.rs. Two kernels.
// FIND: by how much slots differ from their neighbours. Without: spreads that. GAIN: and notes it.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#if FIND
#include "radiance.wgsl"
#endif

@group(0) @binding(2) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> region: array<u32>;
@group(0) @binding(9) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(10) var<storage, read> tiles: array<u32>;
@group(0) @binding(11) var<storage, read_write> surplus: array<vec4<f32>>;  // of each slot: radiance; throughput of the slots that share it, 0: none
#if FIND
@group(0) @binding(1) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> emitted: array<vec4<f32>>;
#else
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;
#if GAIN
@group(0) @binding(12) var<storage, read_write> path_gain: array<vec4<f32>>;
#endif
#endif

// Whether a slot at a pixel shows a component that its path chose. Images of planes are spread later, and take no part.
fn takes_part(pixel: u32, component: u32) -> bool {
    let mirrors = frame.superposition.x > 0u;
    let spreads = mirrors && region[select(0u, pixel, mirrors)] != 0u;
    return has_flag(point_wo[component + pixel].w, CHOSE) && !spreads;
}

// Middle of the 5 x 5 pixels around a pixel, moved into its tile and the image.
fn middle_of(at: vec2<u32>) -> vec2<u32> {
    let corner = at & vec2<u32>(0xfffffff8u);
    let last = min(corner + 5u, max(frame.size.xy, vec2<u32>(3u)) - 3u);
    return clamp(at, min(corner + 2u, last), last);
}

#if FIND
// Host twin: pass::unlikely::MOST.
const MOST: f32 = 0.1;

struct Around {
    likely: vec4<f32>,      // sums of radiance and of throughput of slots of likely paths
    least: f32,             // least grey among them over throughput
    all: f32,               // throughput of all slots
}

fn radiance_of(slot: u32) -> vec3<f32> {
    return emitted[slot].xyz + throughput[slot].xyz * reflected_radiance(point_kd[slot].xyz, lighting_of(slot));
}

// The slots around a pixel; `component`: first slot of theirs.
fn around(at: vec2<u32>, component: u32) -> Around {
    let middle = middle_of(at);
    var sums = Around(vec4<f32>(0.0), 3.0e38, 0.0);
    for (var i = 0u; i < 25u; i += 1u) {
        let there = vec2<i32>(middle) + vec2<i32>(i32(i % 5u) - 2, i32(i / 5u) - 2);
        // Those of other tiles may not be written.
        let inside = all(there >= vec2<i32>(0)) && all(there < vec2<i32>(frame.size.xy)) && all(there / 8 == vec2<i32>(at / 8u));
        let pixel = select(0u, u32(there.x) + u32(there.y) * frame.size.x, inside);
        let takes = inside && takes_part(pixel, component);
        let through = mean3(throughput[component + pixel].xyz);
        sums.all += select(0.0, through, takes);
        let likely = takes && through > 0.0 && !has_flag(point_wo[component + pixel].w, UNLIKELY);
        let radiance = radiance_of(component + pixel);
        sums.likely += select(vec4<f32>(0.0), vec4<f32>(radiance, through), likely);
        sums.least = min(sums.least, select(3.0e38, mean3(radiance) / through, likely));
    }
    return sums;
}

fn surplus_of(at: vec2<u32>, component: u32) -> vec4<f32> {
    let sums = around(at, component);
    let slot = component + at.x + at.y * frame.size.x;
    let expected = mean3(throughput[slot].xyz) / max(sums.likely.w, 1e-30) * sums.likely.xyz;
    let more = radiance_of(slot) - expected;
    let most = MOST * sums.all * max(sums.least, 0.0);
    let given = frame.lens.z * min(1.0, most / max(abs(mean3(more)), 1e-30)) * more;
    return select(vec4<f32>(0.0), vec4<f32>(given, sums.all), sums.likely.w > 0.0);
}
#else
// Sum of the parts of the surplus that a slot receives, over its throughput; `component`: first slot of its component.
fn share_of(at: vec2<u32>, component: u32) -> vec3<f32> {
    let corner = at & vec2<u32>(0xfffffff8u);
    var sum = vec3<f32>(0.0);
    for (var i = 0u; i < 64u; i += 1u) {
        let there = corner + vec2<u32>(i & 7u, i / 8u);
        let inside = all(there < frame.size.xy);
        let more = surplus[component + select(0u, there.x + there.y * frame.size.x, inside)];
        let middle = middle_of(there);
        // Differences of unsigned numbers would wrap.
        let near = all(at + 2u >= middle) && all(at <= middle + 2u);
        sum += select(vec3<f32>(0.0), more.xyz / max(more.w, 1e-30), inside && near && more.w > 0.0);
    }
    return sum;
}
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let at = place_of_pixel(pixel);
#if GAIN
    var gain = vec3<f32>(0.0);
#endif
    for (var component = 0u; component < 2u; component += 1u) {
        let slot = pixel + component * frame.size.z;
        let takes = takes_part(pixel, component * frame.size.z);
#if FIND
        var more = vec4<f32>(0.0);
        // A loop, because it runs zero times if no path of the subgroup was unlikely.
        for (var i = select(0u, 1u, takes && has_flag(point_wo[slot].w, UNLIKELY)); i > 0u; i -= 1u) {
            more = surplus_of(at, component * frame.size.z);
        }
        surplus[slot] = more;
#else
        var change = vec3<f32>(0.0);
        // Not where no path of the subgroup chose.
        for (var i = select(0u, 1u, takes); i > 0u; i -= 1u) {
            change = mean3(throughput[slot].xyz) * share_of(at, component * frame.size.z) - surplus[slot].xyz;
        }
        emitted[slot] += vec4<f32>(change, 0.0);
#if GAIN
        gain += change;
#endif
#endif
    }
#if GAIN
    path_gain[pixel] += vec4<f32>(gain, 0.0);
#endif
}
