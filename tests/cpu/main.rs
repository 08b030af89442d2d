//! Tests that need no device.

mod scene;
mod scene_gltf;
mod scene_keys;
mod transport;
