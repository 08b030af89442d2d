//! Global illumination without noise as a sum over virtual lights, in Vulkan compute.

pub mod accel;
pub mod bsdf;
pub mod error;
pub mod light;
pub mod output;
pub mod path_trace;
pub mod sampling;
pub mod scene;
pub mod settings;

pub use error::{Error, Result};
