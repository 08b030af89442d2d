// Two rounds of rays at edges. Needs frame.wgsl and edge_rays.wgsl.

// Host twins: pass::edges::{MAX_RAYS, ROUNDS}.
const MAX_RAYS: u32 = 8u;
const ROUNDS: u32 = 2u;

// Host twin: pass::edges::FULL_PASSES.
const FULL_PASSES: f32 = 4.0;

// Weight of the rays. Host twin: pass::edges::weight_in_pass.
fn weight_in_pass() -> f32 {
    return min(1.0, FULL_PASSES * frame.shift.w);
}

// The word of a pixel at an edge, from the lowest bit on: 4 bits, its rays in the first round; 6 bits, the place of its first ray in its
// tile; 5 bits, 1 + its rays of the rounds before whose light is known; 4 bits, its rays in the second round. `edges_mark` leaves 1 for
// the latter where surfaces differ.
const AT_EDGE: u32 = 1024u;
const SURFACES_DIFFER: u32 = 32768u;

fn edge_word(first: u32, place: u32, word: u32, second: u32) -> u32 {
    return first | (place << 4u) | (word & 0x7c00u) | (second << 15u);
}

fn rays_in_round(round: u32, word: u32) -> u32 {
    return select(word >> 15u, word & 15u, round == 0u);
}

fn place_of_first(word: u32) -> u32 {
    return (word >> 4u) & 63u;
}

fn known_of(word: u32) -> u32 {
    return (word >> 10u) & 31u;
}

// Offset of ray k of a round in its pixel. Host twin: pass::edges::offset_in_round.
fn offset_in_round(round: u32, k: u32, word: u32) -> vec2<f32> {
    let first = word & 15u;
    return ray_offset(select(k, first + k, round > 0u), first + (word >> 15u));
}
