//! Checks that end badly on purpose, to show that every bad end is noticed.

use std::time::Duration;

use super::kernels::dispatch_touches_its_elements;
use crate::conform::{Bench, Must, kernels};
use crate::error::Error;
use crate::gpu::{Buffer, Memory};

pub fn a_broken_kernel_fails(bench: &Bench) {
    dispatch_touches_its_elements(bench, &kernels::BROKEN_FILL);
}

pub fn an_error_of_the_driver_is_one(_: &Bench) {
    Err::<(), _>(Error::DeviceLost { during: "a test".into() }).must();
}

pub fn what_the_device_lacks_is_named(bench: &Bench) {
    Buffer::new(bench, "too large", bench.info().max_storage_buffer_range.saturating_add(4), Memory::Device).must();
}

pub fn a_crash_is_one(_: &Bench) {
    std::process::abort();
}

/// Longer than anybody waits.
pub fn what_does_not_end_is_ended(_: &Bench) {
    std::thread::sleep(Duration::from_secs(3600));
}
