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

// Index of the light that a particle leaves at a vertex; each class of pixels has a set of lights. Particle i of class k of K is
// number i K + k, so that the particles that continue come first in every class.
fn light_slot(particle: u32, first: u32) -> u32 {
    return particle % frame.pattern.z * frame.pattern.w + first + particle / frame.pattern.z;
}

// The two sample coordinates of a particle for its start (j = 0) or for the direction that leaves its vertex j - 1:
// dimensions 2j and 2j + 1 of its point of the sequence, jittered if asked
// (Keller 1997, 4.1: by the grid resolution 1/N_j).
fn walk_numbers(j: u32, particle: u32) -> vec2<f32> {
    // The classes of pixels take consecutive segments of the sequence.
    let of_class = particle / frame.pattern.z;
    let index = frame.walk.x + particle % frame.pattern.z * frame.walk.y + (of_class + frame.walk.z) % frame.walk.y;
    let x = sequence_point(j, index);
    let range = bitcast<f32>(frame.depths[j].z) * f32(frame.keys.z & 1u);
    let xi = vec2<f32>(random(key(frame.keys.x, STREAM_JITTER, particle, 2u * j)), random(key(frame.keys.x, STREAM_JITTER, particle, 2u * j + 1u)));
    let moved = min(xi * range, vec2<f32>(ONE_MINUS_EPSILON));
    return vec2<f32>(rotate(x.x, moved.x), rotate(x.y, moved.y));
}
