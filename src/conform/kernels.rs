//! Kernels that stand for no pass: one operation each of what drivers must do.

use crate::gpu::{BindingInfo, BindingKind, Shader};

include!(concat!(env!("OUT_DIR"), "/conform_shaders.rs"));

/// Push constants of `kernels/fill.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct FillPush {
    /// Elements to write.
    pub count: u32,
    /// Factor of their old values.
    pub scale: u32,
}

/// Push constants of `kernels/reduce.wgsl`.
#[repr(C)]
pub struct ReducePush {
    /// Elements to read.
    pub count: u32,
}

/// Output of `kernels/reduce.wgsl`.
#[repr(C)]
pub struct Totals {
    /// Sum of all values.
    pub sum: u32,
    /// The largest one.
    pub largest: u32,
}

mod layout_checks {
    use super::{FillPush, ReducePush, Totals};
    use crate::pass::layout::{LevelRecord, TextureRecord};

    include!(concat!(env!("OUT_DIR"), "/conform_layout_checks.rs"));
}
