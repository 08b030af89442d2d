//! The flags.

use clap::{Args, Parser, Subcommand};
use lightsum::gpu::DeviceChoice;
use std::path::PathBuf;

/// Measures the passes of lightsum.
#[derive(Debug, Parser)]
#[command(name = "lightsum-bench", version, arg_required_else_help = true)]
pub struct Arguments {
    /// What to measure.
    #[command(subcommand)]
    pub command: Command,
}

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Shadow rays a second, for each kernel: what an image's pixels and a pass's lights ask for.
    ShadowRays(ShadowRays),
    /// Shadow rays against Embree on the same rays, in turn.
    Compare(Compare),
}

/// What every mode takes.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// Scene description (.toml), model (.obj, .gltf, .glb), or room:N for a generated room of about N triangles.
    #[arg(long = "scene", value_name = "SCENE", default_value = "room:140000")]
    pub scenes: Vec<String>,
    /// Size of the image in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = resolution)]
    pub resolution: [u32; 2],
    /// Measurements of each thing; the median counts. One more before them warms up.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repeats: u32,
    /// Device: its index, or a part of its name [default: the fastest kind there is].
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<DeviceChoice>,
    /// Print a JSON object a line in place of a table.
    #[arg(long)]
    pub json: bool,
}

/// Flags of `shadow-rays`.
#[derive(Clone, Debug, Args)]
pub struct ShadowRays {
    #[command(flatten)]
    pub common: Common,
    /// Point lights, taken evenly from those of a pass.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub lights: u32,
    /// Count besides, in a run of its own, what the clusters meet: nodes, children, leaves and triangles for each light.
    #[arg(long)]
    pub counters: bool,
    /// Measure this kernel alone.
    #[arg(long, value_name = "KERNEL", value_parser = ["single", "cluster"])]
    pub only: Option<String>,
    /// Lights that one dispatch may loop over, 1 to 64 [default: that of the renderer].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub lights_per_dispatch: Option<u32>,
    /// Write triangles, receivers in cluster order, normals and lights as little-endian arrays to this folder.
    #[arg(long, value_name = "DIR")]
    pub dump_rays: Option<PathBuf>,
}

/// Flags of `compare`.
#[derive(Clone, Debug, Args)]
pub struct Compare {
    #[command(flatten)]
    pub rays: ShadowRays,
    /// Program that traces a dumped workload by Embree: PATH DIR prints a JSON line for each size of packet.
    #[arg(long, value_name = "PATH")]
    pub embree: PathBuf,
    /// Times that the two take turns.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    pub turns: u32,
}

fn resolution(text: &str) -> Result<[u32; 2], String> {
    let parts = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match parts {
        Some([w, h]) if w > 0 && h > 0 && u64::from(w) * u64::from(h) <= 1 << 26 => Ok([w, h]),
        _ => Err("is not a size like 640x480 of at most 2^26 pixels".into()),
    }
}
