//! The only code that calls Vulkan. It knows nothing about light.
//!
//! A [`Context`] uses its own device ([`Context::headless`]) or a host's ([`Context::adopt`]). Kernels are compiled from WGSL by the
//! build script ([`shaders`]), made into pipelines when they are first needed and shared by all users of a context;
//! [`Kernel::bind_from`] joins one with [`Buffer`]s and [`Image`]s by their names,
//! and a [`Recorder`] writes dispatches and copies into a command buffer, each followed by one global memory barrier: a
//! command sees everything that the commands before it have written. Images stay in the layout GENERAL.
//!
//! Vulkan 1.1 with a compute queue suffices; no device extension and no feature is asked for.

mod cache;
mod compile_ahead;
mod context;
mod device;
mod image;
mod instance;
mod kernel;
mod memory;
mod recorder;
mod resources;
mod snapshot;
mod staging;
#[cfg(feature = "viewer")]
pub mod surface;
mod timers;
mod usage;
#[cfg(any(feature = "hot-reload", test))]
mod wgsl;
#[cfg(test)]
mod wgsl_emit;
#[cfg(any(feature = "hot-reload", test))]
mod wgsl_parameters;
#[cfg(any(feature = "hot-reload", test))]
mod wgsl_spirv;
#[cfg(any(feature = "hot-reload", test))]
mod wgsl_texels;

pub use context::{Context, ContextOptions, HostDevice};
pub use device::{DeviceChoice, DeviceInfo, Requirements, list_devices};
pub use image::{HostImage, Image, LayerLimits};
pub use instance::Messages;
pub use kernel::{BindingInfo, BindingKind, Bindings, Bound, Kernel, Shader};
pub use memory::{Buffer, Memory};
pub use recorder::{LayerPart, Recorder, Retained};
pub use resources::Resources;
pub use snapshot::Snapshot;
pub use staging::{LayerUpload, Staging, download, upload};
pub use timers::Timers;
pub use usage::MemoryUse;

/// The kernels, compiled from `shaders/` by the build script.
pub mod shaders {
    #[allow(unused_imports, reason = "unused only while shaders/ is empty")]
    use super::{BindingInfo, BindingKind, Shader};

    include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
}

/// Compile-time checks that the structures of [`crate::pass::layout`] are those of the kernels.
mod layout_checks {
    #[allow(unused_imports, reason = "unused only while no kernel shares a structure with the host")]
    use crate::pass::layout::*;

    include!(concat!(env!("OUT_DIR"), "/layout_checks.rs"));
}
