//! Pseudo-random numbers by hashing integers: no state, the same in any order and on any processor.

/// A 32-bit permutation of good avalanche (PCG's output function, as chosen by Jarzynski and Olano 2020).
pub fn hash(x: u32) -> u32 {
    let state = x.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Combines four numbers into a key: seed, stream (a constant of [`super::dimensions`]), and the stream's two indices.
pub fn key(seed: u32, stream: u32, a: u32, b: u32) -> u32 {
    let mut k = hash(seed ^ stream.wrapping_mul(0x9e37_79b9));
    k = hash(k ^ a);
    k.wrapping_add(b.wrapping_mul(0x85eb_ca6b))
}

/// Uniform in [0, 1), a multiple of 2^-24.
pub fn random_f32(key: u32) -> f32 {
    (hash(key) >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_has_fixed_values() {
        // A change here changes every image.
        assert_eq!([hash(0), hash(1), hash(u32::MAX)], [129_708_002, 2_831_084_092, 3_861_530_882]);
    }

    #[test]
    fn uniform_and_uncorrelated() {
        let n = 1 << 16;
        let (mut mean, mut square, mut product) = (0.0f64, 0.0f64, 0.0f64);
        for i in 0..n {
            let (x, y) = (f64::from(random_f32(key(1, 2, i, 0))), f64::from(random_f32(key(1, 2, i, 1))));
            assert!((0.0..1.0).contains(&x));
            mean += x / f64::from(n);
            square += x * x / f64::from(n);
            product += x * y / f64::from(n);
        }
        // Five standard deviations.
        let tolerance = 5.0 * 0.3 / f64::from(n).sqrt();
        assert!((mean - 0.5).abs() < tolerance, "{mean}");
        assert!((square - 1.0 / 3.0).abs() < tolerance, "{square}");
        assert!((product - 0.25).abs() < tolerance, "{product}");
    }

    #[test]
    fn keys_differ() {
        let mut keys = std::collections::HashSet::new();
        for seed in 0..4 {
            for stream in 0..8 {
                for a in 0..40 {
                    for b in 0..40 {
                        keys.insert(key(seed, stream, a, b));
                    }
                }
            }
        }
        // 51,200 draws of 2^32 collide 0.3 times on average.
        assert!(keys.len() >= 51_200 - 4, "{}", keys.len());
    }
}
