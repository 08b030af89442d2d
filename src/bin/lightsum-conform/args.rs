//! The command line.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use lightsum::conform::{ALL, Check, Choices, SELF_TESTS};
use lightsum::gpu::DeviceChoice;

/// Runs the kernels of lightsum against their oracles on a Vulkan device.
#[derive(Debug, Parser)]
#[command(version, about, max_term_width = 100, arg_required_else_help = true)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// List the checks with their kernels, the features that these use, and the bounds
    List(Selection),
    /// List the devices
    Devices,
    /// Run checks, each in a process of its own; exit code 1 if any fails, crashes, errs or does not end
    Run(Run),
    /// Run one check in this process and print its outcome as JSON
    #[command(hide = true)]
    One(One),
}

#[derive(Debug, Args)]
pub struct Selection {
    /// Only checks whose name contains this; may be given several times
    #[arg(long, value_name = "SUBSTRING")]
    pub filter: Vec<String>,
    /// Checks that end badly on purpose, in place of the others
    #[arg(long, hide = true)]
    pub self_test: bool,
}

impl Selection {
    /// The checks that were asked for.
    pub fn checks(&self) -> Vec<&'static Check> {
        let all = if self.self_test { SELF_TESTS } else { ALL };
        let is_meant = |check: &&Check| {
            self.filter.is_empty() || self.filter.iter().any(|part| check.name.contains(part.as_str()))
        };
        all.iter().filter(is_meant).collect()
    }
}

#[derive(Debug, Args)]
pub struct Run {
    #[command(flatten)]
    pub selection: Selection,
    #[command(flatten)]
    pub bench: BenchArgs,
    /// Write device, settings and outcomes as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the outcomes as JUnit XML
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// End a check that takes longer
    #[arg(long, value_name = "SECONDS", default_value = "600", value_parser = seconds)]
    pub timeout: Duration,
    /// Run all checks in this process, to debug them: one that crashes or does not end takes the others with it
    #[arg(long)]
    pub in_process: bool,
}

#[derive(Debug, Args)]
pub struct One {
    pub name: String,
    #[command(flatten)]
    pub bench: BenchArgs,
}

/// The device and what is run on it.
#[derive(Clone, Debug, Args)]
pub struct BenchArgs {
    /// The device: its number in `devices`, a part of its name, or cpu
    #[arg(long, value_name = "N|NAME", default_value = "auto")]
    pub device: DeviceName,
    /// Added to the seeds of all random numbers
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub seed: u64,
    /// Sizes of lists, and of images as NxM or rows of N pixels, in place of 1, 27, 64, 2049 and 31x17
    #[arg(long, value_name = "N,..", value_delimiter = ',', value_parser = size)]
    pub size: Vec<[u32; 2]>,
    /// Use the validation layer; its messages fail a check
    #[arg(long)]
    pub validation: bool,
    /// Take arrays as storage buffers, as on graphics cards, where a driver on the processor would take them as texel buffers
    #[arg(long)]
    pub no_texel_buffers: bool,
}

impl BenchArgs {
    pub fn choices(&self) -> Choices {
        Choices { seed: self.seed, sizes: self.size.clone() }
    }

    /// The same as flags, for a process of its own.
    pub fn flags(&self) -> Vec<String> {
        let mut flags = vec![format!("--device={}", self.device.text), format!("--seed={}", self.seed)];
        flags.extend(self.size.iter().map(|[width, height]| format!("--size={width}x{height}")));
        flags.extend(self.validation.then(|| "--validation".to_owned()));
        flags.extend(self.no_texel_buffers.then(|| "--no-texel-buffers".to_owned()));
        flags
    }
}

/// A choice of a device, and the words that it was made with.
#[derive(Clone, Debug)]
pub struct DeviceName {
    pub text: String,
    pub choice: DeviceChoice,
}

impl std::str::FromStr for DeviceName {
    type Err = lightsum::Error;

    fn from_str(text: &str) -> lightsum::Result<DeviceName> {
        Ok(DeviceName { text: text.to_owned(), choice: text.parse()? })
    }
}

/// Most pixels of an image and elements of a list: the oracles take a microsecond or more of each.
const MOST: u64 = 1 << 20;

fn size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || format!("give a number N, or NxM, from 1 to {MOST} in all");
    let (width, height) = text.split_once('x').unwrap_or((text, "1"));
    let [width, height]: [u32; 2] = [width.parse().map_err(|_| wrong())?, height.parse().map_err(|_| wrong())?];
    if (1..=MOST).contains(&(u64::from(width) * u64::from(height))) { Ok([width, height]) } else { Err(wrong()) }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let parsed = text.parse().ok().filter(|seconds| *seconds > 0.0);
    parsed.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()).ok_or_else(|| "give seconds above 0".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_numbers_or_products() {
        assert_eq!((size("27"), size("31x17")), (Ok([27, 1]), Ok([31, 17])));
        for wrong in ["", "0", "0x7", "-1", "3x", "1048577", "4294967295x4294967295"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn flags_say_the_same_again() {
        let flags = ["--device=llvm", "--seed=3", "--size=1,31x17", "--validation", "--no-texel-buffers"];
        let words = ["lightsum-conform", "run"].into_iter().chain(flags);
        let of = |arguments: Arguments| match arguments.command {
            Command::Run(run) => run.bench,
            _ => unreachable!("it is a run"),
        };
        let bench = of(Arguments::parse_from(words));
        let again =
            of(Arguments::parse_from(["lightsum-conform", "run"].map(String::from).into_iter().chain(bench.flags())));
        assert_eq!((bench.choices(), bench.flags()), (again.choices(), again.flags()));
        assert_eq!(bench.choices(), Choices { seed: 3, sizes: vec![[1, 1], [31, 17]] });
    }
}
