//! The comparisons of the checks notice what they must, and the list names kernels that exist.

use std::collections::HashSet;
use std::panic::catch_unwind;

use glam::Vec3;
use lightsum::conform::tally::{STRAYS, Tally, close, within};
use lightsum::conform::{ALL, findings, kernels};
use lightsum::gpu::shaders;

/// Whether a tally of a thousand comparisons, some of which fail with these values, fails.
fn fails(failures: usize, found: Vec3) -> bool {
    let count = move || {
        let mut tally = Tally::new("a comparison");
        for i in 0..1000 {
            let found = if i < failures { found } else { Vec3::ONE };
            let holds = close(found, Vec3::ONE, 1e-4, 0.0);
            tally.check_values(holds, &[(found, Vec3::ONE)], || format!("{i}: {found}"));
        }
        tally.finish(STRAYS);
    };
    catch_unwind(count).is_err()
}

#[test]
fn a_broken_kernel_fails_its_comparison() {
    assert!(!fails(0, Vec3::ONE), "what is equal");
    assert!(!fails(1000, Vec3::splat(1.0 + 5e-5)), "what is within the bound");
    assert!(!fails(1, Vec3::splat(1.1)), "one that rounding decides");
    assert!(fails(2, Vec3::splat(1.1)), "more of them");
    assert!(fails(1, Vec3::splat(2.5)), "one far off");
    assert!(fails(1, Vec3::new(1.0, f32::NAN, 1.0)), "one that is no number");
}

#[test]
fn the_worst_error_is_that_nearest_to_its_bound() {
    findings::take();
    assert!(
        within(-0.5, 1.0) && within(3.0f32, 4.0f32) && within(0.0, 0.0) && !within(9.0, 8.0) && !within(f64::NAN, 1.0)
    );
    assert!(close(Vec3::ONE, Vec3::ONE, 0.1, 0.0));
    let worst = findings::take().worst.unwrap();
    assert_eq!((worst.error, worst.bound), (3.0, 4.0));
    assert!(findings::take().worst.is_none());
}

#[test]
fn checks_are_named_once_and_name_kernels_that_exist() {
    let names: HashSet<_> = ALL.iter().map(|check| check.name).collect();
    assert_eq!(names.len(), ALL.len());
    let all: Vec<&str> = shaders::ALL.iter().chain(kernels::ALL).map(|shader| shader.name).collect();
    for check in ALL {
        for stem in check.kernels.split_whitespace() {
            let is_one =
                |name: &&str| name.strip_prefix(stem).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'));
            assert!(all.iter().any(is_one), "{}: there is no kernel {stem}", check.name);
        }
        assert!(!check.exercises().is_empty(), "{} exercises nothing", check.name);
    }
}

#[test]
fn the_page_tells_how_many_checks_and_kernels_there_are() {
    let kernels: HashSet<&str> = ALL.iter().flat_map(|check| check.kernels.split_whitespace()).collect();
    let told = format!("{} checks of {} compute kernels", ALL.len(), kernels.len());
    let page = include_str!("../../docs/conformance.md");
    let words: Vec<&str> = page.split_whitespace().collect();
    assert!(words.join(" ").contains(&told), "docs/conformance.md should say: {told}");
}
