//! The flags of a ring of path images.

use clap::{Args, ValueEnum};
use lightsum::Result;
use lightsum::ring;
use lightsum::settings::Settings;

use crate::say_aside;

/// A ring of path images.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Ring of paths (for scenes that move)")]
pub struct Ring {
    /// Each pass follows one path of light, which replaces the oldest of a ring; a change of the scene or the camera does not start the image over.
    ///
    /// --particles, --light-pool, --direct-lights, --interleave and --filter have no effect in a ring. Objects that move leave ghosts for as
    /// many passes as the ring has paths.
    #[arg(long, value_name = "WHAT", value_enum)]
    pub ring: Option<RingFlag>,
    /// Number of paths in the ring, 1 to 1024 [default: 64]. More: less noise, longer ghosts; more memory for images, more time for
    /// lights.
    #[arg(long, value_name = "N", requires = "ring", value_parser = clap::value_parser!(u32).range(1..=i64::from(ring::Ring::MAX_LENGTH)))]
    pub ring_length: Option<u32>,
    /// Memory that the ring may take, MiB [default: 1024]. A ring that needs more is refused, with the length that would fit.
    #[arg(long, value_name = "MIB", requires = "ring", value_parser = clap::value_parser!(u32).range(1..))]
    pub ring_memory: Option<u32>,
}

/// Values of `--ring`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RingFlag {
    /// The images of the paths are kept and their mean is shown: a pass is quick, and all that moves leaves ghosts
    Images,
    /// The lights of the paths are kept and light each image anew: slower, and only light that comes from what moves is late
    Lights,
}

impl Ring {
    /// Applies the flags to the settings.
    pub fn apply(&self, settings: &mut Settings) {
        let Some(form) = self.ring else { return };
        let defaults = ring::Ring::new(match form {
            RingFlag::Images => ring::Form::Images,
            RingFlag::Lights => ring::Form::Lights,
        });
        settings.ring = Some(ring::Ring {
            length: self.ring_length.unwrap_or(defaults.length),
            memory: self.ring_memory.unwrap_or(defaults.memory),
            ..defaults
        });
    }
}

/// Says how much memory the ring of these settings takes, before it is made; without a ring nothing. Errors: it takes too much.
pub fn tell(settings: &Settings, size: [u32; 2]) -> Result<()> {
    let Some(ring) = &settings.ring else { return Ok(()) };
    ring.check(size, settings.max_depth)?;
    let what = match ring.form {
        ring::Form::Images => "images",
        ring::Form::Lights => "paths",
    };
    let mib = ring.bytes(size, settings.max_depth) as f64 / (1 << 20) as f64;
    say_aside(&format!("a ring of {} {what} takes {mib:.1} MiB of {}", ring.length, ring.memory));
    Ok(())
}
