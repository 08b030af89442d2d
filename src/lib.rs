//! Global illumination without noise as a sum over virtual lights, in Vulkan compute.

pub mod accel;
pub mod bsdf;
pub mod engine;
pub mod error;
pub mod fingerprint;
pub mod frame;
pub mod gpu;
pub mod light;
pub mod output;
pub mod pass;
pub mod path_trace;
pub mod plan;
pub mod sampling;
pub mod scene;
pub mod scene_buffers;
pub mod settings;
pub mod standalone;

pub use error::{Error, Result};
