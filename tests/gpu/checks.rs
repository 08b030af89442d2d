//! The checks of `lightsum-conform`, each as a test.

use lightsum::conform::{self, ALL, Bench, Choices};

use crate::support::gpu_test;

/// Runs a check as a test: a panic fails it. No device that the tests run on lacks anything.
fn check(name: &str) {
    let check = ALL.iter().find(|check| check.name == name).expect("it is listed");
    gpu_test(|ctx| {
        let bench = Bench::new(ctx, Choices::default());
        assert_eq!(check.lacks(&bench), None);
        (check.run)(&bench);
        let found = conform::findings::take();
        println!("{} compared, {} differ, worst {:?}", found.compared, found.differing, found.worst);
    });
}

macro_rules! tests {
    ($($group:ident { $($name:ident($($about:expr),*);)* })*) => {
        $(mod $group {
            $(#[test]
            fn $name() {
                super::check(concat!(stringify!($group), "::", stringify!($name)));
            })*
        })*
    };
}

lightsum::each_check!(tests);
