//! Flags of `compare` and of `devices`.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Args, ValueEnum};

use super::values::{distance, image_path, stops};

/// Flags of `compare`.
#[derive(Debug, Args)]
pub struct Compare {
    /// Image (.exr or .png).
    #[arg(value_name = "IMAGE")]
    pub image: PathBuf,
    /// Image that it is compared with (.exr or .png), of the same size.
    #[arg(value_name = "REFERENCE")]
    pub reference: PathBuf,
    /// Image of FLIP to write (.exr or .png): white is 1, the greatest difference.
    #[arg(short, long, value_name = "FILE", value_parser = PathBufValueParser::new().try_map(image_path))]
    pub output: Option<PathBuf>,
    /// End with exit code 1 if --measure is above this.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true, value_parser = distance)]
    pub fail_above: Option<f32>,
    /// Measure of --fail-above.
    #[arg(long, value_name = "MEASURE", value_enum, default_value = "rmse")]
    pub measure: Measure,
    /// Exposure in stops of both images before FLIP, which sees what is between 0 and 1.
    #[arg(long, value_name = "STOPS", default_value = "0", allow_negative_numbers = true, value_parser = stops)]
    pub exposure: f32,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Values of `--measure`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Measure {
    /// Relative RMSE of linear radiance.
    Rmse,
    /// Mean of FLIP.
    Flip,
    /// Distance of the ratio of energies from 1.
    Energy,
}

/// Flags of `devices`.
#[derive(Debug, Args)]
pub struct Devices {
    /// Print a JSON array.
    #[arg(long)]
    pub json: bool,
}
