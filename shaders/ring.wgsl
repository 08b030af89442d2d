// Puts the image of a step into a ring of images in place of the oldest, and keeps the sum of the ring. See pass/ring.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "radiance.wgsl"
#include "exact_sum.wgsl"
#include "addends.wgsl"
#include "left_out.wgsl"

@group(0) @binding(1) var<storage, read> status: array<u32>;
@group(0) @binding(2) var<storage, read_write> ring: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_kd: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_f0: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> emitted: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> direct: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> indirect: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> specular: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> sum_color: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> rest_color: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> tail_color: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> sum_direct: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> sum_indirect: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> sum_albedo: array<vec4<f32>>;
@group(0) @binding(17) var<storage, read_write> sum_normal: array<vec4<f32>>;
@group(0) @binding(18) var<storage, read_write> counts: array<u32>;     // [0]: images in the ring
@group(0) @binding(19) var<storage, read> throughput: array<vec4<f32>>; // of mirrors and glass before the shading point; w: depth
var<immediate> push: Push;  // number of the image in its buffer

// A pixel in 64 bits: mantissas of 16 bits, coverage in 128ths, and the exponent of a unit as in a float; 0: no image yet.
fn encoded(v: vec4<f32>) -> vec2<u32> {
    let c = max(v.xyz, vec3<f32>(0.0));
    let most = max(max(c.x, c.y), c.z);
    let exponent = max(bitcast<u32>(most) >> 23u, 16u) - 15u;
    let per_unit = bitcast<f32>((254u - exponent) << 23u);
    let m = min(vec3<u32>(round(c * per_unit)), vec3<u32>(65535u));
    let covered = u32(round(clamp(v.w, 0.0, 1.0) * 128.0));
    return vec2<u32>(m.x | (m.y << 16u), m.z | (covered << 16u) | (exponent << 24u));
}

fn decoded(word: vec2<u32>) -> vec4<f32> {
    let unit = bitcast<f32>((word.y >> 24u) << 23u);
    let m = vec3<f32>(vec3<u32>(word.x & 0xffffu, word.x >> 16u, word.y & 0xffffu));
    return vec4<f32>(m * unit, f32((word.y >> 16u) & 0xffu) * (1.0 / 128.0));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    // A step that lost rays, or with a value that is no number, leaves no trace.
    if pixel >= frame.size.z || (status[0] | status[1]) != 0u {
        return;
    }
    let place = push.step * frame.size.z + pixel;
    let old = ring[place];
#if COUNT
    // Before the others read it.
    if pixel == 0u && (old.y >> 24u) == 0u {
        counts[0] += 1u;
    }
#else
    let added = addends_of(pixel);
    let new_word = encoded(added.color);
    ring[place] = new_word;
    // Exact: what comes in goes out again without a trace.
    let more = sum_with(sum_color[pixel], rest_color[pixel], decoded(new_word));
    let less = sum_with(more.high, more.middle, -decoded(old));
    let low = two_sum(less.middle, (tail_color[pixel] + more.error) + less.error);
    let high = two_sum(less.high, low.sum);
    let middle = two_sum(high.error, low.error);
    sum_color[pixel] = high.sum;
    rest_color[pixel] = middle.sum;
    tail_color[pixel] = middle.error;
    // The layers are those of the step: as many times as the sums of colour are divided by. Where it shows nothing, depth is that of the
    // background.
    let images = f32(counts[0]);
    let hit = has_flag(point_wo[pixel].w, COVERED);
    let depth = select(frame.forward.w, throughput[pixel].w, hit);
    sum_direct[pixel] = vec4<f32>(added.direct.xyz * images, depth * high.sum.w);
    sum_indirect[pixel] = vec4<f32>(added.indirect * images, 0.0);
    sum_albedo[pixel] = in_guide_units(if_number(added.albedo)) * images;
    sum_normal[pixel] = in_guide_units(if_number(added.normal)) * images;
#endif
}
