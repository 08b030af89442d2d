//! Radiosity textures (Bastos 1999, chapter 5): light sampled adaptively on quadrilaterals, triangles and spheres, then rebuilt as
//! textures.
//!
//! 1. [`refine`] grows a quadtree on each surface where light changes, in rounds: one submission of points a round.
//! 2. [`texture`] flattens a tree into a texture, of order zero or one.
//! 3. [`reconstruct`] makes it smooth: bicubic patches without T-vertices, a low-pass filter, the look-up.


pub mod quadtree;
pub mod reconstruct;
pub mod refine;
pub mod texture;

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
