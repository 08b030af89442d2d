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
//! `docs/superposition.md` has all definitions and measurements.

pub mod kernels;
pub mod lobe;
pub mod reflectance;
