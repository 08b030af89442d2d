// Takes away emission that paths found by an unlikely component. See pass/outliers.rs. Two kernels.
// FIND: how much. Without: takes it away. GAIN: and notes it.
#include "frame.wgsl"
#include "work.wgsl"
#include "listed_tile.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#if FIND
#include "radiance.wgsl"
#endif

#if FIND
@group(0) @binding(1) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> throughput: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> region: array<u32>;
#else
@group(0) @binding(7) var<storage, read_write> emitted: array<vec4<f32>>;
#if GAIN
@group(0) @binding(12) var<storage, read_write> path_gain: array<vec4<f32>>;
#endif
#endif
@group(0) @binding(9) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(10) var<storage, read> tiles: array<u32>;
@group(0) @binding(11) var<storage, read_write> removed: array<vec4<f32>>;  // of each slot

#if FIND
// Host twin: pass::outliers::ABOVE.
const ABOVE: f32 = 2.0;

fn radiance_of(slot: u32) -> vec3<f32> {
    return emitted[slot].xyz + throughput[slot].xyz * reflected_radiance(point_kd[slot].xyz, lighting_of(slot));
}

// The greatest four of five values, four of them in order.
fn greatest(four: vec4<f32>, value: f32) -> vec4<f32> {
    let first = max(four.x, value);
    let rest = min(four.x, value);
    let second = max(four.y, rest);
    let third_rest = min(four.y, rest);
    let third = max(four.z, third_rest);
    return vec4<f32>(first, second, third, max(four.w, min(four.z, third_rest)));
}

// Emission of a slot beyond what its neighbours in the tile show; `component`: first slot of its component.
fn excess(at: vec2<u32>, component: u32) -> vec3<f32> {
    let slot = component + at.x + at.y * frame.size.x;
    let own = radiance_of(slot);
    let own_grey = mean3(own);
    let corner = at & vec2<u32>(0xfffffff8u);
    let last = min(corner + 6u, max(frame.size.xy, vec2<u32>(2u)) - 2u);
    let middle = clamp(at, min(corner + 1u, last), last);
    var four = vec4<f32>(0.0);
    for (var i = 0u; i < 9u; i += 1u) {
        let there = vec2<i32>(middle) + vec2<i32>(i32(i % 3u) - 1, i32(i / 3u) - 1);
        let inside = all(there >= vec2<i32>(0)) && all(there < vec2<i32>(frame.size.xy));
        let other = select(slot, component + u32(there.x) + u32(there.y) * frame.size.x, inside);
        let grey = mean3(radiance_of(other));
        // Pixels that the image does not have count as this one.
        four = greatest(four, select(grey, 0.0, inside && other == slot));
    }
    let above = max(own_grey - ABOVE * four.w, 0.0);
    return min(frame.lens.z * above / max(own_grey, 1e-30) * own, emitted[slot].xyz);
}
#endif

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = listed_pixel(group, groups, lane);
    if pixel == NO_POINT {
        return;
    }
    let at = place_of_pixel(pixel);
#if FIND
    // Images of planes are spread later.
    let mirrors = frame.superposition.x > 0u;
    let spreads = mirrors && region[select(0u, pixel, mirrors)] != 0u;
    for (var component = 0u; component < 2u; component += 1u) {
        let slot = pixel + component * frame.size.z;
        var more = vec3<f32>(0.0);
        let found = has_flag(point_wo[slot].w, UNLIKELY | DEEP) && !spreads && mean3(emitted[slot].xyz) > 0.0;
        // A loop, because it runs zero times if no path of the subgroup found any.
        for (var i = select(0u, 1u, found); i > 0u; i -= 1u) {
            more = excess(at, component * frame.size.z);
        }
        removed[slot] = vec4<f32>(more, 0.0);
    }
#else
    let first = removed[pixel];
    let second = removed[pixel + frame.size.z];
    emitted[pixel] -= first;
    emitted[pixel + frame.size.z] -= second;
#if GAIN
    path_gain[pixel] -= first + second;
#endif
#endif
}
