//! Tests on a Vulkan device (Mesa's lavapipe suffices). Without a device they fail; they never skip.
//!
//! One binary, so that few devices serve all tests; each test's turn ends with a look at the validation layer's messages.

use lightsum::conform::{lobe_tables, rig};

mod bake;
mod caustics;
mod checks;
mod convolve;
mod curved_reflectors;
mod delta_choice;
mod depth_images;
mod devices;
mod directed_lights;
mod discontinuity;
mod edges;
mod embed;
mod emission_textures;
mod environment;
mod far_scenes;
mod four_ways;
mod frosted_panes;
mod gain;
mod gpu_assisted;
mod gpu_layer;
mod hosts;
mod importance;
mod independent;
mod lens;
mod light_lists;
mod memory;
mod mirror_lights;
mod mirrors_and_glass;
mod motion_blur;
mod moving;
mod near;
mod no_numbers;
mod outliers;
mod passes_limits;
mod passes_paths;
mod passes_walk;
mod phong_lobes;
mod radiosity;
mod references;
mod renderer;
mod ring;
mod scales;
mod scenes;
mod soft_shadows;
mod splats;
mod superposition;
mod support;
mod textures;
mod transport;
mod traversal;
mod unlikely;
mod views;
mod visibility;
