//! The command line: `lightsum render SCENE -o IMAGE`, `lightsum bake SCENE -o MODEL.glb`, `lightsum animate SCENE -o FRAME-%04d.png`,
//! `lightsum view SCENE`, `lightsum info SCENE`, `lightsum merge FILM... -o IMAGE`.
//!
//! Exit codes: 0 done, 1 failed, 2 wrong use. Progress, warnings and errors go to standard error; requested output and
//! the line that names the files written go to standard output.

#![forbid(unsafe_code)]

mod animate;
mod args;
mod bake;
mod camera;
mod checkpoint;
#[cfg(feature = "mpi")]
mod cluster;
mod info;
mod launcher;
mod live;
mod merge;
mod mirrors;
mod moment;
mod parts;
mod play;
mod progress;
mod radiosity;
mod reference;
mod render;
mod shard;
mod stop;
#[cfg(feature = "viewer")]
mod view;

use args::{Arguments, Command};
use clap::Parser;
use lightsum::{Error, Result, gpu};
use std::io::Write;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Makes an error of writing of a file that outgrows the system's limit (`ulimit -f`): unless it is caught, the signal ends the program with all
/// that is in memory.
#[cfg(unix)]
fn keep_on_when_files_outgrow_their_limit() {
    let caught = std::sync::Arc::new(AtomicBool::new(false));
    if let Err(error) = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, caught) {
        log::warn!("files that outgrow a limit will end the program: {error}");
    }
}

fn main() -> ExitCode {
    lightsum::scene::silence_caught_panics();
    #[cfg(unix)]
    keep_on_when_files_outgrow_their_limit();
    let arguments = Arguments::parse();
    log_to_stderr(arguments.verbose);
    if arguments.command.is_none() && !arguments.list_devices {
        say_aside("error: nothing to do: give a command, such as render, or --list-devices; --help explains");
        return ExitCode::from(2);
    }
    let result = match launcher::ranks() {
        Some(ranks) if ranks > 1 && !arguments.is_of_one_process() => on_ranks(&arguments, ranks),
        _ => run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say_aside(&format!("error: {error}"));
            // A setting out of range is wrong use, like a value that the parser refuses.
            ExitCode::from(if matches!(error, Error::Setting { .. }) { 2 } else { 1 })
        }
    }
}

/// Runs a command in this process.
fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Some(Command::Render(render)) if !render.list_devices => render::run(render),
        Some(Command::Animate(animate)) => animate::run(animate),
        Some(Command::Bake(bake)) => bake::run(bake),
        Some(Command::Info(info)) => info::run(info),
        Some(Command::Merge(merge)) => merge::run(merge),
        #[cfg(feature = "viewer")]
        Some(Command::View(view)) => view::run(view),
        _ => list_devices(),
    }
}

/// Runs a command on the ranks that a launcher has started.
#[cfg(feature = "mpi")]
fn on_ranks(arguments: &Arguments, ranks: usize) -> Result<()> {
    cluster::run(arguments, ranks)
}

/// Refuses to render the same image on all ranks.
#[cfg(not(feature = "mpi"))]
fn on_ranks(_: &Arguments, ranks: usize) -> Result<()> {
    Err(launcher::without_mpi(ranks))
}

/// Warnings always, more with each `-v`; `RUST_LOG` selects by module.
fn log_to_stderr(verbose: u8) {
    let level = match verbose {
        0 => log::LevelFilter::Warn,
        1 => log::LevelFilter::Info,
        _ => log::LevelFilter::Debug,
    };
    env_logger::Builder::new()
        .filter_level(level)
        .parse_default_env()
        .format(|out, record| {
            let label = match record.level() {
                log::Level::Error => "error",
                log::Level::Warn => "warning",
                log::Level::Info => "info",
                log::Level::Debug => "debug",
                log::Level::Trace => "trace",
            };
            writeln!(out, "{label}: {}", record.args())
        })
        .init();
}

/// One line per device: index, name and the properties that help to choose.
fn list_devices() -> Result<()> {
    for device in gpu::list_devices()? {
        let kind = format!("{:?}", device.device_type).to_lowercase().replace('_', " ");
        let driver = [device.driver, device.driver_version].join(" ");
        let (driver, api, subgroup) = (driver.trim(), device.api_version, device.subgroup_size);
        let mut line =
            format!("{}  {}  ({kind}; {driver}; Vulkan {api}; subgroups of {subgroup})", device.index, device.name);
        if !device.missing.is_empty() {
            line += &format!("  cannot be used: it lacks {}", device.missing.join(", "));
        }
        say(&line);
    }
    Ok(())
}

/// Whether this process is one of many that render together, and another one speaks.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Says nothing from now on but warnings.
#[cfg(feature = "mpi")]
fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Prints a line to standard output; ignores a closed pipe.
fn say(line: &str) {
    if !QUIET.load(Ordering::Relaxed) {
        let _ = writeln!(std::io::stdout(), "{line}");
    }
}

/// Prints a line to standard error.
fn say_aside(line: &str) {
    if !QUIET.load(Ordering::Relaxed) {
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}
