// Systematic sampling by one workgroup of 64: chooses a number of candidates with given probabilities, each at most once. Needs
// frame.wgsl, math.wgsl and weight_of(i), the weight of a candidate. See pass/delta_choice.rs.

// Probability 1; such a candidate takes a whole slot.
const ONE: u32 = 1u << 20u;
// After this many rounds candidates no longer rise to probability 1.
const ROUNDS: u32 = 16u;

#include "stretches.wgsl"

var<workgroup> sums: array<vec2<f32>, 64>;

// The factor of the weights with which the shares fill the slots.
fn scale_of(lane: u32, stretch: Stretch, count: u32, slots: u32) -> f32 {
    // Each share may be rounded up by 1.
    let room = slots * ONE - count;
    var scale = 0.0;
    for (var round = 0u; round < ROUNDS; round += 1u) {
        // Sum of the weights below probability 1, number of candidates at it.
        var partial = vec2<f32>(0.0);
        for (var i = stretch.first; i < stretch.end; i += 1u) {
            let weight = weight_of(i);
            partial += select(vec2<f32>(weight, 0.0), vec2<f32>(0.0, 1.0), scale * weight >= f32(ONE));
        }
        sums[lane] = partial;
        workgroupBarrier();
        var whole = vec2<f32>(0.0);
        for (var k = 0u; k < 64u; k += 1u) {
            whole += sums[k];
        }
        workgroupBarrier();
        // Candidates at probability 1 are fewer than the slots, because the scale was chosen so that all fit. A little less,
        // because of the rounding of the sums.
        let left = f32(room - ONE * u32(whole.y)) * (1.0 - 1.0 / 1024.0);
        scale = select(scale, max(scale, left / whole.x), whole.x > 0.0);
    }
    return scale;
}

// Probability in units of 1 / ONE, 1 at least.
fn share_of(weight: f32, scale: f32) -> u32 {
    return 1u + u32(min(scale * weight, f32(ONE - 1u)));
}

// The shares lie one after the other on a line. A candidate is chosen if its share holds one of the points offset,
// offset + ONE, ...
fn offset_of(stream: u32, class_number: u32) -> u32 {
    let start = hash(key(frame.keys.y, stream, 0u, 0u));
    let turn = start + frame.size.w * 0x9e3779b9u + class_number * (0xffffffffu / frame.pattern.z);
    return turn >> 12u;
}

// The first slot whose point is not before `begin`.
fn slot_at(begin: u32, offset: u32) -> u32 {
    return (begin + ONE - 1u - offset) / ONE;
}
