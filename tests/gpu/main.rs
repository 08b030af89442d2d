//! Tests on a Vulkan device (Mesa's lavapipe will do). Where there is none they fail; they never skip.
//!
//! One binary, so that one device serves all tests; each test's turn ends with a look at the validation layer's messages.

mod gpu_layer;
mod renderer;
mod scenes;
mod support;
mod transport;
