//! Superposition rendering (Bastos 1999): the tables of its passes.
//!
//! A glossy reflection is a mirror image, convolved with the lobe of the material and modulated by its directional
//! reflectance. Both factors are tabulated once for each material:
//!
//! | module | table |
//! |---|---|
//! | [`lobe`] | the underlying reflectance distributions: GGX, Phong, measured |
//! | [`kernels`] | shape and size of the blur for each angle of view (7.4.2.2) |
//! | [`reflectance`] | the modulation for each angle of view (6.7) |
//!
//! [`depth_images`] samples mirror images before the first frame, in place of traced rays (6.6).
//!
//! `docs/superposition.md` has all definitions and measurements.

pub mod depth_images;
pub mod kernels;
pub mod lobe;
pub mod reflectance;
