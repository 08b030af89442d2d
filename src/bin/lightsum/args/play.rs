//! Flags of a model's animations.

use clap::Args;

use super::values::{moment, rate};
use crate::play::MAX_FRAMES;

/// The pose of a still image.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Pose (of a glTF file with animations; without these flags it stands as it rests)")]
pub struct Pose {
    /// Show the pose of an animation: its name, or all for all at once [default: the first, if --at is given].
    #[arg(long, value_name = "NAME")]
    pub animation: Option<String>,
    /// Time of the pose, seconds [default: where the animation begins]. Before its first key and after its last it stands still.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = moment)]
    pub at: Option<f64>,
}

/// The animation that is played.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Animation (of a glTF file)")]
pub struct Play {
    /// Animation to play: its name, or all for all at once [default: without --path the first; with it none].
    ///
    /// With --path both move the scene, and the path says when.
    #[arg(long, value_name = "NAME")]
    pub animation: Option<String>,
    /// Number of frames [default: the length of the animation]. Without --fps they are spread evenly over it.
    #[arg(long, value_name = "N", conflicts_with = "path", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    pub frames: Option<u32>,
    /// Frames per second of the animation [default: 24]. With --frames it starts again where it ends.
    #[arg(long, value_name = "F", conflicts_with = "path", allow_negative_numbers = true, value_parser = rate)]
    pub fps: Option<f64>,
}
