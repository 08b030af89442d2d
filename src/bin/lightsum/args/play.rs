//! Flags of a model's animations.

use std::ops::Range;

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

/// Value of `--frames`.
#[derive(Clone, Debug, PartialEq)]
pub struct FramesFlag {
    /// Number of frames of the whole animation.
    pub count: Option<u32>,
    /// Those to render; `None`: all.
    pub part: Option<Range<usize>>,
}

fn frames(text: &str) -> Result<FramesFlag, String> {
    const EXPECTED: &str =
        "expected a number of frames from 1 to 1000000, or a part of them such as 0..10 or 10..20/100";
    let number = |text: &str| text.parse().ok().filter(|n| (1..=MAX_FRAMES).contains(n)).ok_or(EXPECTED);
    let Some((first, rest)) = text.split_once("..") else {
        return Ok(FramesFlag { count: Some(number(text)?), part: None });
    };
    let (end, count) = rest.split_once('/').map_or((rest, None), |(end, count)| (end, Some(count)));
    let (first, end) = first.parse().ok().zip(end.parse().ok()).filter(|(first, end)| first < end).ok_or(EXPECTED)?;
    Ok(FramesFlag { count: count.map(number).transpose()?, part: Some(first..end) })
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
    /// Number of frames [default: the length of the animation], or the part A..B of them, from 0 and without B, or A..B/N of N frames.
    ///
    /// Without --fps N frames are spread evenly over the animation. The images of parts are those of the whole: render them on several
    /// machines. With --path the file has the number.
    #[arg(long, value_name = "N|A..B|A..B/N", value_parser = frames)]
    pub frames: Option<FramesFlag>,
    /// Frames per second of the animation [default: 24]. With --frames it starts again where it ends.
    #[arg(long, value_name = "F", conflicts_with = "path", allow_negative_numbers = true, value_parser = rate)]
    pub fps: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_a_number_or_a_part() {
        let flag = |count, part| FramesFlag { count, part };
        assert_eq!(frames("12").unwrap(), flag(Some(12), None));
        assert_eq!(frames("3..12").unwrap(), flag(None, Some(3..12)));
        assert_eq!(frames("0..2/9").unwrap(), flag(Some(9), Some(0..2)));
        for wrong in ["0", "", "3..3", "4..3", "..3", "3..", "1..2/0", "1000001", "a..b", "-1..2"] {
            assert!(frames(wrong).is_err(), "{wrong}");
        }
    }
}
