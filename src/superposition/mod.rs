//! Superposition rendering (Bastos 1999): what its passes look up.
//!
//! A glossy reflection is a mirror image that is blurred by the lobe of the material and modulated by how much the
//! material reflects in that direction. Both factors are tables that are made once for each material:
//!
//! | module | table |
//! |---|---|
//! | [`lobe`] | the reflectance distributions that tables are made of: GGX, Phong, measured |
//! | [`kernels`] | shape and size of the blur for each angle of view (7.4.2.2) |
//! | [`reflectance`] | the modulation for each angle of view (6.7) |
//!
//! `docs/superposition.md` has the definitions in one place, with what was measured.

pub mod kernels;
pub mod lobe;
pub mod reflectance;
