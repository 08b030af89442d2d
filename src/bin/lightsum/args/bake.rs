//! The flags of `bake`.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Args, ValueEnum};
use lightsum::bake::files::Parts;
use lightsum::bake::{self, Options};
use lightsum::settings::Exposure;

use super::values::{exposure, positive};
use super::{Curve, Device, Light, Pose, Reading, Stop};

fn model_path(path: PathBuf) -> Result<PathBuf, &'static str> {
    let fits = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    if fits { Ok(path) } else { Err("the name must end in .glb") }
}

/// Flags of `bake`.
#[derive(Debug, Args)]
pub struct Bake {
    /// Scene description (.toml) or bare model (.obj, .ply, .gltf, .glb, .xml).
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Model to write (.glb), with its light maps (.exr) beside it.
    #[arg(short, long = "output", id = "outputs", value_name = "FILE.glb")]
    #[arg(value_parser = PathBufValueParser::new().try_map(model_path))]
    pub output: PathBuf,
    /// Texels along a unit of length [default: such that the surfaces have some 500,000 texels].
    ///
    /// Time and memory grow with the square.
    #[arg(long, value_name = "D", allow_negative_numbers = true, value_parser = positive)]
    pub density: Option<f32>,
    /// Greatest width and height of a map, 64 to 8192; what does not fit takes several maps.
    #[arg(long, value_name = "TEXELS", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(64..=8192))]
    pub max_size: u32,
    /// Texels around each chart that hold its light too, 1 to 16. More allow coarser mip maps.
    #[arg(long, value_name = "TEXELS", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub padding: u32,
    /// Make new charts although the model has texture coordinates of light maps (TEXCOORD_1).
    #[arg(long)]
    pub new_charts: bool,
    /// The light that the maps hold.
    #[arg(long, value_enum, default_value = "together")]
    pub parts: PartsFlag,
    /// Write a model whose textures show light times albedo, so that any viewer shows the room lit.
    #[arg(long)]
    pub unlit: bool,
    /// Exposure of --unlit in stops, or auto [default: the scene's, or 0].
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, value_parser = exposure, requires = "unlit")]
    pub exposure: Option<Exposure>,
    /// Tone curve of --unlit.
    #[arg(long, value_name = "CURVE", value_enum, default_value = "srgb", requires = "unlit")]
    pub tonemap: Curve,
    #[command(flatten)]
    pub stop: Stop,
    #[command(flatten)]
    pub pose: Pose,
    #[command(flatten)]
    pub reading: Reading,
    #[command(flatten)]
    pub light: Light,
    #[command(flatten)]
    pub device: Device,
}

impl Bake {
    /// The options of the library.
    pub fn options(&self) -> Options {
        bake::Options {
            density: self.density,
            max_size: self.max_size,
            padding: self.padding,
            new_charts: self.new_charts,
        }
    }
}

/// Values of `--parts`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PartsFlag {
    /// Direct and indirect light in one map
    Together,
    /// A map of direct and a map of indirect light
    Apart,
    /// Direct light only
    Direct,
    /// Indirect light only
    Indirect,
}

impl From<PartsFlag> for Parts {
    fn from(flag: PartsFlag) -> Parts {
        match flag {
            PartsFlag::Together => Parts::Together,
            PartsFlag::Apart => Parts::Apart,
            PartsFlag::Direct => Parts::Direct,
            PartsFlag::Indirect => Parts::Indirect,
        }
    }
}
