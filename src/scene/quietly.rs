//! Panics of decoders that do not check all that they read, as messages.
//!
//! The hook for panics belongs to the process, so the library installs none: in a host that has none of its own, Rust's prints a line about a
//! decoder's panic beside the error. [`panic_is_caught`] tells a program's own hook, and [`silence_caught_panics`] installs one.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local!(static CAUGHT: Cell<bool> = const { Cell::new(false) });

/// Runs `f` and returns a panic's message.
pub(crate) fn quietly<T>(f: impl FnOnce() -> T) -> Result<T, String> {
    let before = CAUGHT.replace(true);
    let result = catch_unwind(AssertUnwindSafe(f));
    CAUGHT.set(before);
    result.map_err(|payload| {
        let text = payload.downcast_ref::<String>().map(String::as_str);
        text.or(payload.downcast_ref::<&str>().copied()).unwrap_or("unknown reason").to_string()
    })
}

/// Whether a panic of this thread becomes an error of a reader, so that a hook may keep silent.
pub fn panic_is_caught() -> bool {
    CAUGHT.get()
}

/// Puts a hook before the present one that leaves out panics which become errors of readers. For programs, once, at their start.
pub fn silence_caught_panics() {
    let previous = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !panic_is_caught() {
            previous(info);
        }
    }));
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    /// The hook of the host is asked, knows that the panic is caught, and stays in its place.
    #[test]
    fn a_panic_becomes_a_message_and_the_hook_stays() {
        let told = Arc::new(AtomicU32::new(0));
        let (in_hook, own) = (told.clone(), std::thread::current().id());
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| match std::thread::current().id() == own {
            true => _ = in_hook.fetch_add(u32::from(panic_is_caught()), Ordering::Relaxed),
            false => previous(info),
        }));
        assert_eq!(quietly(|| panic!("number {}", 7)), Err::<(), _>(String::from("number 7")));
        assert_eq!(quietly(|| 3), Ok(3));
        assert!(!panic_is_caught());
        assert_eq!(quietly(|| panic!("{}", 8)), Err::<(), _>(String::from("8")));
        assert_eq!(told.load(Ordering::Relaxed), 2);
        // Not for the tests beside this one.
        drop(std::panic::take_hook());
    }
}
