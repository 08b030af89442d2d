#![no_main]

#[path = "../readers.rs"]
mod readers;

libfuzzer_sys::fuzz_target!(init: readers::watch_panics(|_| std::process::abort()), |bytes: &[u8]| {
    readers::read("ply", bytes);
});
