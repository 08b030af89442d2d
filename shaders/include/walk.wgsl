// Numbers of the quasi-random walk. Needs frame.wgsl and math.wgsl. CPU twin: pass::walk_start::walk_numbers.
#include "sobol.wgsl"

// Dimensions 2j and 2j + 1 of a point of the sequence, randomised for the instance: Halton points by rotation, Sobol' points by XOR.
fn sequence_point(j: u32, index: u32) -> vec2<f32> {
    if (frame.keys.z & 2u) != 0u {
        return unit(sobol(j, index) ^ frame.sobol[j].xy);
    }
    let shifts = frame.shifts[j];
    let bases = bitcast<vec2<u32>>(shifts.zw);
    return vec2<f32>(
        rotate(radical_inverse(bases.x, index), shifts.x),
        rotate(radical_inverse(bases.y, index), shifts.y),
    );
}

// Whether the path of a particle begins in this pass. In a ring of lights one does, and the others keep their lights.
fn begins(particle: u32) -> bool {
    return frame.lists.w == 0u || particle + 1u == frame.lists.w;
}

// The weight of a particle after its j-th reflection: 1 without roulette, else 0 or the inverse of the probability to survive. CPU twin:
// ring::survives.
fn roulette(j: u32, particle: u32) -> f32 {
    let probability = frame.cones.w;
    let survives = random(key(frame.keys.x, STREAM_ROULETTE, particle, j)) < probability;
    return select(select(0.0, 1.0 / max(probability, 1e-3), survives), 1.0, probability == 0.0);
}

// Index of the light that a particle leaves at a vertex; each class of pixels has a set of lights. Particle i of class k of K is
// number i K + k, so that the particles that continue come first in every class.
fn light_slot(particle: u32, first: u32) -> u32 {
    return particle % frame.pattern.z * frame.pattern.w + first + particle / frame.pattern.z;
}

// The two sample coordinates of the light that a particle leaves on an emitter: N_0 consecutive points of a scrambled
// (0, 2)-sequence a pass, of an own scrambling for each instance and class of pixels.
fn first_light_numbers(particle: u32) -> vec2<f32> {
    let of_class = particle / frame.pattern.z;
    let pixels = particle % frame.pattern.z;
    let words = sobol(0u, frame.size.w * frame.depths[0].x + of_class);
    return unit(vec2<u32>(
        scrambled(words.x, key(frame.keys.y, STREAM_FIRST_LIGHT, pixels, 0u)),
        scrambled(words.y, key(frame.keys.y, STREAM_FIRST_LIGHT, pixels, 1u)),
    ));
}

// 1 / b^n, the grid resolution of the first `count` radical inverses, b^(n-1) < count <= b^n.
fn grid_resolution(base: u32, count: u32) -> f32 {
    var cells = 1u;
    while cells < count {
        cells *= base;
    }
    return 1.0 / f32(cells);
}

// The two sample coordinates of a particle for its start (j = 0) or for the direction that leaves its vertex j - 1:
// dimensions 2j and 2j + 1 of its point of the sequence, jittered if asked
// (Keller 1997, 4.1: by the grid resolution of the points in use).
fn walk_numbers(j: u32, particle: u32) -> vec2<f32> {
    // The classes of pixels take consecutive segments of the sequence, in an order that turns at random from pass to pass: in a fixed
    // order each of 9 classes would have some first digits in base 3 more often than others.
    let classes = frame.pattern.z;
    let of_class = particle / classes;
    let segment = (particle + frame.keys.x % classes) % classes;
    let index = frame.walk.x + segment * frame.walk.y + (of_class + frame.walk.z) % frame.walk.y;
    let x = sequence_point(j, index);
    let jittered = (frame.keys.z & 1u) != 0u;
    // N_1 particles start, and N_j get a direction to their j-th vertex.
    let count = select(1u, frame.depths[max(j, 1u)].x, jittered);
    let bases = select(bitcast<vec2<u32>>(frame.shifts[j].zw), vec2<u32>(2u), (frame.keys.z & 2u) != 0u);
    let range = select(0.0, 1.0, jittered) * vec2<f32>(grid_resolution(bases.x, count), grid_resolution(bases.y, count));
    let xi = vec2<f32>(random(key(frame.keys.x, STREAM_JITTER, particle, 2u * j)), random(key(frame.keys.x, STREAM_JITTER, particle, 2u * j + 1u)));
    let moved = min(xi * range, vec2<f32>(ONE_MINUS_EPSILON));
    return vec2<f32>(rotate(x.x, moved.x), rotate(x.y, moved.y));
}
