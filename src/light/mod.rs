//! How light leaves the emitters.

pub mod emitters;
pub mod targets;
