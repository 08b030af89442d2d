#![no_main]

#[path = "../readers.rs"]
mod readers;

fn stop(panic: &str) {
    eprintln!("{panic}");
    std::process::abort();
}

libfuzzer_sys::fuzz_target!(init: readers::watch_panics(stop), |bytes: &[u8]| {
    readers::read("settings", bytes);
});
