//! Low-discrepancy points in shaders, bit for bit equal to the host's.

use crate::conform::{Bench, Must};
use crate::gpu::{Buffer, Kernel, Memory, download, upload};
use crate::sampling::random::hash;
use crate::sampling::sobol::{DIMENSIONS, column_pairs, sobol};

use crate::conform::SENTINEL;
use crate::conform::kernels;

pub fn sobol_points_of_a_shader_are_those_of_the_host(bench: &Bench) {
    let kernel = Kernel::new(bench, &kernels::SOBOL_POINTS).must();
    let columns = upload(bench, "columns", &column_pairs()).must();
    for size in bench.sizes() {
        // Small indices, and others of all 32 bits.
        let index = |i: u32| if i.is_multiple_of(3) { i } else { hash(i) };
        let wanted: Vec<[u32; 2]> = (0..size as u32).map(|i| [i % (DIMENSIONS as u32 / 2), index(i)]).collect();
        let asked = upload(bench, "wanted", &wanted).must();
        let words = Buffer::new(bench, "words", 8 * (size as u64 + 3), Memory::Device).must();
        let named = [("wanted", (&asked).into()), ("words", (&words).into()), ("sobol_columns", (&columns).into())];
        let bindings = kernel.bind(&named).must();
        bench
            .submit_and_wait("points", None, |rec| {
                rec.fill(&words, SENTINEL)?;
                rec.dispatch(&kernel, &bindings, &[], size.div_ceil(64) as u64)
            })
            .must();
        let found = download::<[u32; 2]>(bench, &words).must();
        for (word, [j, index]) in found.iter().zip(&wanted) {
            let expected = [0, 1].map(|d| sobol(2 * *j as usize + d, *index));
            assert_eq!(*word, expected, "pair {j} of point {index}");
        }
        assert_eq!(found[size..], [[SENTINEL; 2]; 3]);
    }
}
