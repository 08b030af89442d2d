//! Flags of `view`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

use super::{Moving, Ranks};

/// Maximum of `--coarser`.
pub const MAX_COARSER: u32 = 8;

/// How ranks send the points that they shade for a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Sent {
    /// As they are.
    Tiles,
    /// In a tenth of the bytes, rounded.
    PackedTiles,
}

/// Flags of `view`.
#[derive(Clone, Debug, Args)]
pub struct View {
    /// Scene description (.toml) or bare model (.obj, .ply, .gltf, .glb, .xml). Without it the window waits for a file.
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Passes after which the image stays as it is [default: 1024].
    #[arg(long, value_name = "N", default_value_t = 1024, hide_default_value = true, value_parser = clap::value_parser!(u32).range(1..))]
    pub passes: u32,
    /// Render an image N times smaller each way while the camera moves, 1 to 8 [default: 1]. The still image is the same.
    ///
    /// Without effect in a ring.
    #[arg(long, value_name = "N", default_value_t = 1, hide_default_value = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_COARSER)))]
    pub coarser: u32,
    /// Runs the commands of a file, one a line, in place of mouse and keys; see docs/viewer.md.
    #[arg(long, value_name = "FILE", hide = true)]
    pub script: Option<PathBuf>,
    #[command(flatten)]
    pub shown: Moving,
    #[command(flatten)]
    pub cluster: Ranks,
    /// Under mpirun, how ranks send the points that they shade for rank 0, which has the window.
    ///
    /// tiles: as they are, for the bits of one process. packed-tiles: in a tenth of the bytes, rounded.
    #[arg(long, value_name = "TASKS", value_enum, default_value = "packed-tiles", help_heading = "Cluster")]
    pub cluster_tasks: Sent,
}
