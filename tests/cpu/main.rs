//! Tests without a device.

mod conform;
mod hosts;
mod package;
mod pages;
mod ranges;
mod readers;
mod scene;
mod scene_gltf;
mod scene_gltf_animation;
mod scene_gltf_compressed;
mod scene_keys;
mod scene_mitsuba;
mod scene_obj;
mod scene_origin;
mod scene_own;
mod scene_ply;
mod transport;
