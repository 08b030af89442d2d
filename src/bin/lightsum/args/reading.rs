//! Flags of how a scene is read.

use clap::{Args, ValueEnum};
use lightsum::scene::ReadOptions;

use super::values::bytes;

/// How a scene is read.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Reading")]
pub struct Reading {
    /// Whether the lights of a glTF file are in candela and lux, to be divided by 683 lm/W [default: the scene's, or auto].
    #[arg(long, value_name = "WHEN", value_enum)]
    photometric: Option<Photometric>,
    /// Let the scene's files name any file of this machine.
    ///
    /// Without it models, textures and other files must lie below the folder of SCENE, or below that of the model that it names: for
    /// scenes from other people.
    #[arg(long)]
    allow_outside: bool,
    /// Memory that the scene's files may take, as they are and decoded, such as 512M or 4G [default: half of the machine's].
    ///
    /// A file beyond this limit is refused before it is read.
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_input_memory: Option<u64>,
}

impl Reading {
    /// The options for [`lightsum::scene::load_with`].
    pub fn options(&self) -> ReadOptions {
        let photometric = match self.photometric {
            Some(Photometric::On) => Some(true),
            Some(Photometric::Off) => Some(false),
            Some(Photometric::Auto) | None => None,
        };
        ReadOptions { photometric, allow_outside: self.allow_outside, max_memory: self.max_input_memory }
    }
}

/// Values of `--photometric`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Photometric {
    /// They are
    On,
    /// They are in W/sr and W/m^2
    Off,
    /// They are if Blender wrote the file and one is as strong as no lamp is in W/sr
    Auto,
}
