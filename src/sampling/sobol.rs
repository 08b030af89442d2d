//! The Sobol' sequence in base 2 (Sobol' 1967) with the direction numbers of Joe and Kuo, randomised by XOR (Wald et al. 2002, 4.4).
//!
//! A point is a word of 32 bits in each dimension, x / 2^32 in [0, 1): the XOR of those columns of the dimension's generator matrix
//! whose bits are set in the index. The randomised point is x XOR b with a random word b for each instance and dimension,
//! formed before the conversion to floating point. An XOR permutes the elementary intervals of every size among themselves, so
//! it preserves the net: 2^m points that start at a multiple of 2^m stay as uniform as before, and each point is uniformly distributed.
//!
//! Points are in the order of the binary index rather than of the Gray code, so that each point can be computed independently;
//! segments of 2^m points that start at a multiple of 2^m contain the same points in both orders.

use super::joe_kuo::ROWS;

/// Dimensions for which there are columns.
pub const DIMENSIONS: usize = ROWS.len() + 1;

/// For each dimension the columns of its generator matrix: column k belongs to bit k of the index, its highest bit is the first
/// digit of the component.
pub static COLUMNS: [[u32; 32]; DIMENSIONS] = columns();

const fn columns() -> [[u32; 32]; DIMENSIONS] {
    let mut columns = [[0; 32]; DIMENSIONS];
    let mut k = 0;
    while k < 32 {
        columns[0][k] = 1 << (31 - k);
        k += 1;
    }
    let mut d = 1;
    while d < DIMENSIONS {
        let (a, m) = ROWS[d - 1];
        let degree = m.len();
        let mut k = 0;
        while k < 32 {
            columns[d][k] = if k < degree {
                m[k] << (31 - k)
            } else {
                // The recurrence of the primitive polynomial (Joe and Kuo 2008, eq. 4), on v_k = m_k / 2^k.
                let oldest = columns[d][k - degree];
                let mut v = oldest ^ (oldest >> degree);
                let mut i = 1;
                while i < degree {
                    if (a >> (degree - 1 - i)) & 1 != 0 {
                        v ^= columns[d][k - i];
                    }
                    i += 1;
                }
                v
            };
            k += 1;
        }
        d += 1;
    }
    columns
}

/// Component `dimension` (below [`DIMENSIONS`]) of point `index`, as a word.
pub fn sobol(dimension: usize, index: u32) -> u32 {
    let columns = COLUMNS[dimension].iter().enumerate();
    columns.filter(|(k, _)| (index >> k) & 1 != 0).fold(0, |x, (_, column)| x ^ column)
}

/// Index of point `index` in a replication of the sequence: a random permutation that maps every segment of 2^m indices that
/// starts at a multiple of 2^m to another such segment, so the replication is as uniform as the sequence (nested uniform
/// permutation, Owen 1995, by the hash of Laine and Karras 2011).
///
/// Replications that differ only by an XOR would be correlated: an XOR of the index is one of the points.
pub fn shuffled(index: u32, seed: u32) -> u32 {
    // In the reversed word each bit depends on those below it alone.
    let mut x = index.reverse_bits().wrapping_add(seed);
    for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6_u32] {
        x ^= x.wrapping_mul(factor);
    }
    x.reverse_bits()
}

/// A word whose digits are scrambled by a nested uniform permutation (Owen 1995, by the hash of Laine and Karras 2011). Scrambling
/// each dimension by a seed of its own preserves nets, makes each point uniformly distributed, and in the finest intervals of a
/// net independent of the others: with N points the error for smooth integrands falls as N^-1.5, by an XOR as N^-1.
pub fn scrambled(word: u32, seed: u32) -> u32 {
    // The permutation that preserves segments of indices preserves intervals of words.
    shuffled(word, seed)
}

/// The columns of dimensions 2j and 2j + 1 in pairs, 32 pairs for each j, as `shaders/include/sobol.wgsl` reads them.
pub fn column_pairs() -> Vec<[u32; 2]> {
    COLUMNS.chunks_exact(2).flat_map(|pair| pair[0].iter().zip(&pair[1]).map(|(&a, &b)| [a, b])).collect()
}

/// A word as a number in [0, 1): its upper 24 bits, exactly.
pub fn unit(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::super::halton::tests::star_discrepancy;
    use super::super::random::hash;
    use super::*;

    /// The order of published values: that of the Gray code.
    fn gray(i: u32) -> u32 {
        i ^ (i >> 1)
    }

    #[test]
    fn first_points_as_published() {
        let expected = [
            [0.0, 0.0, 0.0],
            [0.5, 0.5, 0.5],
            [0.75, 0.25, 0.25],
            [0.25, 0.75, 0.75],
            [0.375, 0.375, 0.625],
            [0.875, 0.875, 0.125],
            [0.625, 0.125, 0.875],
            [0.125, 0.625, 0.375],
            [0.1875, 0.3125, 0.9375],
        ];
        for (i, point) in expected.iter().enumerate() {
            assert_eq!([0, 1, 2].map(|d| unit(sobol(d, gray(i as u32)))), *point, "point {i}");
        }
    }

    #[test]
    fn a_point_of_many_dimensions_as_another_program_has_it() {
        // Point 1000 by SciPy 1's `qmc.Sobol(40, scramble=False, bits=32)`.
        let expected = [
            (0, 943_718_400),
            (1, 415_236_096),
            (2, 2_227_175_424),
            (3, 2_906_652_672),
            (7, 3_862_953_984),
            (15, 1_589_641_216),
            (31, 624_951_296),
            (33, 2_545_942_528),
            (39, 2_059_403_264),
        ];
        for (d, x) in expected {
            assert_eq!(sobol(d, gray(1000)), x, "dimension {d}");
        }
    }

    #[test]
    fn the_rows_are_what_the_construction_asks_for() {
        let mut seen = std::collections::HashSet::new();
        for (row, &(a, m)) in ROWS.iter().enumerate() {
            let degree = m.len() as u32;
            for (k, &m) in m.iter().enumerate() {
                assert!(m % 2 == 1 && m < 2 << k, "row {row}: m_{} = {m}", k + 1);
            }
            // The polynomial is primitive if x has the order 2^s - 1 modulo it.
            let polynomial = (1 << degree) | (a << 1) | 1;
            let mut power = 1u32;
            let order = (1u32..).find(|_| {
                power <<= 1;
                power ^= if power >> degree != 0 { polynomial } else { 0 };
                power <= 1
            });
            assert_eq!(order, Some((1 << degree) - 1), "row {row}");
            assert!(seen.insert(polynomial), "row {row}: a polynomial has two dimensions");
        }
    }

    /// Whether 2^m points put one into each elementary interval 2^-i x 2^-(m - i) of dimensions 0 and 1, and of one dimension
    /// alone for all others.
    fn is_net(m: u32, start: u32, scramble: impl Fn(u32) -> u32) -> bool {
        let points = start..start + (1 << m);
        let full = |cells: &mut dyn Iterator<Item = u32>| {
            let mut hit = vec![false; 1 << m];
            cells.for_each(|cell| hit[cell as usize] = true);
            hit.iter().all(|&h| h)
        };
        let digits = |d: u32, i: u32, n: u32| if n == 0 { 0 } else { (sobol(d as usize, i) ^ scramble(d)) >> (32 - n) };
        (0..=m).all(|n| full(&mut points.clone().map(|i| digits(0, i, n) << (m - n) | digits(1, i, m - n))))
            && (2..DIMENSIONS as u32).all(|d| full(&mut points.clone().map(|i| digits(d, i, m))))
    }

    #[test]
    fn segments_are_nets_and_an_exclusive_or_keeps_them() {
        for m in 0..=9 {
            for segment in [0, 1, 6, 1000] {
                assert!(is_net(m, segment << m, |_| 0), "2^{m} points, segment {segment}");
                for seed in 0..3 {
                    let scramble = |d| hash(hash(seed) ^ d);
                    assert!(is_net(m, segment << m, scramble), "2^{m} points, segment {segment}, instance {seed}");
                }
            }
        }
        // A segment that does not start at a multiple of its length is none, so the test can tell.
        assert!(!is_net(4, 7, |_| 0));
    }

    #[test]
    fn shuffled_segments_are_segments() {
        let mut moved = 0;
        for seed in (0..8).map(hash) {
            for m in 0..=8 {
                for segment in [0, 1, 5] {
                    let start = segment << m;
                    let mut found: Vec<u32> = (start..start + (1 << m)).map(|i| shuffled(i, seed)).collect();
                    moved += u32::from(found.windows(2).any(|pair| pair[1] != pair[0] + 1));
                    found.sort_unstable();
                    let first = found[0];
                    assert!(first.is_multiple_of(1 << m), "2^{m} from {start}: {first}");
                    assert!((first..first + (1 << m)).eq(found), "2^{m} from {start}");
                }
            }
        }
        assert!(moved > 100, "{moved} segments are in another order");
    }

    #[test]
    fn star_discrepancy_as_known() {
        for (n, expected) in [(8, 0.3125), (16, 0.171875), (32, 0.08984375), (64, 0.0537109375)] {
            let points: Vec<[f64; 2]> = (0..n).map(|i| [0, 1].map(|d| f64::from(unit(sobol(d, i))))).collect();
            let found = star_discrepancy(&points);
            assert!((found - expected).abs() < 1e-9, "{n} points: {found} for {expected}");
        }
    }

    #[test]
    fn pairs_are_what_the_shader_expects() {
        let pairs = column_pairs();
        assert_eq!(pairs.len(), 16 * DIMENSIONS);
        for (j, index) in [(0, 1), (3, 77), (19, u32::MAX), (7, 1 << 31)] {
            let bits = (0..32).filter(|k| (index >> k) & 1 != 0);
            let word = bits.fold([0, 0], |x, k| [0, 1].map(|d| x[d] ^ pairs[32 * j + k][d]));
            assert_eq!(word, [sobol(2 * j, index), sobol(2 * j + 1, index)]);
        }
        assert!(unit(u32::MAX) < 1.0);
    }
}
