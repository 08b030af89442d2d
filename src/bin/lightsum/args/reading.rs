//! Flags of how a scene is read.

use clap::{Args, ValueEnum};

/// How a scene is read.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Reading")]
pub struct Reading {
    /// Whether the lights of a glTF file are in candela and lux, to be divided by 683 lm/W [default: the scene's, or auto].
    #[arg(long, value_name = "WHEN", value_enum)]
    photometric: Option<Photometric>,
}

impl Reading {
    /// The value for [`lightsum::scene::load_with`].
    pub fn photometric(&self) -> Option<bool> {
        match self.photometric? {
            Photometric::On => Some(true),
            Photometric::Off => Some(false),
            Photometric::Auto => None,
        }
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
