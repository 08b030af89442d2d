//! Assignment of the dimensions of the low-discrepancy sequence, and of the streams of hashed numbers.
//!
//! | consumer                                        | dimensions | Halton's bases |
//! |-------------------------------------------------|-------------------|-------|
//! | choice of the emitter where a particle starts, by composition | 0 (then rescaled to [0, 1) and used again) | 2 |
//! | point on the emitter where a particle starts    | 0, 1              | 2, 3  |
//! | emitter and point of a light, for direct light  | 0, 1 of Sobol', scrambled by stream `FIRST_LIGHT` | |
//! | offset in the pixel                             | 0, 1 of Sobol', scrambled by stream `OFFSET` | |
//! | direction of segment j of a particle, j in 0..16 | 2j + 2, 2j + 3   | 5, 7; 11, 13; ... |
//! | gather ray of bounce b                          | 2b, 2b + 1, rotated by stream `GATHER` | 2, 3; 5, 7; ... |
//! | photon: direction; emitter and point; target    | 0, 1; 2, 3; 4, rotated by stream `PHOTON` | 2, 3; 5, 7; 11 |
//! | particle of splats: as a particle               | those of a particle, of Sobol', scrambled by stream `SPLAT` | |
//!
//! Sobol' points use the same dimensions, without bases; they are randomised by XOR instead of rotation. Their gather rays
//! are padded replications: every bounce uses dimensions 0 and 1, each in its own order (stream `REPLICA`).
//!
//! Segment 0 leaves the emitter, segment j leaves the j-th reflection. Photons use their own sequence, which begins at
//! index 0 and has another rotation: their light is added to that of the particles, so the two need not be independent.
//!
//! | stream      | consumer of [`super::random::key`], with its two indices |
//! |-------------|-----------------------------------------------------------|
//! | [`SIDE`]    | side of a two-sided emitter: particle, 0                  |
//! | [`LOBE`]    | diffuse or specular reflection: particle, reflection      |
//! | [`JITTER`]  | jitter of a Halton component: particle, dimension         |
//! | [`ROTATION`]| rotation or XOR of the whole set: dimension, 0 |
//! | [`GATHER`]  | rotation of the gather ray: pixel, dimension              |
//! | [`PIXEL`]   | everything in the path tracer: pixel, running number      |
//! | [`GATHER_LOBE`] | lobe of the gather ray: pixel, bounce                 |
//! | [`GATHER_ROULETTE`] | whether a path of gather rays goes on: pixel, bounce |
//! | [`WINDOW`]  | offset of the passes in their segments of the sequence: 0, 0 |
//! | [`OFFSET`]  | scrambling of the pixel offsets: dimension, or 2 for their order; 0 |
//! | [`COMPONENT`] | transmission or reflection: slot of the pixel, mirrors and glass so far |
//! | [`REPLICA`] | order of the Sobol' points of the gather rays: bounce, 0 |
//! | [`DELTA`]   | offset of the choice of delta lights: 0, 0             |
//! | [`MIRROR`]  | offset of the choice of lights and mirrors: 0, 0       |
//! | [`EYE_LOBE`] | direction along a lobe that an eye path follows, and whether it does: mirrors, glass and lobes so far, 0 to 2 |
//! | [`FIRST_LIGHT`] | scrambling of the points of the lights on emitters: class of pixels, dimension |
//! | [`LISTS`] | choice of the lights of clusters: pass, 0, and the light; of regions: pass, 4; representatives: corner of the cluster, 1, for regions 3 |
//! | [`ALPHA`]   | whether a surface that lets rays pass stops one: triangle, direction |
//! | [`PHOTON`]  | Cranley-Patterson rotation of the photons: dimension, 0   |
//! | [`PHOTON_SIDE`] | side of a two-sided emitter: photon, 0                |
//! | [`WALK_COMPONENT`] | transmission, reflection or base: particle, reflection and mirrors and glass so far |
//! | [`PHOTON_COMPONENT`] | transmission or reflection: photon, mirrors and glass so far |
//! | [`ROULETTE`] | absorption in a ring: particle, reflection |
//! | [`SPLAT`]   | scrambling of the points of the particles of splats: dimension, 0 |
//! | [`SPLAT_SIDE`] | side of a two-sided emitter: particle, 0                |
//! | [`SPLAT_LOBE`], [`SPLAT_COMPONENT`], [`SPLAT_ROULETTE`] | diffuse or specular; transmission, reflection or base; absorption: particle, bounces |
//! | [`AIM`]     | start of the points of rays towards near emitters: 0, dimension; from hits of near rays: pixel, 2 and 3; beside gather rays: pixel, dimension |
//! | [`BLUR`] | first sample of wide windows of motion blur: 0, 0; rows of segments: 0, 1 |

use super::halton::PRIMES;
use super::sobol;

/// Dimensions of the point on the emitter; the first also chooses the emitter.
pub const EMITTER: [usize; 2] = [0, 1];
/// Maximum number of segments of a particle's path.
pub const MAX_SEGMENTS: usize = 16;
/// Number of dimensions in use.
pub const COUNT: usize = 2 * MAX_SEGMENTS + 2;

const _: () = assert!(COUNT <= PRIMES.len() && COUNT <= sobol::DIMENSIONS);

/// Dimensions of the direction of segment `j` (0 leaves the emitter).
pub const fn direction(j: usize) -> [usize; 2] {
    [2 * j + 2, 2 * j + 3]
}

/// Stream: side of a two-sided emitter.
pub const SIDE: u32 = 1;
/// Stream: diffuse or specular reflection.
pub const LOBE: u32 = 2;
/// Stream: jitter within a raster cell.
pub const JITTER: u32 = 3;
/// Stream: rotation of the whole point set.
pub const ROTATION: u32 = 4;
/// Stream: rotation of the gather ray of each pixel.
pub const GATHER: u32 = 5;
/// Stream: the path tracer.
pub const PIXEL: u32 = 6;
/// Stream: lobe of the gather ray.
pub const GATHER_LOBE: u32 = 7;
/// Stream: offset of a pass in its segment of the sequence.
pub const WINDOW: u32 = 8;
/// Stream: scrambling of the pixel offsets.
pub const OFFSET: u32 = 9;
/// Stream: component that an eye path takes at a mirror or glass.
pub const COMPONENT: u32 = 10;
/// Stream: order of a replication of the Sobol' sequence.
pub const REPLICA: u32 = 11;
/// Stream: offset of the choice of delta lights.
pub const DELTA: u32 = 12;
/// Stream: offset of the choice of lights and mirrors.
pub const MIRROR: u32 = 13;
/// Stream: component that a particle takes at a mirror or glass.
pub const WALK_COMPONENT: u32 = 14;
/// Stream: start of the points that choose directions along lobes for eye paths.
pub const EYE_LOBE: u32 = 15;
/// Stream: scrambling of the points of the lights on emitters.
pub const FIRST_LIGHT: u32 = 16;
/// Stream: choice of the lights of a cluster.
pub const LISTS: u32 = 17;
/// Stream: near rays that go on from hits that no pixel shows, and their directions.
pub const NEAR: u32 = 18;
/// Stream: whether a surface that lets rays pass stops one.
pub const ALPHA: u32 = 19;
/// Stream: rotation of the photons' sequence.
pub const PHOTON: u32 = 20;
/// Stream: side of a two-sided emitter that a photon leaves.
pub const PHOTON_SIDE: u32 = 21;
/// Stream: component that a photon takes at a mirror or glass.
pub const PHOTON_COMPONENT: u32 = 22;
/// Stream: absorption of particles in a ring.
pub const ROULETTE: u32 = 23;
/// Stream: Russian roulette of the paths of gather rays.
pub const GATHER_ROULETTE: u32 = 24;
/// Stream: scrambling of the points of the particles of splats.
pub const SPLAT: u32 = 25;
/// Stream: side of a two-sided emitter that such a particle leaves.
pub const SPLAT_SIDE: u32 = 26;
/// Stream: diffuse or specular reflection of such a particle.
pub const SPLAT_LOBE: u32 = 27;
/// Stream: component that such a particle takes at a mirror or glass.
pub const SPLAT_COMPONENT: u32 = 28;
/// Stream: absorption of such a particle.
pub const SPLAT_ROULETTE: u32 = 29;
/// Stream: first sample of wide windows, and rows of segments, of motion blur.
pub const BLUR: u32 = 30;
/// Stream: start of the points of rays towards near emitters.
pub const AIM: u32 = 31;

/// Dimensions of a photon: direction, place on the emitter (the first also chooses it), target.
pub const PHOTON_DIMENSIONS: [usize; 5] = [0, 1, 2, 3, 4];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dimensions_do_not_overlap() {
        let mut used = [false; COUNT];
        let all = (0..MAX_SEGMENTS).flat_map(direction).chain(EMITTER);
        for d in all {
            assert!(!std::mem::replace(&mut used[d], true), "dimension {d} is used twice");
        }
        assert!(used.iter().all(|&u| u));
        assert_eq!(direction(0).map(|d| PRIMES[d]), [5, 7]);
        assert_eq!(EMITTER.map(|d| PRIMES[d]), [2, 3]);
    }
}
