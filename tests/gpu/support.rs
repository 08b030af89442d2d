//! Devices that the tests of this binary share, under the eyes of the validation layer.

use std::cell::RefCell;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

pub use lightsum::conform::{AWKWARD_SIZES, SENTINEL, kernels};
use lightsum::gpu::{Context, ContextOptions};

/// Options of the tests' device: the one named by LIGHTSUM_DEVICE, else any; kernels with bounds checks if
/// LIGHTSUM_CHECKED is set, and kernels that read storage buffers alone if LIGHTSUM_NO_TEXELS is.
pub fn options() -> ContextOptions {
    ContextOptions {
        device: std::env::var("LIGHTSUM_DEVICE").map_or_else(
            |_| Default::default(),
            |name| name.parse().unwrap_or_else(|e| panic!("LIGHTSUM_DEVICE: {e}")),
        ),
        validation: true,
        checked_shaders: std::env::var_os("LIGHTSUM_CHECKED").is_some(),
        no_texel_buffers: std::env::var_os("LIGHTSUM_NO_TEXELS").is_some(),
        pipeline_cache: None,
        max_memory: None,
        own_work: false,
    }
}

/// Tests that run at a time, each on devices of its own. A device computes on all processors but compiles on one.
const SLOTS: usize = 2;

/// The devices that one test has for itself.
struct Slot {
    /// Under the validation layer.
    watched: Context,
    /// Without it, for images of many passes.
    unwatched: Context,
}

impl Slot {
    fn new() -> Result<Slot, String> {
        let context =
            |validation| Context::headless(&ContextOptions { validation, ..options() }).map_err(|e| e.to_string());
        Ok(Slot { watched: context(true)?, unwatched: context(false)? })
    }
}

/// The slots, of which some may not have been made yet.
struct Pool {
    idle: Vec<Slot>,
    made: usize,
}

static POOL: Mutex<Pool> = Mutex::new(Pool { idle: Vec::new(), made: 0 });
static FREED: Condvar = Condvar::new();

fn pool() -> MutexGuard<'static, Pool> {
    POOL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Gives the slot back when the test is over, whether it passed or not.
struct Turn(Option<Slot>);

impl Turn {
    /// Waits for a slot.
    fn wait() -> Turn {
        let mut pool = pool();
        loop {
            if let Some(slot) = pool.idle.pop() {
                return Turn(Some(slot));
            }
            if pool.made < SLOTS {
                // Under the lock: a driver's first steps in a process are not always safe beside each other.
                let slot = Slot::new();
                pool.made += usize::from(slot.is_ok());
                drop(pool);
                return Turn(Some(slot.unwrap_or_else(|error| {
                    panic!("the tests need a Vulkan device and the validation layer: {error}")
                })));
            }
            pool = FREED.wait(pool).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        UNWATCHED.set(None);
        pool().idle.extend(self.0.take());
        FREED.notify_one();
    }
}

thread_local! {
    /// The unwatched device of the test that runs on this thread.
    static UNWATCHED: RefCell<Option<Context>> = const { RefCell::new(None) };
}

/// Runs a test on a device that it has for itself, and fails it if the validation layer had anything to say.
pub fn gpu_test(test: impl FnOnce(&Context)) {
    let turn = Turn::wait();
    let Some(slot) = &turn.0 else { unreachable!("a turn has its slot until it is dropped") };
    UNWATCHED.set(Some(slot.unwatched.clone()));
    // A test that failed in its turn says nothing about the next one.
    slot.watched.take_messages();
    test(&slot.watched);
    assert_silent(slot.watched.take_messages());
}

/// The same device without the validation layer, for a test that does the same under the layer as well.
pub fn unwatched() -> Context {
    UNWATCHED.with_borrow(|context| context.clone().expect("called within gpu_test, on its thread"))
}

/// Fails if there are messages.
pub fn assert_silent(messages: Vec<String>) {
    assert!(messages.is_empty(), "the validation layer reports:\n{}", messages.join("\n\n"));
}
