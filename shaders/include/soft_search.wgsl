// Search for what blocks the light of a pixel's neighbours, and the convolution. Needs soft_shadows.wgsl, `blockers`: for each quad a blocked
// point and its word, 0: none; and `source`: of each pixel its point and word.

// Pixels by which kernels reach farther in the search: one answer serves a quad. Host twin: pass::soft_shadow::MARGIN.
const MARGIN: f32 = 1.5;
// Weight of blockers beside lit pixels: they are at the outline of what blocks. Host twin: pass::soft_shadow::EDGE_WEIGHT.
const EDGE_WEIGHT: f32 = 8.0;

// Samples of the search, and of the convolution, in so many pixels across. Host twins: pass::soft_shadow::{searches_of, samples_of}.
fn searches_of(width: f32) -> u32 {
    return select(32u, 16u, width <= 6.0);
}

fn samples_of(width: f32) -> u32 {
    return select(select(64u, 32u, width <= 32.0), 16u, width <= 3.0);
}

// Ratio of a blocker, times its weight; its weight.
fn weighted(word: f32) -> vec2<f32> {
    let weight = select(1.0, EDGE_WEIGHT, (bitcast<u32>(word) & BLOCKER_AT_EDGE) != 0u);
    return weight * vec2<f32>(ratio_in(word), 1.0);
}

// Mean ratio of the blockers whose kernels reach x, shown at a pixel; 0: none do. `greatest`: that of all blockers around.
fn mean_ratio(kernel: SoftKernel, at: vec2<u32>, x: vec3<f32>, n: vec3<f32>, greatest: f32) -> f32 {
    let extent = half_extent(kernel);
    let widest = bounded_ratio(greatest, extent);
    let margin = MARGIN / max(vec2<f32>(sqrt(dot(kernel.a, kernel.a)), sqrt(dot(kernel.b, kernel.b))), vec2<f32>(1e-6));
    let own = textureLoad(blockers, vec2<i32>(at / 2u));
    let own_counts = own.w > 0.0 && on_surface(x, n, own);
    var sum = select(vec2<f32>(0.0), weighted(own.w), own_counts);
    let count = searches_of(2.0 * (widest * extent + MARGIN));
    for (var i = 0u; i < count; i += 1u) {
        // Denser near the middle, where narrow kernels must find each other.
        let p = 2.0 * spread_point(i, count) - 1.0;
        let along = (0.5 * widest + margin) * p * abs(p);
        let place = vec2<i32>(floor(vec2<f32>(at) + 0.5 + kernel_offset(kernel, along)));
        let safe = clamp(place, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
        let blocker = textureLoad(blockers, safe / 2);
        let reaches = all(abs(along) <= 0.5 * ratio_in(blocker.w) + margin);
        let counts = all(safe == place) && blocker.w > 0.0 && reaches && on_surface(x, n, blocker);
        sum += select(vec2<f32>(0.0), weighted(blocker.w), counts);
    }
    return sum.x / max(sum.y, 1.0);
}

// Share of x that is lit, without a kernel. A point that does not face the centre has no hard shadow of its own.
fn hard_share(word: f32) -> f32 {
    return select(1.0, 0.0, is_blocked(word));
}

// Share of the kernel that is lit. `own`: point and word at a pixel.
fn lit_share(kernel: SoftKernel, at: vec2<u32>, own: vec4<f32>, n: vec3<f32>, ratio: f32) -> f32 {
    let extent = half_extent(kernel);
    let bounded = bounded_ratio(ratio, extent);
    let count = samples_of(2.0 * bounded * extent);
    var sum = vec2<f32>(0.0);
    for (var i = 0u; i < count; i += 1u) {
        let along = bounded * (spread_point(i, count) - 0.5);
        let place = vec2<i32>(floor(vec2<f32>(at) + 0.5 + kernel_offset(kernel, along)));
        let safe = clamp(place, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
        let found = textureLoad(source, safe);
        let lit = is_lit(found.w);
        let counts = all(safe == place) && (lit || is_blocked(found.w)) && on_surface(own.xyz, n, found);
        sum += select(vec2<f32>(0.0), vec2<f32>(select(0.0, 1.0, lit), 1.0), counts);
    }
    return select(hard_share(own.w), sum.x / max(sum.y, 1.0), sum.y > 0.0);
}
