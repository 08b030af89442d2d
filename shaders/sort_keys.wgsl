// Writes the keys of the shading points on a list: the class in the upper bits, below it the Morton code of the position. See pass/sort.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "sort.wgsl"

@group(0) @binding(1) var<storage, read_write> work: DispatchCounts;
@group(0) @binding(2) var<storage, read> list: array<u32>;
@group(0) @binding(3) var<storage, read> point_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> keys: array<vec2<u32>>;

// Slots without a shading point go to the end.
const DEAD_KEY: u32 = 0xffffffffu;

// Spreads 8 bits to every third bit.
fn spread_bits(x: u32) -> u32 {
    var y = x & 0xffu;
    y = (y | (y << 8u)) & 0x00f00fu;
    y = (y | (y << 4u)) & 0x0c30c3u;
    y = (y | (y << 2u)) & 0x249249u;
    return y;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let slot = (group.x + group.y * groups.x) * 64u + lane;
    if slot >= work.total {
        return;
    }
    let pixel = list[slot];
    if pixel == NO_POINT {
        keys[slot] = vec2<u32>(DEAD_KEY, pixel);
        return;
    }
    let unit = (point_position[pixel].xyz - frame.bounds_min.xyz) * frame.bounds_min.w;
    let cell = vec3<u32>(clamp(unit * 256.0, vec3<f32>(0.0), vec3<f32>(255.0)));
    let bits = class_bits(frame.pattern.z);
    let code = spread_bits(cell.x) | (spread_bits(cell.y) << 1u) | (spread_bits(cell.z) << 2u);
    keys[slot] = vec2<u32>(min((code >> bits) | (class_of(pixel) << (24u - bits)), 0xfffffeu), pixel);
}
