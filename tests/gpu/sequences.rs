//! Low-discrepancy points in shaders, bit for bit equal to the host's.

use lightsum::gpu::{Buffer, Kernel, Memory, download, upload};
use lightsum::sampling::random::hash;
use lightsum::sampling::sobol::{DIMENSIONS, column_pairs, sobol};

use crate::support::{AWKWARD_SIZES, SENTINEL, gpu_test, kernels};

#[test]
fn sobol_points_of_a_shader_are_those_of_the_host() {
    gpu_test(|ctx| {
        let kernel = Kernel::new(ctx, &kernels::SOBOL_POINTS).unwrap();
        let columns = upload(ctx, "columns", &column_pairs()).unwrap();
        for size in AWKWARD_SIZES {
            // Small indices, and others of all 32 bits.
            let index = |i: u32| if i.is_multiple_of(3) { i } else { hash(i) };
            let wanted: Vec<[u32; 2]> = (0..size as u32).map(|i| [i % (DIMENSIONS as u32 / 2), index(i)]).collect();
            let asked = upload(ctx, "wanted", &wanted).unwrap();
            let words = Buffer::new(ctx, "words", 8 * (size as u64 + 3), Memory::Device).unwrap();
            let named = [("wanted", (&asked).into()), ("words", (&words).into()), ("sobol_columns", (&columns).into())];
            let bindings = kernel.bind(&named).unwrap();
            ctx.submit_and_wait("points", None, |rec| {
                rec.fill(&words, SENTINEL)?;
                rec.dispatch(&kernel, &bindings, &[], size.div_ceil(64) as u64)
            })
            .unwrap();
            let found = download::<[u32; 2]>(ctx, &words).unwrap();
            for (word, [j, index]) in found.iter().zip(&wanted) {
                let expected = [0, 1].map(|d| sobol(2 * *j as usize + d, *index));
                assert_eq!(*word, expected, "pair {j} of point {index}");
            }
            assert_eq!(found[size..], [[SENTINEL; 2]; 3]);
        }
    });
}
