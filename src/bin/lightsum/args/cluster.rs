//! Flags of renderings in parts, and of `merge`.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Args, ValueEnum};
use lightsum::settings::Exposure;

use super::values::{exposure, output_path};
use super::{Curve, Denoiser};

/// A rendering on several ranks.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Cluster")]
pub struct Ranks {
    /// Under mpirun, let every rank read the scene's files of its own machine; else they are sent by rank 0.
    ///
    /// The files must be the same. For large scenes that all machines have.
    #[arg(long)]
    pub local_scene: bool,
}

/// Tasks of the ranks of an animation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ClusterTasks {
    /// Whole frames.
    #[default]
    Frames,
    /// Pixels of one class in a band of rows.
    Tiles,
    /// The same in a tenth of the bytes, rounded.
    PackedTiles,
}

/// A rendering in parts, or on several ranks.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Cluster")]
pub struct Cluster {
    #[command(flatten)]
    pub ranks: Ranks,
    /// Render part I of N, from 1, and write it as a film (-o FILE.film) for `merge`: passes I - 1, I - 1 + N and so on, from 0.
    ///
    /// --passes is the number of passes of all parts together. Parts need nothing of one another. With --resume an unfinished film goes on.
    #[arg(long, value_name = "I/N", value_parser = part)]
    pub shard: Option<PartFlag>,
}

/// Part `index`, from 0, of `count`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartFlag {
    pub index: u32,
    pub count: u32,
}

fn part(text: &str) -> Result<PartFlag, String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match numbers {
        Some((index, count)) if (1..=count).contains(&index) => Ok(PartFlag { index: index - 1, count }),
        _ => Err("expected I/N with I from 1 to N, such as 3/16".into()),
    }
}

/// Flags of `merge`.
#[derive(Debug, Args)]
pub struct Merge {
    /// Films of one rendering (.film).
    #[arg(value_name = "FILM", required = true)]
    pub films: Vec<PathBuf>,
    /// Image (.exr or .png) or film (.film) to write. Can be repeated.
    #[arg(short, long = "output", value_name = "FILE", required = true)]
    #[arg(value_parser = PathBufValueParser::new().try_map(output_path))]
    pub outputs: Vec<PathBuf>,
    /// Exposure of PNG files in stops, or auto [default: the scene's, or 0].
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, value_parser = exposure)]
    pub exposure: Option<Exposure>,
    /// Tone curve of PNG files.
    #[arg(long, value_name = "CURVE", value_enum, default_value = "srgb")]
    pub tonemap: Curve,
    /// Write the colour of EXR files as 32-bit float instead of 16-bit half. Doubles its size.
    #[arg(long)]
    pub float: bool,
    /// Write EXR files without layers.
    #[arg(long)]
    pub no_layers: bool,
    /// Remove noise by a neural network (in builds with the feature oidn).
    #[arg(long, value_name = "WAY", value_enum)]
    pub denoise: Option<Denoiser>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_count_from_one() {
        assert_eq!(part("1/4").unwrap(), PartFlag { index: 0, count: 4 });
        assert_eq!(part("4/4").unwrap(), PartFlag { index: 3, count: 4 });
        for wrong in ["0/4", "5/4", "1/0", "3", "a/b", "-1/2", ""] {
            assert!(part(wrong).is_err(), "{wrong}");
        }
    }
}
