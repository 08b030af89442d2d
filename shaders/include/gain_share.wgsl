// The part of the filter's mean gain that is bias. Needs its sums bound as `sum_gain` and `rest_gain`. CPU twins: pass::gain::{moments, share}.

// Host twins: pass::gain::{MIN_PASSES, SIGNIFICANCE}.
const MIN_PASSES: f32 = 4.0;
const SIGNIFICANCE: f32 = 1.5;

// Square of the mean gain of a pixel, and the variance of that mean.
fn gain_moments(pixel: u32, passes: f32) -> vec2<f32> {
    let sum = sum_gain[pixel] + rest_gain[pixel];
    let mean = (sum.x + sum.y + sum.z) / (3.0 * passes);
    return vec2<f32>(mean * mean, max(sum.w / passes - mean * mean, 0.0) / (passes - 1.0));
}

// Of the pixel at a place of an image of this size, after so many passes.
fn biased_share(at: vec2<u32>, size: vec2<u32>, passes: f32) -> f32 {
    if passes < MIN_PASSES {
        return 0.0;
    }
    var sum = vec2<f32>(0.0);
    for (var i = 0u; i < 25u; i += 1u) {
        let place = vec2<i32>(at) + vec2<i32>(i32(i % 5u) - 2, i32(i / 5u) - 2);
        let inside = all(place >= vec2<i32>(0)) && all(place < vec2<i32>(size));
        let there = vec2<u32>(select(vec2<i32>(at), place, inside));
        sum += select(vec2<f32>(0.0), gain_moments(there.x + there.y * size.x, passes), inside);
    }
    let noise = SIGNIFICANCE * (passes - 1.0) / (passes - 3.0) * sum.y;
    return select(0.0, (sum.x - noise) / sum.x, sum.x > noise);
}
