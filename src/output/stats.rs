//! Statistics of a rendering as JSON.

use super::write_file;
use crate::error::{Error, Result};
use crate::pass::reproject::MirrorPixels;
use serde::{Serialize, Serializer};
use std::path::Path;

/// Statistics of a rendering; the keys of the JSON file are the fields' names.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Version of the library.
    pub version: String,
    /// Commit from which it was built, or "unknown".
    pub commit: String,
    /// The settings, as JSON.
    pub settings: serde_json::Value,
    /// Their seed.
    pub seed: u64,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
    /// Vulkan version of the device.
    pub api: String,
    /// Name of the scene.
    pub scene: String,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Triangles in the scene.
    pub triangles: u64,
    /// Nodes of its bounding volume hierarchy.
    pub nodes: u64,
    /// Bytes of the device's memory that its buffers and images take.
    pub device_bytes: u64,
    /// Most bytes of the host's memory that the process had at once, a processor's as a device included; null where the system does not tell.
    pub host_bytes: Option<u64>,
    /// Virtual lights of a pass, on average.
    pub lights_per_pass: f64,
    /// Passes in the image.
    pub passes: u32,
    /// Passes that this run rendered; fewer than `passes` after a resume.
    pub passes_rendered: u32,
    /// Passes of this run that were left out because some pixel was no number, and repeated with the next sequence number.
    pub passes_left_out: u32,
    /// Eye rays (including those after mirrors and glass), photon rays, gather rays and pairs of a shading point and a light of this run. Pairs
    /// that face away from each other are included, although no ray is traced for them.
    pub rays: u64,
    /// Pairs of a cluster and a light dropped before any ray was traced: at most 64 pairs of shading point and light each.
    pub culled_pairs: u64,
    /// Caustic photons stored in this run.
    pub photons: u64,
    /// Pixels of the latest pass that show reflectors with images with depth: all, those that no point reached, and those whose nearest
    /// point has no colour; rays show the last two. Null without such images.
    pub mirror_pixels: Option<MirrorPixels>,
    /// Rays per second of stage "render".
    pub rays_per_second: f64,
    /// Relative error of the image, as [`crate::estimate`] defines and estimates it; null while unknown.
    pub error_estimate: Option<f32>,
    /// Seconds of each stage, in order.
    #[serde(serialize_with = "as_object")]
    pub stages: Vec<(String, f64)>,
    /// Seconds of each GPU pass by its timestamps, summed over this run, in order.
    #[serde(serialize_with = "as_object")]
    pub gpu_passes: Vec<(String, f64)>,
}

impl Statistics {
    /// The statistics as JSON.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// Writes the statistics.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = self.to_json().map_err(|e| Error::file(path, format!("encoding failed: {e}")))?;
        write_file(path, &[text.as_bytes()])
    }
}

/// Name and seconds as an object, in the order of the list.
fn as_object<S: Serializer>(list: &[(String, f64)], serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_map(list.iter().map(|(name, seconds)| (name, seconds)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_order_and_missing_values() {
        let statistics = Statistics {
            device: "a \"device\"".into(),
            passes: 4,
            rays: u64::MAX,
            rays_per_second: f64::NAN,
            stages: vec![("load".into(), 0.5), ("bvh".into(), 0.25)],
            ..Statistics::default()
        };
        let text = statistics.to_json().unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["device"], "a \"device\"");
        assert_eq!(json["rays"], u64::MAX);
        assert_eq!(json["stages"]["load"], 0.5);
        assert!(json["rays_per_second"].is_null() && json["error_estimate"].is_null());
        assert!(text.find("\"load\"").unwrap() < text.find("\"bvh\"").unwrap());
    }
}
