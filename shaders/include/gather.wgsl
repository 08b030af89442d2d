// Rays that gather the light that clipping removes. Needs frame.wgsl and math.wgsl. Host twins: pass::gather::{point, survival}.

// The pass's sample point, randomised for each slot: Halton points by rotation, Sobol' points by XOR.
fn gather_point(slot: u32, bounce: u32, stream: u32) -> vec2<f32> {
    let sample = sample_of(slot);
    let keys = vec2<u32>(key(frame.keys.y, stream, sample, 2u * bounce), key(frame.keys.y, stream, sample, 2u * bounce + 1u));
    let bases = bitcast<vec2<u32>>(frame.shifts[bounce].zw);
    let halton = vec2<f32>(
        rotate(radical_inverse(bases.x, frame.size.w), random(keys.x)),
        rotate(radical_inverse(bases.y, frame.size.w), random(keys.y)),
    );
    let sobol = unit(frame.sobol[bounce].zw ^ vec2<u32>(hash(keys.x), hash(keys.y)));
    return select(halton, sobol, (frame.keys.z & 2u) != 0u);
}

// Russian roulette: probability that a path goes on by a reflection of this weight, from the second ray on.
fn gather_survival(weight: vec3<f32>, bounce: u32) -> f32 {
    return select(min(max(weight.x, max(weight.y, weight.z)), 1.0), 1.0, bounce == 0u);
}
