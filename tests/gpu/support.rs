//! One device for all tests of this binary, observed by the validation layer.

use std::sync::{Mutex, OnceLock, PoisonError};

use lightsum::gpu::{BindingInfo, BindingKind, Context, ContextOptions, Shader};

/// Kernels of the tests, from `kernels/`.
pub mod kernels {
    use super::{BindingInfo, BindingKind, Shader};

    include!(concat!(env!("OUT_DIR"), "/test_shaders.rs"));
}

/// Push constants of `kernels/fill.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct FillPush {
    pub count: u32,
    pub scale: u32,
}

/// Push constants of `kernels/reduce.wgsl`.
#[repr(C)]
pub struct ReducePush {
    pub count: u32,
}

/// Output of `kernels/reduce.wgsl`.
#[repr(C)]
pub struct Totals {
    pub sum: u32,
    pub largest: u32,
}

mod layout_checks {
    use super::{FillPush, ReducePush, Totals};

    include!(concat!(env!("OUT_DIR"), "/test_layout_checks.rs"));
}

/// Initial content of outputs, which reveals elements that were not written.
pub const SENTINEL: u32 = 0xdead_beef;

/// Sizes that reveal off-by-one mistakes.
pub const AWKWARD_SIZES: [usize; 4] = [1, 27, 64, 2049];

/// Options of the tests' device: the one named by LIGHTSUM_DEVICE, else any; kernels with bounds checks if
/// LIGHTSUM_CHECKED is set.
pub fn options() -> ContextOptions {
    ContextOptions {
        device: std::env::var("LIGHTSUM_DEVICE").map_or_else(
            |_| Default::default(),
            |name| name.parse().unwrap_or_else(|e| panic!("LIGHTSUM_DEVICE: {e}")),
        ),
        validation: true,
        checked_shaders: std::env::var_os("LIGHTSUM_CHECKED").is_some(),
        pipeline_cache: None,
    }
}

/// Runs a test on the shared device, alone, and fails it if the validation layer reported anything.
pub fn gpu_test(test: impl FnOnce(&Context)) {
    static CONTEXT: OnceLock<Result<Context, String>> = OnceLock::new();
    static TURN: Mutex<()> = Mutex::new(());
    // The failure of an earlier test does not affect the next one.
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let ctx = CONTEXT
        .get_or_init(|| Context::headless(&options()).map_err(|e| e.to_string()))
        .as_ref()
        .unwrap_or_else(|e| panic!("the tests need a Vulkan device and the validation layer: {e}"));
    ctx.take_messages();
    test(ctx);
    assert_silent(ctx.take_messages());
}

/// Fails if there are messages.
pub fn assert_silent(messages: Vec<String>) {
    assert!(messages.is_empty(), "the validation layer reports:\n{}", messages.join("\n\n"));
}
