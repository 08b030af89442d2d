//! Global illumination without noise as a sum over virtual lights, in Vulkan compute.

pub mod error;
pub mod gpu;
pub mod pass;
pub mod scene;
pub mod settings;

pub use error::{Error, Result};
