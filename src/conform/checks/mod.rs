//! The checks, a file for each group; [`super::ALL`] lists them.

mod aim;
pub mod convolve;
pub mod delta_choice;
pub mod discontinuity;
pub mod display;
pub mod edges;
pub mod eye;
pub mod film;
pub mod gain;
pub mod importance;
pub mod kernels;
pub mod lamp_edges;
pub mod light;
pub mod light_lists;
pub mod near;
pub mod outliers;
pub mod paths;
pub mod photons;
pub mod self_tests;
pub mod sequences;
pub mod splats;
pub mod textures;
pub mod traversal;
pub mod unlikely;
pub mod upsample;
pub mod visibility;
pub mod walk;
