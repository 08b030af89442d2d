//! Results of the comparisons of a check, and the error that ended it.
//!
//! A check is one thread's work from begin to end, as a test is, so its findings are the thread's.

use std::cell::RefCell;

use crate::error::Error;

/// An error beside the bound that it must not exceed, both in the unit of what was compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// The error.
    pub error: f32,
    /// Its bound.
    pub bound: f32,
}

/// Results of the comparisons of a check.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// Comparisons that were counted; those of whole arrays, bit for bit, are not.
    pub compared: u64,
    /// Those that differ by more than their bound: rounding decides a few (a ray through an edge, a number at a threshold).
    pub differing: u64,
    /// The error that is largest relative to its bound, of those within.
    pub worst: Option<Worst>,
    /// The error of the library or the driver at which the check ended.
    pub(super) problem: Option<Problem>,
}

/// Why a check could not be carried out.
#[derive(Clone, Debug)]
pub(super) enum Problem {
    /// The device lacks what this names.
    Lacks(String),
    /// A call failed.
    Failed(String),
}

thread_local! {
    static FINDINGS: RefCell<Findings> = RefCell::default();
}

/// Takes the findings of this thread since the last call.
pub fn take() -> Findings {
    FINDINGS.take()
}

/// An error within its bound.
pub fn error(error: f32, bound: f32) {
    FINDINGS.with_borrow_mut(|findings| {
        if findings.worst.is_none_or(|worst| error * worst.bound > worst.error * bound) {
            findings.worst = Some(Worst { error, bound });
        }
    });
}

/// Comparisons, and how many of them differ.
pub fn compared(count: usize, differing: usize) {
    FINDINGS.with_borrow_mut(|findings| {
        findings.compared += count as u64;
        findings.differing += differing as u64;
    });
}

/// Values of operations that must succeed.
pub trait Must<T> {
    /// The value; an error ends the check, which [`super::run`] then reports as such and not as a failure.
    fn must(self) -> T;
}

impl<T> Must<T> for Result<T, Error> {
    #[track_caller]
    fn must(self) -> T {
        self.unwrap_or_else(|error| {
            let problem = if is_lack(&error) { Problem::Lacks } else { Problem::Failed };
            FINDINGS.with_borrow_mut(|findings| findings.problem = Some(problem(error.to_string())));
            panic!("{error}")
        })
    }
}

/// Whether an error tells that the device has too little for a check, and not that something went wrong.
fn is_lack(error: &Error) -> bool {
    match error {
        Error::DeviceLimit { .. } | Error::NoDevice(_) => true,
        Error::Shader { message, .. } => message.contains("the device takes") || message.contains("needs subgroup"),
        _ => false,
    }
}
