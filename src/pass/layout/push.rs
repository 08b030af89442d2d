//! Push constants.

use bytemuck::{Pod, Zeroable};

/// Push constants of every pass.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Push {
    /// Index into the table of steps.
    pub step: u32,
}

/// Push constants of `display`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DisplayPush {
    /// Factor of the radiance.
    pub scale: f32,
    /// The curve, see [`Curve`](crate::pass::display::Curve).
    pub curve: u32,
}

/// Push constants of `g_buffer_read`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct GBufferPush {
    /// Columns of the matrix from clip space to world space.
    pub world_from_clip: [[f32; 4]; 4],
    /// Depth of pixels that see nothing.
    pub background: f32,
    /// By which points are moved along their geometric normals, scene units.
    pub offset: f32,
    /// Bits, see below.
    pub bits: u32,
    /// Zero.
    pub unused: u32,
}

impl GBufferPush {
    /// Places are told by depth.
    pub const BY_DEPTH: u32 = 1;
    /// There are geometric normals.
    pub const HAS_GEOMETRIC: u32 = 2;
    /// There is specular reflectance.
    pub const HAS_SPECULAR: u32 = 4;
    /// There is emission.
    pub const HAS_EMISSION: u32 = 8;
    /// Normals are stored in [0, 1].
    pub const NORMALS_FROM_0: u32 = 16;
    /// Geometric normals are stored in [0, 1].
    pub const GEOMETRIC_FROM_0: u32 = 32;
}

/// Push constants of `layer`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LayerPush {
    /// The layer, see [`Layer`](crate::pass::layer::Layer).
    pub kind: u32,
    /// Depth that is shown half as bright as depth 0, scene units.
    pub unit: f32,
    /// Width and height of the interleaving pattern.
    pub pattern: [u32; 2],
}

/// Push constants of `unpack_more`; the shader says what each member is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct UnpackMorePush {
    /// First word.
    pub first: u32,
    /// Pixels.
    pub count: u32,
    /// Words of a pixel.
    pub words: u32,
    /// 1: the pixels are listed; 0: they are all of the task.
    pub is_listed: u32,
    /// First word of the grid.
    pub grid: u32,
    /// Width of the image.
    pub width: u32,
    /// First word of the array in its buffer.
    pub begin: u32,
}

/// Push constants of `unpack_points`; the shader says what each member is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct UnpackPush {
    /// Direction of the first pixel's ray, or of an orthographic camera its start less the eye; a step of coordinates.
    pub corner: [f32; 4],
    /// By which the ray changes from a column to the next.
    pub across: [f32; 4],
    /// From a row to the next.
    pub down: [f32; 4],
    /// Eye point, and the scale of coordinates.
    pub eye: [f32; 4],
    /// View direction, and whether rays are parallel.
    pub forward: [f32; 4],
    /// Numbers of points, pixels, rich points, and those off their ray.
    pub counts: [u32; 4],
    /// First word, width of the image, its pixels, hits of a pixel.
    pub image: [u32; 4],
    /// Exponents of colours.
    pub exponents: [i32; 4],
}

/// Push constants of `discontinuity`; `shaders/include/discontinuity.wgsl` says what each member is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Window {
    /// Share of a neighbour 1, 2, 3, 4 columns away, that of the middle pixel being 1.
    pub shares_x: [f32; 4],
    /// Likewise for rows.
    pub shares_y: [f32; 4],
    /// Greatest offsets with a share.
    pub reach: [i32; 2],
    /// Share of the middle pixel in the whole window.
    pub middle: f32,
    /// 0: what pixels show; 1: second components.
    pub component: u32,
}
