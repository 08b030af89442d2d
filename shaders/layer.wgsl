// Writes a layer of the film as an image. See pass/layer.rs.
#include "gain_share.wgsl"

// Host twin: pass::layout::LayerPush.
struct LayerPush {
    kind: u32,      // one of those below
    unit: f32,      // depth that is shown half as bright as depth 0
    pattern: vec2<u32>, // of interleaved sampling
}

// Host twin: pass::layer::Layer.
const EMISSION: u32 = 0u;
const DIFFUSE: u32 = 1u;
const SPECULAR: u32 = 2u;
const IRRADIANCE: u32 = 3u;
const ALBEDO: u32 = 4u;
const NORMAL: u32 = 5u;
const DEPTH: u32 = 6u;
const CLASSES: u32 = 7u;
const CLUSTERS: u32 = 8u;

// The colour of a number. CPU twin: pass::layer::false_color.
fn false_color(number: u32) -> vec3<f32> {
    let hue = f32(number * 0x9e3779b9u) / 4294967296.0;
    let turned = fract(hue + vec3<f32>(0.0, 2.0 / 3.0, 1.0 / 3.0));
    return 0.2 + 0.8 * clamp(abs(turned * 6.0 - 3.0) - 1.0, vec3<f32>(0.0), vec3<f32>(1.0));
}

@group(0) @binding(0) var<storage, read> sum: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> rest: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> counts: array<u32>;    // passes in the sums of each instance
@group(0) @binding(3) var<storage, read> sum_a: array<vec4<f32>>;   // colour of each instance; w: coverage
@group(0) @binding(4) var<storage, read> sum_b: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> sum_gain: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> rest_gain: array<vec4<f32>>;
#if SUMMANDS
@group(0) @binding(8) var<storage, read> sum_diffuse: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> sum_specular: array<vec4<f32>>;
#endif
@group(0) @binding(7) var layer: texture_storage_2d<rgba32float, write>;
var<immediate> push: LayerPush;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.x + group.y * groups.x) * 64u + lane;
    let size = textureDimensions(layer);
    if pixel >= size.x * size.y {
        return;
    }
    let at = vec2<u32>(pixel % size.x, pixel / size.x);
    let passes = f32(max(counts[0] + counts[1], 1u));
    let mean = (sum[pixel] + rest[pixel]) / passes;
    var shown = mean.xyz;
#if SUMMANDS
    if push.kind == DIFFUSE || push.kind == SPECULAR {
        // Both lose the same part of themselves, the bias of the filter.
        let reflected = (sum_diffuse[pixel].xyz + sum_specular[pixel].xyz) / passes;
        let bias = biased_share(at, size, passes) * (sum_gain[pixel].xyz + rest_gain[pixel].xyz) / passes;
        let some = reflected > vec3<f32>(0.0);
        shown *= select(vec3<f32>(1.0), max(1.0 - bias / select(vec3<f32>(1.0), reflected, some), vec3<f32>(0.0)), some);
    }
#else
    if push.kind == IRRADIANCE {
        shown *= 0.31830988;
    } else if push.kind == NORMAL {
        let length = length(mean.xyz);
        shown = select(vec3<f32>(0.0), 0.5 + 0.5 * mean.xyz / max(length, 1e-20), length > 0.0);
    } else if push.kind == DEPTH {
        let covered = (sum_a[pixel].w + sum_b[pixel].w) / passes;
        let depth = mean.w / max(covered, 1e-20);
        shown = vec3<f32>(select(0.0, push.unit / (push.unit + depth), covered > 0.0));
    } else if push.kind == CLASSES || push.kind == CLUSTERS {
        let within = at % push.pattern;
        let its_class = within.x + push.pattern.x * within.y;
        // Blocks of eight times the pattern: each class in it is a cluster.
        let side = 8u * push.pattern;
        let block = at.x / side.x + (size.x + side.x - 1u) / side.x * (at.y / side.y);
        let number = select(its_class, block * push.pattern.x * push.pattern.y + its_class, push.kind == CLUSTERS);
        let albedo = min((mean.x + mean.y + mean.z) * (1.0 / 3.0), 1.0);
        shown = false_color(number) * (0.25 + 0.75 * albedo);
    }
#endif
    textureStore(layer, at, vec4<f32>(shown, 1.0));
}
