// Convolves the hard shadow of an emitter's centre, and lights the pixels by the emitter. See pass/soft_shadow.rs.
#include "frame.wgsl"
#include "work.wgsl"
#include "math.wgsl"
#include "flags.wgsl"
#include "cosine.wgsl"
#include "soft_shadows.wgsl"
#include "soft_emitter.wgsl"
#include "soft_search.wgsl"
#include "spread_out.wgsl"

@group(0) @binding(1) var<storage, read> soft_emitter: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> steps: array<Step>;
@group(0) @binding(3) var source: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var<storage, read> point_geometric: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> point_shading: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> point_wo: array<vec4<f32>>;
@group(0) @binding(7) var blockers: texture_storage_2d<rgba32float, read>;
@group(0) @binding(8) var<storage, read> soft_windows: array<f32>;
@group(0) @binding(9) var soft_quads: texture_storage_2d<rgba32float, read>;
@group(0) @binding(10) var<storage, read_write> soft_direct: array<vec4<f32>>;      // irradiance; w: 0
var<immediate> push: Push;

// Points on the emitter along each of its edges. Host twin: pass::soft_shadow::ALONG_EDGE.
const ALONG_EDGE: u32 = 4u;

// Interpolates the four quads around a pixel of x. Returns the ratio of the narrow kernels, 0: there are none; share of the others that is lit, of
// quads without a kernel `hard`.
fn between_quads(at: vec2<u32>, x: vec3<f32>, n: vec3<f32>, hard: f32) -> vec2<f32> {
    // The point of a quad is that of its first pixel, but at outlines.
    let place = 0.5 * vec2<f32>(at);
    let first = floor(place);
    let part = place - first;
    let last = vec2<i32>((frame.size.xy - 1u) / 2u);
    var ratio = vec2<f32>(0.0);
    var share = vec2<f32>(0.0);
    for (var i = 0u; i < 4u; i += 1u) {
        let step = vec2<u32>(i & 1u, i / 2u);
        let quad = clamp(vec2<i32>(first) + vec2<i32>(step), vec2<i32>(0), last);
        let shares = select(1.0 - part, part, step == vec2<u32>(1u));
        let weight = shares.x * shares.y;
        let found = textureLoad(soft_quads, quad);
        let counts = found.w != QUAD_UNKNOWN && on_plane(x, n, found.xyz);
        let of_kernel = select(hard, QUAD_LIT - found.w, found.w < 0.0);
        ratio += select(vec2<f32>(0.0), weight * vec2<f32>(found.w, 1.0), counts && found.w > 0.0);
        share += select(vec2<f32>(0.0), weight * vec2<f32>(of_kernel, 1.0), counts && found.w <= 0.0);
    }
    return vec2<f32>(ratio.x / max(ratio.y, 1e-6), select(hard, share.x / max(share.y, 1e-6), share.y > 0.0));
}

// Irradiance by the whole emitter without shadows, clipped like that of virtual lights.
fn unshadowed(x: vec3<f32>, geometric: vec3<f32>, shading: vec3<f32>) -> vec3<f32> {
    let step = soft_emitter[1].xyz / f32(ALONG_EDGE);
    let next = soft_emitter[2].xyz / f32(ALONG_EDGE);
    let normal = soft_emitter[3].xyz;
    let exponent = soft_emitter[1].w;
    let radiance = soft_emitter[5].xyz * soft_emitter[0].w;
    let clip2 = frame.right.w;
    let corner = soft_emitter[4].xyz + 0.5 * (step + next) - x;
    var sum = 0.0;
    for (var i = 0u; i < ALONG_EDGE * ALONG_EDGE; i += 1u) {
        let d = corner + f32(i % ALONG_EDGE) * step + f32(i / ALONG_EDGE) * next;
        sum += by_cosines(d, normal, geometric, shading, clip2);
    }
    // A loop, because it runs zero times where all emitters have the cosine law; apart, so that the other one holds no loop.
    for (var once = select(1u, 0u, exponent == 1.0); once > 0u; once -= 1u) {
        sum = 0.0;
        for (var i = 0u; i < ALONG_EDGE * ALONG_EDGE; i += 1u) {
            let d = corner + f32(i % ALONG_EDGE) * step + f32(i / ALONG_EDGE) * next;
            let cosine = max(-dot(d, normal), 0.0) / sqrt(max(dot(d, d), 1e-37));
            sum += by_cosines(d, normal, geometric, shading, clip2) * cosine_falloff(cosine, exponent);
        }
    }
    return radiance * (sum / f32(ALONG_EDGE * ALONG_EDGE));
}

// Light that arrives from a point d away of an emitter with the cosine law, over its radiance and area.
fn by_cosines(d: vec3<f32>, normal: vec3<f32>, geometric: vec3<f32>, shading: vec3<f32>, clip2: f32) -> f32 {
    let r2 = max(dot(d, d), 1e-37);
    let emitted = max(-dot(d, normal), 0.0);
    let received = select(0.0, max(dot(d, shading), 0.0), dot(d, geometric) > 0.0);
    return emitted * received / (r2 * max(r2, clip2));
}

// A workgroup for each tile of 8 x 8 pixels.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tiles = (frame.size.xy + 7u) / 8u;
    let index = group.x + group.y * groups.x;
    let place = pixel_of_tile(spread_out(min(index, tiles.x * tiles.y - 1u), tiles.x * tiles.y), lane);
    // No early return: loads under a condition are slow on lavapipe.
    let at = min(place, frame.size.xy - 1u);
    let inside = all(at == place) && index < tiles.x * tiles.y;
    let pixel = at.x + at.y * frame.size.x;
    let clears = steps[push.step].clears != 0u;
    let counts = inside && has_flag(point_wo[pixel].w, SOFT);
    let own = textureLoad(source, vec2<i32>(at));
    let n = point_geometric[pixel].xyz;
    let shading = point_shading[pixel].xyz;
    let whole = unshadowed(own.xyz, n, shading);
    let kernel = soft_kernel(soft_view(), soft_light(), own.xyz, n);
    let before = select(vec3<f32>(0.0), soft_direct[pixel].xyz, !clears);
    let greatest = select(0.0, soft_windows[soft_tile_of(at)], counts);
    var share = hard_share(own.w);
    // Loops that run zero times skip work on every device.
    for (var once = select(0u, 1u, greatest > 0.0); once > 0u; once -= 1u) {
        let of_quad = textureLoad(soft_quads, vec2<i32>(at / 2u));
        let agrees = of_quad.w != QUAD_UNKNOWN && on_plane(own.xyz, n, of_quad.xyz);
        let between = between_quads(at, own.xyz, n, share);
        // A quad may show several surfaces.
        let alone = !agrees && (is_lit(own.w) || is_blocked(own.w));
        var ratio = select(0.0, between.x, agrees && of_quad.w > 0.0);
        share = select(share, between.y, agrees && of_quad.w <= 0.0);
        for (var here = select(0u, 1u, alone || ratio > 0.0); here > 0u; here -= 1u) {
            for (var search = select(0u, 1u, alone); search > 0u; search -= 1u) {
                ratio = mean_ratio(kernel, at, own.xyz, n, greatest);
            }
            for (var convolve = select(0u, 1u, ratio > 0.0); convolve > 0u; convolve -= 1u) {
                share = lit_share(kernel, at, own, n, ratio);
            }
        }
    }
    if inside {
        soft_direct[pixel] = vec4<f32>(select(vec3<f32>(0.0), before + share * whole, counts), 0.0);
    }
}
