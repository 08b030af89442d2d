//! Tests without a device.

mod scene;
mod scene_gltf;
