//! Sample points: low-discrepancy sequences, hashed random numbers, and the assignment of dimensions and streams.

pub mod dimensions;
pub mod halton;
pub mod hammersley;
pub mod joe_kuo;
pub mod random;
pub mod sobol;

/// The largest f32 below 1.
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

/// Cranley-Patterson rotation: `x + shift` modulo 1, both in [0, 1), result in [0, 1).
pub fn rotate(x: f32, shift: f32) -> f32 {
    let sum = x + shift;
    // Exact: the difference of a number in [1, 2) and 1 has no rounding.
    if sum >= 1.0 { sum - 1.0 } else { sum }
}

/// Grid resolution 1 / b^n of the first `count` radical inverses in `base`, where b^(n-1) < count <= b^n (Keller, 4.1).
pub fn grid_resolution(base: u32, count: u32) -> f32 {
    let mut power = 1u64;
    while power < u64::from(count) {
        power *= u64::from(base);
    }
    1.0 / power as f32
}

/// Jittered low-discrepancy sampling (Keller, 4.1): moves `x` within its raster cell by `xi * resolution`, `xi` in [0, 1).
///
/// The first b^n points stay in their cells. Points of a later segment of the sequence may pass 1 and wrap around,
/// which preserves their distribution.
pub fn jitter(x: f32, xi: f32, resolution: f32) -> f32 {
    rotate(x, (xi * resolution).min(ONE_MINUS_EPSILON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use halton::radical_inverse;
    use random::random_f32;

    #[test]
    fn rotation_stays_in_the_unit_interval() {
        for (x, shift) in [(0.0, 0.0), (0.5, 0.5), (ONE_MINUS_EPSILON, ONE_MINUS_EPSILON), (ONE_MINUS_EPSILON, 1e-9)] {
            let y = rotate(x, shift);
            assert!((0.0..1.0).contains(&y), "{x} + {shift} = {y}");
        }
        assert_eq!(rotate(0.75, 0.5), 0.25);
    }

    #[test]
    fn jitter_keeps_points_in_their_cells() {
        for (base, count) in [(2, 16), (2, 13), (3, 9), (3, 10), (5, 7), (7, 1)] {
            let resolution = grid_resolution(base, count);
            for i in 0..count {
                let x = radical_inverse(base, i);
                let y = jitter(x, random_f32(i), resolution);
                assert!(y >= x && y < x + resolution * 1.000_001 && y < 1.0, "base {base}, point {i}: {x} to {y}");
            }
        }
        assert_eq!(grid_resolution(2, 16), 1.0 / 16.0);
        assert_eq!(grid_resolution(2, 17), 1.0 / 32.0);
        assert_eq!(grid_resolution(3, 1), 1.0);
    }
}
