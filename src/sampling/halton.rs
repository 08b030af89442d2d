//! Radical inverses and the Halton sequence (Keller 1997, 3.1, figures 2 and 3).

use super::ONE_MINUS_EPSILON;

/// The first 64 primes: base of each dimension.
pub const PRIMES: [u32; 64] = [
    2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, 97, 101, 103, 107, 109,
    113, 127, 131, 137, 139, 149, 151, 157, 163, 167, 173, 179, 181, 191, 193, 197, 199, 211, 223, 227, 229, 233, 239,
    241, 251, 257, 263, 269, 271, 277, 281, 283, 293, 307, 311,
];

/// Radical inverse of `i` in `base` (2 or more): the digits of `i` mirrored at the radix point; in [0, 1).
///
/// Computed so that a shader gets the same bits: the digits are reversed as an integer and there is one rounding at the
/// end. Base 2 reverses the bits and keeps the upper 24, exactly. Other bases reverse digits while the power of the base
/// fits 32 bits (at most 20 digits) and divide once. As long as that power is at most 2^24 the quotient is the correctly
/// rounded one; beyond, three roundings add up to 1.5 ulp, and digits worth less than 2^-23 are ignored.
///
/// Differs from figure 2, which sums fractions in floating point, with as many roundings as digits.
pub fn radical_inverse(base: u32, i: u32) -> f32 {
    if base == 2 {
        return (i.reverse_bits() >> 8) as f32 * (1.0 / 16_777_216.0);
    }
    let limit = u32::MAX / base;
    let (mut rest, mut reversed, mut power) = (i, 0u32, 1u32);
    while rest > 0 && power <= limit {
        let quotient = rest / base;
        reversed = reversed * base + (rest - quotient * base);
        power *= base;
        rest = quotient;
    }
    (reversed as f32 / power as f32).min(ONE_MINUS_EPSILON)
}

/// Component `dimension` (below 64) of point `i` of the Halton sequence.
pub fn halton(dimension: usize, i: u32) -> f32 {
    radical_inverse(PRIMES[dimension], i)
}

/// Successive radical inverses, each from its predecessor (Halton and Weller 1964; figure 3).
///
/// In f64: the figure's guard 1e-10 against rounding at the carry is below the resolution of f32. It holds for some
/// 1e9 points, since the smallest distance between values must stay above it.
#[derive(Clone, Copy, Debug)]
pub struct Incremental {
    inverse: f64,
    value: f64,
}

impl Incremental {
    /// The sequence in `base` from the radical inverse of 0.
    pub fn new(base: u32) -> Self {
        Incremental { inverse: 1.0 / f64::from(base), value: 0.0 }
    }

    /// The current value.
    pub fn value(&self) -> f64 {
        self.value
    }

    /// Steps to the next index.
    pub fn advance(&mut self) {
        let rest = 1.0 - self.value - 1e-10;
        if self.inverse < rest {
            self.value += self.inverse;
            return;
        }
        // Carry: find the first digit that is not the largest one.
        let (mut previous, mut h) = (self.inverse, self.inverse * self.inverse);
        while h >= rest {
            previous = h;
            h *= self.inverse;
        }
        self.value += previous + h - 1.0;
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Exact star discrepancy of points in the unit square: the supremum is taken at boxes whose upper corner has
    /// coordinates of the points or 1, once open and once closed.
    pub(crate) fn star_discrepancy(points: &[[f64; 2]]) -> f64 {
        let n = points.len() as f64;
        let axis = |d: usize| points.iter().map(move |p| p[d]).chain([1.0]);
        let mut worst = 0.0f64;
        for a in axis(0) {
            for b in axis(1) {
                let open = points.iter().filter(|p| p[0] < a && p[1] < b).count() as f64 / n;
                let closed = points.iter().filter(|p| p[0] <= a && p[1] <= b).count() as f64 / n;
                worst = worst.max(a * b - open).max(closed - a * b);
            }
        }
        worst
    }

    #[test]
    fn hand_values() {
        // Halton (2, 3) from index 0.
        let expected = [
            (0.0, 0.0),
            (0.5, 1.0 / 3.0),
            (0.25, 2.0 / 3.0),
            (0.75, 1.0 / 9.0),
            (0.125, 4.0 / 9.0),
            (0.625, 7.0 / 9.0),
            (0.375, 2.0 / 9.0),
            (0.875, 5.0 / 9.0),
            (0.0625, 8.0 / 9.0),
            (0.5625, 1.0 / 27.0),
        ];
        for (i, &(x, y)) in expected.iter().enumerate() {
            assert_eq!((halton(0, i as u32), halton(1, i as u32)), (x, y), "point {i}");
        }
        // 2024 in base 10 mirrored.
        assert_eq!(radical_inverse(10, 2024), 0.4202);
        assert_eq!(radical_inverse(5, 624), 624.0 / 625.0);
    }

    #[test]
    fn primes_are_the_first_64() {
        let sieve: Vec<u32> = (2..400u32).filter(|n| (2..*n).all(|d| n % d != 0)).take(64).collect();
        assert_eq!(PRIMES.as_slice(), sieve);
    }

    #[test]
    fn below_one_and_close_to_exact() {
        let indices = (0..2000).chain((0..32).map(|b| 1 << b)).chain([u32::MAX, u32::MAX - 1, 3u32.pow(20) - 1]);
        for i in indices {
            for base in PRIMES {
                let (mut rest, mut exact, mut weight) = (i, 0.0f64, 1.0 / f64::from(base));
                while rest > 0 {
                    exact += weight * f64::from(rest % base);
                    rest /= base;
                    weight /= f64::from(base);
                }
                let x = radical_inverse(base, i);
                assert!((0.0..1.0).contains(&x), "base {base}, {i}: {x}");
                assert!((f64::from(x) - exact).abs() < 2e-7, "base {base}, {i}: {x} for {exact}");
            }
        }
    }

    #[test]
    fn one_point_in_each_elementary_interval() {
        for base in [2u32, 3, 5, 7] {
            for n in 1..=4u32 {
                let count = base.pow(n);
                // A segment of base^n points that starts at a multiple of base^n has one point in each interval.
                for start in [0, 5 * count] {
                    let mut hit = vec![false; count as usize];
                    for i in start..start + count {
                        let cell = (f64::from(radical_inverse(base, i)) * f64::from(count) + 1e-3) as usize;
                        assert!(!std::mem::replace(&mut hit[cell], true), "base {base}, {count} points, index {i}");
                    }
                }
            }
        }
        // In two dimensions: 2^3 x 3^2 boxes, one point each.
        let mut hit = [false; 72];
        for i in 0..72 {
            let (a, b) = ((halton(0, i) * 8.0) as usize, (f64::from(halton(1, i)) * 9.0 + 1e-3) as usize);
            assert!(!std::mem::replace(&mut hit[a * 9 + b], true));
        }
    }

    #[test]
    fn star_discrepancy_as_known() {
        let points = |start: u32, n: u32| -> Vec<[f64; 2]> {
            (start..start + n).map(|i| [f64::from(halton(0, i)), f64::from(halton(1, i))]).collect()
        };
        for (start, n, expected) in [
            (0, 8, 0.319444),
            (0, 16, 0.201389),
            (0, 32, 0.104167),
            (0, 64, 0.0520833),
            (0, 128, 0.0366512),
            (1, 8, 0.222222),
            (1, 16, 0.173611),
            (1, 32, 0.0995370),
            (1, 64, 0.0520833),
            (1, 128, 0.0331790),
        ] {
            let found = star_discrepancy(&points(start, n));
            assert!((found - expected).abs() < 1e-6, "{n} points from {start}: {found} for {expected}");
        }
    }

    #[test]
    fn incremental_equals_direct() {
        for base in [2, 3, 5, 7, 29, 137, 311] {
            let mut sequence = Incremental::new(base);
            for i in 0..100_000 {
                let direct = f64::from(radical_inverse(base, i));
                assert!(
                    (sequence.value() - direct).abs() < 1e-7,
                    "base {base}, {i}: {} for {direct}",
                    sequence.value()
                );
                sequence.advance();
            }
        }
    }
}
