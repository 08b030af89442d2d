// Search for what blocks the light of a pixel's neighbours. Needs soft_shadows.wgsl, and `blockers`: for each quad a blocked point and
// its word; 0: none.

// Samples of the search. Host twin: pass::soft_shadow::SEARCH.
const SEARCH: u32 = 64u;
// Pixels by which kernels reach farther in the search: one answer serves a quad. Host twin: pass::soft_shadow::MARGIN.
const MARGIN: f32 = 1.5;
// Weight of blockers beside lit pixels: they are at the outline of what blocks. Host twin: pass::soft_shadow::EDGE_WEIGHT.
const EDGE_WEIGHT: f32 = 8.0;

// Ratio of a blocker, times its weight; its weight.
fn weighted(word: f32) -> vec2<f32> {
    let weight = select(1.0, EDGE_WEIGHT, (bitcast<u32>(word) & BLOCKER_AT_EDGE) != 0u);
    return weight * vec2<f32>(ratio_in(word), 1.0);
}

// Mean ratio of the blockers whose kernels reach x, shown at a pixel; 0: none do. `greatest`: that of all blockers around; `samples`: SEARCH, or 0
// to look for none.
fn mean_ratio(light: SoftLight, at: vec2<u32>, x: vec3<f32>, n: vec3<f32>, greatest: f32, samples: u32) -> f32 {
    let kernel = soft_kernel(light, x, n);
    let widest = bounded_ratio(greatest, half_extent(kernel));
    let margin = MARGIN / max(vec2<f32>(sqrt(dot(kernel.a, kernel.a)), sqrt(dot(kernel.b, kernel.b))), vec2<f32>(1e-6));
    let own = blockers[quad_of(at)];
    let own_counts = samples > 0u && own.w > 0.0 && on_surface(x, n, own);
    var sum = select(vec2<f32>(0.0), weighted(own.w), own_counts);
    for (var i = 0u; i < samples; i += 1u) {
        // Denser near the middle, where narrow kernels must find each other.
        let p = 2.0 * spread_point(i, SEARCH) - 1.0;
        let along = (0.5 * widest + margin) * p * abs(p);
        let place = vec2<i32>(floor(vec2<f32>(at) + 0.5 + kernel_offset(kernel, along)));
        let safe = clamp(place, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
        let blocker = blockers[quad_of(vec2<u32>(safe))];
        let reaches = all(abs(along) <= 0.5 * ratio_in(blocker.w) + margin);
        let counts = all(safe == place) && blocker.w > 0.0 && reaches && on_surface(x, n, blocker);
        sum += select(vec2<f32>(0.0), weighted(blocker.w), counts);
    }
    return sum.x / max(sum.y, 1.0);
}
