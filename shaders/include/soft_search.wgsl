// Search for what blocks the light of a pixel's neighbours. Needs soft_shadows.wgsl, and `blockers`: for each quad a blocked point, and the
// ratio of its kernel; 0: none.

// Samples of the search. Host twin: pass::soft_shadow::SEARCH.
const SEARCH: u32 = 64u;

// Mean ratio of the blockers whose kernels reach x, shown at a pixel; 0: none do. `greatest`: that of all blockers around; `samples`: SEARCH, or 0
// to look for none.
fn mean_ratio(light: SoftLight, at: vec2<u32>, x: vec3<f32>, n: vec3<f32>, greatest: f32, samples: u32) -> f32 {
    let kernel = soft_kernel(light, x, n);
    let widest = bounded_ratio(greatest, half_extent(kernel));
    let own = blockers[quad_of(at)];
    let own_counts = samples > 0u && own.w > 0.0 && on_surface(x, n, own.xyz);
    var sum = select(0.0, own.w, own_counts);
    var count = select(0.0, 1.0, own_counts);
    for (var i = 0u; i < samples; i += 1u) {
        // Denser near the middle, where narrow kernels must find each other.
        let p = 2.0 * spread_point(i, SEARCH) - 1.0;
        let along = (0.5 * widest) * p * abs(p);
        let place = vec2<i32>(floor(vec2<f32>(at) + 0.5 + kernel_offset(kernel, along)));
        let safe = clamp(place, vec2<i32>(0), vec2<i32>(frame.size.xy) - 1);
        let blocker = blockers[quad_of(vec2<u32>(safe))];
        let reaches = max(abs(along.x), abs(along.y)) <= 0.5 * blocker.w;
        let counts = all(safe == place) && blocker.w > 0.0 && reaches && on_surface(x, n, blocker.xyz);
        sum += select(0.0, blocker.w, counts);
        count += select(0.0, 1.0, counts);
    }
    return sum / max(count, 1.0);
}
