//! The flags of images with depth.

use clap::{Args, ValueEnum};
use lightsum::settings::{ImageChoice, MirrorImages, MirrorSource, Settings};
use lightsum::superposition::depth_images::Options;

use super::values::bytes;

/// Images with depth as the source of mirror images.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Mirror images (of --superposition)")]
pub struct Mirrors {
    /// Where the mirror image of a glossy plane comes from [default: rays].
    ///
    /// Images are sampled before the first pass and reprojected in each; rays fill their holes. They hold diffuse light alone, of a scene
    /// that stands still.
    #[arg(long, value_name = "SOURCE", value_enum)]
    pub mirror_source: Option<SourceFlag>,
    /// Maximum number of elements that a reflector is cut into, each with a hemisphere of images, 1 to 256 [default: 4].
    #[arg(long, value_name = "N", requires = "mirror_source", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub mirror_hemispheres: Option<u32>,
    /// Images of a hemisphere, 1 to 256 [default: 8]. More have fewer holes; memory and start in proportion.
    #[arg(long, value_name = "N", requires = "mirror_source", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub mirror_images: Option<u32>,
    /// Width and height of an image in points, 8 to 1024 [default: 128]. Times and memory grow with its square.
    #[arg(long, value_name = "POINTS", requires = "mirror_source", value_parser = clap::value_parser!(u32).range(8..=1024))]
    pub mirror_side: Option<u32>,
    /// Layers of an image, 1 to 4 [default: 1]: further ones hold what lies behind the first, for fewer holes.
    #[arg(long, value_name = "N", requires = "mirror_source", value_parser = clap::value_parser!(u32).range(1..=4))]
    pub mirror_layers: Option<u32>,
    /// Passes that light the images, 1 to 65536 [default: 32].
    #[arg(long, value_name = "N", requires = "mirror_source", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub mirror_passes: Option<u32>,
    /// Memory that the images may take, such as 64M or 1G [default: 256M]. More is refused before they are made.
    #[arg(long, value_name = "BYTES", requires = "mirror_source", value_parser = bytes)]
    pub mirror_memory: Option<u64>,
    /// Images that fit a view [default: angle].
    #[arg(long, value_name = "HOW", requires = "mirror_source", value_enum)]
    pub mirror_choice: Option<ChoiceFlag>,
    /// Images of each hemisphere in view that a pass merges, 1 to 256 [default: 2].
    #[arg(long, value_name = "N", requires = "mirror_source", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub mirror_merge: Option<u32>,
}

/// Values of `--mirror-source`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SourceFlag {
    /// A traced ray for each pixel
    Rays,
    /// Images with depth, and rays where they have holes
    Images,
}

/// Values of `--mirror-choice`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ChoiceFlag {
    /// The least angle between their view direction and the mirrored one
    Angle,
    /// The least distance of their centre from the mirrored eye
    Distance,
}

impl Mirrors {
    /// Whether images with depth are wanted.
    pub fn wants_images(&self) -> bool {
        self.mirror_source == Some(SourceFlag::Images)
    }

    /// Applies the flags to the settings.
    pub fn apply(&self, settings: &mut Settings) {
        let Some(superposition) = settings.superposition.as_mut().filter(|_| self.wants_images()) else { return };
        let defaults = MirrorImages::default();
        superposition.mirror_source = MirrorSource::Images(MirrorImages {
            choice: match self.mirror_choice {
                None => defaults.choice,
                Some(ChoiceFlag::Angle) => ImageChoice::Angle,
                Some(ChoiceFlag::Distance) => ImageChoice::Distance,
            },
            merged: self.mirror_merge.unwrap_or(defaults.merged),
        });
    }

    /// The sizes of the images.
    pub fn options(&self) -> Options {
        let defaults = Options::default();
        Options {
            hemispheres: self.mirror_hemispheres.unwrap_or(defaults.hemispheres),
            images: self.mirror_images.unwrap_or(defaults.images),
            side: self.mirror_side.unwrap_or(defaults.side),
            layers: self.mirror_layers.unwrap_or(defaults.layers),
            passes: self.mirror_passes.unwrap_or(defaults.passes),
            memory: self.mirror_memory.unwrap_or(defaults.memory),
        }
    }
}
