// Convolves the hard shadow of an emitter's centre, and lights the pixels by the emitter. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "emitters.wgsl"
#include "cosine.wgsl"
#include "soft_shadows.wgsl"
#include "soft_search.wgsl"
#include "spread_out.wgsl"

@group(0) @binding(1) var<storage, read> emitters: array<EmitterRecord>;
@group(0) @binding(2) var<storage, read> steps: array<Step>;
@group(0) @binding(3) var<storage, read> source: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> blockers: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> soft_windows: array<f32>;
@group(0) @binding(9) var<storage, read> ratios: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> soft_direct: array<vec4<f32>>;      // irradiance; w: 0
var<immediate> push: Push;

// Points on the emitter along each of its edges. Host twin: pass::soft_shadow::ALONG_EDGE.
const ALONG_EDGE: u32 = 4u;

// Samples of a kernel that is so many pixels wide. Host twin: pass::soft_shadow::samples_of.
fn samples_of(width: f32) -> u32 {
    return select(select(64u, 32u, width <= 8.0), 16u, width <= 3.0);
}

// Ratio between those of the four quads around a pixel; 0: nothing to convolve. `quads`: 4, or 0 to look at none.
fn ratio_between(at: vec2<u32>, x: vec3<f32>, n: vec3<f32>, quads: u32) -> f32 {
    let place = 0.5 * vec2<f32>(at) - 0.25;
    let first = floor(place);
    let part = place - first;
    let last = vec2<i32>((frame.size.xy - 1u) / 2u);
    var sum = vec2<f32>(0.0);
    for (var i = 0u; i < quads; i += 1u) {
        let step = vec2<u32>(i & 1u, i / 2u);
        let quad = vec2<u32>(clamp(vec2<i32>(first) + vec2<i32>(step), vec2<i32>(0), last));
        let shares = select(1.0 - part, part, step == vec2<u32>(1u));
        let found = ratios[quad_of(2u * quad)];
        let counts = found.w > 0.0 && on_plane(x, n, found.xyz);
        sum += select(vec2<f32>(0.0), shares.x * shares.y * vec2<f32>(found.w, 1.0), counts);
    }
    return sum.x / max(sum.y, 1e-6);
}

// Share of the kernel that is lit.
fn lit_share(light: SoftLight, at: vec2<u32>, own: vec4<f32>, n: vec3<f32>, ratio: f32) -> f32 {
    let kernel = soft_kernel(light, own.xyz, n);
    let bounded = bounded_ratio(ratio, half_extent(kernel));
    let count = select(0u, samples_of(2.0 * bounded * half_extent(kernel)), ratio > 0.0);
    var sum = vec2<f32>(0.0);
    for (var i = 0u; i < count; i += 1u) {
        let along = bounded * (spread_point(i, count) - 0.5);
        let place = vec2<i32>(floor(vec2<f32>(at) + 0.5 + kernel_offset(kernel, along)));
        let safe = clamp(place, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
        let found = source[u32(safe.y) * frame.size.x + u32(safe.x)];
        let lit = is_lit(found.w);
        let counts = all(safe == place) && (lit || is_blocked(found.w)) && on_surface(own.xyz, n, found);
        sum += select(vec2<f32>(0.0), vec2<f32>(select(0.0, 1.0, lit), 1.0), counts);
    }
    // A point that does not face the centre has no hard shadow of its own.
    let hard = select(1.0, 0.0, is_blocked(own.w));
    return select(hard, sum.x / max(sum.y, 1.0), sum.y > 0.0);
}

// Irradiance by the whole emitter without shadows, clipped like that of virtual lights.
fn unshadowed(e: EmitterRecord, x: vec3<f32>, geometric: vec3<f32>, shading: vec3<f32>) -> vec3<f32> {
    var sum = 0.0;
    for (var i = 0u; i < ALONG_EDGE * ALONG_EDGE; i += 1u) {
        let along = (vec2<f32>(vec2<u32>(i % ALONG_EDGE, i / ALONG_EDGE)) + 0.5) / f32(ALONG_EDGE);
        let d = e.p0.xyz + along.x * e.e1.xyz + along.y * e.e2.xyz - x;
        let r2 = max(dot(d, d), 1e-37);
        let wi = d / sqrt(r2);
        let cosine = max(-dot(wi, e.normal.xyz), 0.0);
        let intensity = cosine_power(cosine, e.flux.w);
        let received = select(0.0, max(dot(wi, shading), 0.0), dot(wi, geometric) > 0.0);
        sum += select(0.0, intensity * received / max(r2, frame.right.w), cosine > 0.0);
    }
    return e.radiance.xyz * (e.e1.w * sum / f32(ALONG_EDGE * ALONG_EDGE));
}

// A workgroup for each tile of 8 x 8 pixels.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tiles = (frame.size.xy + 7u) / 8u;
    let index = group.x + group.y * groups.x;
    if index >= tiles.x * tiles.y {
        return;
    }
    let at = pixel_of_tile(spread_out(index, tiles.x * tiles.y), lane);
    if any(at >= frame.size.xy) {
        return;
    }
    let pixel = at.x + at.y * frame.size.x;
    let step = steps[push.step];
    let before = select(vec3<f32>(0.0), soft_direct[pixel].xyz, step.clears == 0u);
    if !has_flag(point_wo[pixel].w, SOFT) {
        soft_direct[pixel] = vec4<f32>(0.0);
        return;
    }
    let light = soft_light(step.first);
    let own = source[pixel];
    let n = point_geometric[pixel].xyz;
    let of_quad = ratios[quad_of(at)];
    let greatest = soft_windows[soft_tile_of(at)];
    // A quad may show several surfaces.
    let agrees = on_plane(own.xyz, n, of_quad.xyz);
    let alone = !agrees && greatest > 0.0 && (is_lit(own.w) || is_blocked(own.w));
    let searched = mean_ratio(light, at, own.xyz, n, greatest, select(0u, SEARCH, alone));
    let between = ratio_between(at, own.xyz, n, select(0u, 4u, agrees && greatest > 0.0));
    let ratio = select(between, searched, alone);
    let share = lit_share(light, at, own, n, ratio);
    let e = unshadowed(emitters[frame.soft_emitters[step.first / 4u][step.first & 3u]], own.xyz, n, point_shading[pixel].xyz);
    soft_direct[pixel] = vec4<f32>(before + share * e, 0.0);
}
