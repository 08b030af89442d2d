//! Tests on a Vulkan device (Mesa's lavapipe suffices). Without a device they fail; they never skip.
//!
//! One binary, so that few devices serve all tests; each test's turn ends with a look at the validation layer's messages.

mod bake;
mod caustics;
mod convolve;
mod delta_choice;
mod devices;
mod discontinuity;
mod edges;
mod embed;
mod emission_textures;
mod environment;
mod far_scenes;
mod frosted_panes;
mod gain;
mod gallery;
mod gpu_layer;
mod importance;
mod independent;
mod lens;
mod light_lists;
mod mirror_lights;
mod mirrors_and_glass;
mod moving;
mod near;
mod outliers;
mod passes_eye;
mod passes_film;
mod passes_light;
mod passes_limits;
mod passes_paths;
mod passes_photons;
mod passes_walk;
mod radiosity;
mod references;
mod renderer;
mod rig;
mod scenes;
mod sequences;
mod superposition;
mod support;
mod textures;
mod transport;
mod traversal;
mod views;
mod visibility;
