//! How light leaves the emitters.

pub mod emitters;
pub mod mirrors;
pub mod targets;
