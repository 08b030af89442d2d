//! The Hammersley point set.

use super::halton::radical_inverse;

/// Point `i` of the two-dimensional Hammersley set of `count` points: (i / count, radical inverse of i in base 2).
pub fn hammersley(i: u32, count: u32) -> [f32; 2] {
    [(f64::from(i) / f64::from(count)) as f32, radical_inverse(2, i)].map(|x| x.min(super::ONE_MINUS_EPSILON))
}

#[cfg(test)]
mod tests {
    use super::super::halton::tests::star_discrepancy;
    use super::*;

    #[test]
    fn star_discrepancy_as_known() {
        // Halton and Zaremba 1969: N D* = m/3 + 13/9 - (-1)^m 4/(9 2^m) for N = 2^m, m >= 2.
        for m in 2..=6 {
            let n = 1u32 << m;
            let points: Vec<[f64; 2]> = (0..n).map(|i| hammersley(i, n).map(f64::from)).collect();
            let sign = if m % 2 == 0 { 1.0 } else { -1.0 };
            let expected = (f64::from(m) / 3.0 + 13.0 / 9.0 - sign * 4.0 / (9.0 * f64::from(n))) / f64::from(n);
            let found = star_discrepancy(&points);
            assert!((found - expected).abs() < 1e-6, "N = {n}: {found} for {expected}");
        }
    }

    #[test]
    fn a_permutation() {
        // One point in each row and each column: a special case of N rooks.
        let n = 64;
        let mut rows = vec![false; n as usize];
        for i in 0..n {
            let [x, y] = hammersley(i, n);
            assert_eq!(x, i as f32 / 64.0);
            assert!(!std::mem::replace(&mut rows[(y * 64.0) as usize], true));
        }
    }
}
