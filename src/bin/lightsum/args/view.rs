//! Flags of `view`.

use clap::Args;
use lightsum::settings::Exposure;
use std::path::PathBuf;

use super::values::{exposure, resolution};
use super::{Camera, Curve, Device, Glossy, Light, Reading, Ring};

/// Maximum of `--coarser`.
pub const MAX_COARSER: u32 = 8;

/// Flags of `view`.
#[derive(Clone, Debug, Args)]
pub struct View {
    /// Scene description (.toml) or bare model (.obj, .ply, .gltf, .glb, .xml). Without it the window waits for a file.
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Size of the image in pixels [default: the scene's, or 640x480]; the window is wider by its panel.
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    pub resolution: Option<[u32; 2]>,
    /// Passes after which the image stays as it is [default: 1024].
    #[arg(long, value_name = "N", default_value_t = 1024, hide_default_value = true, value_parser = clap::value_parser!(u32).range(1..))]
    pub passes: u32,
    /// Exposure in stops, or auto: by the brightness of the first image [default: the scene's, or 0].
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, value_parser = exposure)]
    pub exposure: Option<Exposure>,
    /// Render an image N times smaller each way while the camera moves, 1 to 8 [default: 1]. The still image is the same.
    ///
    /// Without effect in a ring.
    #[arg(long, value_name = "N", default_value_t = 1, hide_default_value = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_COARSER)))]
    pub coarser: u32,
    /// Tone curve of the window and its PNG files.
    #[arg(long, value_name = "CURVE", value_enum, default_value = "srgb")]
    pub tonemap: Curve,
    /// Runs the commands of a file, one a line, in place of mouse and keys; see docs/viewer.md.
    #[arg(long, value_name = "FILE", hide = true)]
    pub script: Option<PathBuf>,
    #[command(flatten)]
    pub ring: Ring,
    #[command(flatten)]
    pub camera: Camera,
    #[command(flatten)]
    pub reading: Reading,
    #[command(flatten)]
    pub light: Light,
    #[command(flatten)]
    pub glossy: Glossy,
    #[command(flatten)]
    pub device: Device,
}
