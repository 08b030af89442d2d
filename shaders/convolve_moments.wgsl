// Mean, maximum and standard deviations of each kernel of a library. See pass/convolve.rs.
#include "convolve.wgsl"

@group(0) @binding(2) var<storage, read> kernels: array<f32>;
@group(0) @binding(3) var<storage, read_write> moments: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> narrowings: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let layer = id.x;
    if layer >= steps[push.step].layers {
        return;
    }
    var greatest = 0.0;
    var sum = 0.0;
    var first = vec2<f32>(0.0);
    var second = vec2<f32>(0.0);
    for (var i = 0u; i < TEXELS * TEXELS; i += 1u) {
        let at = (vec2<f32>(vec2<u32>(i % TEXELS, i / TEXELS)) + 0.5) * (2.0 / f32(TEXELS)) - 1.0;
        let texel = max(select(0.0, kernels[layer * TEXELS * TEXELS + i], dot(at, at) <= 1.0), 0.0);
        greatest = max(greatest, texel);
        sum += texel;
        first += texel * at;
        second += texel * at * at;
    }
    let mean = first / max(sum, 1e-30);
    let deviation = sqrt(max(second / max(sum, 1e-30) - mean * mean, vec2<f32>(0.0)));
    let scale = 1.0 / max(greatest, 1e-30);
    // The kernel is narrower along v than its texture, by the factor `aspect`.
    let narrowing = narrowings[layer];
    let aspect = exp2(-0.25 * f32(narrowing));
    moments[2u * layer] = vec4<f32>(deviation * vec2<f32>(1.0, aspect), sum * scale * aspect / f32(TEXELS * TEXELS), scale);
    // Diameter of the disc with the same geometric mean of its deviations, as a share of the kernel's diameter.
    moments[2u * layer + 1u] = vec4<f32>(clamp(2.0 * sqrt(deviation.x * deviation.y * aspect), 0.5, 1.0), f32(narrowing), 0.0, 0.0);
}
