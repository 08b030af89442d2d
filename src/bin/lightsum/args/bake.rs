//! The flags of `bake`.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Args, ValueEnum};
use lightsum::bake::files::Parts;
use lightsum::bake::{self, Options};
use lightsum::settings::Exposure;

use lightsum::radiosity::{self, TextureOptions};

use super::values::{exposure, positive};
use super::{Curve, Device, Keys, Pose, Ranks, Reading, Stop};

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
    pub adaptive: Adaptive,
    #[command(flatten)]
    pub stop: Stop,
    #[command(flatten)]
    pub pose: Pose,
    #[command(flatten)]
    pub reading: Reading,
    #[command(flatten)]
    pub keys: Keys,
    #[command(flatten)]
    pub device: Device,
    #[command(flatten)]
    pub cluster: Ranks,
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

/// Radiosity textures.
#[derive(Debug, Args)]
#[command(next_help_heading = "Adaptive sampling")]
pub struct Adaptive {
    /// Sample light adaptively: split surfaces where it differs by more than this part of the mean light.
    ///
    /// Each quadrilateral and triangle has a quadtree, and the most subdivided ones get textures of their own size. Up to 16 of --passes
    /// light each round of splits, the rest all samples in the end. See docs/radiosity.md.
    #[arg(long, value_name = "EPS", allow_negative_numbers = true, value_parser = positive)]
    #[arg(conflicts_with = "density")]
    pub adaptive: Option<f32>,
    /// Greatest height of a quadtree, 1 to 10 [default: 6]: textures of up to 2^N + 1 texels a side.
    #[arg(long, value_name = "N", requires = "adaptive", value_parser = clap::value_parser!(u8).range(1..=10))]
    pub height: Option<u8>,
    /// Greatest number of leaves of all quadtrees [default: 65536].
    ///
    /// Time and memory grow linearly; the surfaces must not be more.
    #[arg(long, value_name = "N", requires = "adaptive", value_parser = clap::value_parser!(u32).range(1..=4_194_304))]
    pub elements: Option<u32>,
    /// Texels of all textures with more than 2 x 2 [default: 1048576]. Surfaces beyond it have 2 x 2 texels.
    #[arg(long, value_name = "TEXELS", requires = "adaptive")]
    pub budget: Option<u64>,
    /// Width of the low-pass filter over textures, 2 (none) to 6. Wider ones smooth edges of elements and small features.
    #[arg(long, value_name = "TEXELS", requires = "adaptive", value_parser = clap::value_parser!(u32).range(2..=6))]
    pub prefilter: Option<u32>,
}

impl Adaptive {
    /// The options of the library, if light is to be sampled adaptively.
    pub fn options(&self) -> Option<(radiosity::Options, TextureOptions)> {
        let (options, textures) = (radiosity::Options::default(), TextureOptions::default());
        let options = radiosity::Options {
            epsilon: self.adaptive?,
            height: self.height.unwrap_or(options.height),
            elements: self.elements.map_or(options.elements, |n| n as usize),
            ..options
        };
        let textures = TextureOptions {
            budget: self.budget.unwrap_or(textures.budget),
            filter: self.prefilter.unwrap_or(textures.filter),
        };
        Some((options, textures))
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
