//! Radiosity textures (Bastos 1999, chapter 5): light sampled adaptively on quadrilaterals, triangles and spheres, then rebuilt as
//! textures.
//!
//! 1. [`surfaces`] finds the quadrilaterals and triangles of a scene.
//! 2. [`refine`] grows a quadtree on each surface where light changes, in rounds: one submission of points a round.
//! 3. [`texture`] flattens a tree into a texture, of order zero or one.
//! 4. [`reconstruct`] makes it smooth: bicubic patches without T-vertices, a low-pass filter, the look-up.
//! 5. [`layout`] gives the most subdivided surfaces textures of their own and places all on pages.
//! 6. [`growth`] does the rounds on the device, pass by pass, so that they can be broken off and gone on with.
//! 7. [`compute`] lights the points on the device and makes a [`crate::bake::Lightmap`], which is shown and written as any other.
//! 8. [`sphere`] samples spheres as six patches and joins them in one texture of latitude and longitude; [`balls`] finds them in meshes.

pub mod balls;
mod batches;
pub mod compute;
pub mod growth;
pub mod layout;
pub mod quadtree;
pub mod reconstruct;
pub mod refine;
mod saved;
pub mod sphere;
pub mod surfaces;
pub mod texture;

pub use compute::{Progress, Radiosity, TextureOptions, Times};
pub use growth::{Growth, Part, ROUND_PASSES};
pub use refine::{Options, Order, Solution};

use std::ops::{Add, Mul, Sub};

use glam::Vec3;

/// Irradiance at a point in W/m^2.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Light {
    /// From the emitters.
    pub direct: Vec3,
    /// After one or more reflections.
    pub indirect: Vec3,
}

impl Add for Light {
    type Output = Light;
    fn add(self, other: Light) -> Light {
        Light { direct: self.direct + other.direct, indirect: self.indirect + other.indirect }
    }
}

impl Sub for Light {
    type Output = Light;
    fn sub(self, other: Light) -> Light {
        Light { direct: self.direct - other.direct, indirect: self.indirect - other.indirect }
    }
}

impl Mul<f32> for Light {
    type Output = Light;
    fn mul(self, factor: f32) -> Light {
        Light { direct: self.direct * factor, indirect: self.indirect * factor }
    }
}
