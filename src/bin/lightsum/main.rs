//! The command line: `lightsum render SCENE -o IMAGE`, `lightsum bake SCENE -o MODEL.glb`, `lightsum animate SCENE -o FRAME-%04d.png`,
//! `lightsum view SCENE`, `lightsum info SCENE`, `lightsum merge FILM... -o IMAGE`, `lightsum compare IMAGE REFERENCE`, `lightsum devices`.
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
mod compare;
mod devices;
mod effect;
mod info;
mod launcher;
mod live;
mod manual;
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
mod speak;
mod stop;
mod strips;
#[cfg(feature = "viewer")]
mod view;

use args::{Arguments, Command};
use lightsum::{Error, Result};
#[cfg(feature = "mpi")]
use speak::be_mute;
use speak::{say, say_aside, say_error};
use std::process::ExitCode;

/// Makes an error of writing of a file that outgrows the system's limit (`ulimit -f`): unless it is caught, the signal ends the program with all
/// that is in memory.
#[cfg(unix)]
fn keep_on_when_files_outgrow_their_limit() {
    let caught = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
    if let Err(error) = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, caught) {
        log::warn!("files that outgrow a limit will end the program: {error}");
    }
}

fn main() -> ExitCode {
    lightsum::scene::silence_caught_panics();
    #[cfg(unix)]
    keep_on_when_files_outgrow_their_limit();
    let arguments = args::parse();
    // Of several ranks the first writes the log.
    let log_file = arguments.log_file.as_deref().filter(|_| launcher::is_first());
    if let Err(error) = speak::log_to(arguments.verbose, arguments.quiet, log_file) {
        say_error(&error.to_string());
        return ExitCode::FAILURE;
    }
    if arguments.command.is_none() && !arguments.list_devices {
        say_error("nothing to do: give a command, such as render, or --list-devices; --help explains");
        return ExitCode::from(2);
    }
    let result = match launcher::ranks() {
        Some(ranks) if ranks > 1 && !arguments.is_of_one_process() => on_ranks(&arguments, ranks).map(|()| true),
        _ => run(&arguments),
    };
    match result {
        Ok(success) => {
            if success {
                ExitCode::SUCCESS
            } else {
                ExitCode::FAILURE
            }
        }
        Err(error) => {
            say_error(&error.to_string());
            // A setting out of range is wrong use, like a value that the parser refuses.
            ExitCode::from(if matches!(error, Error::Setting { .. }) { 2 } else { 1 })
        }
    }
}

/// Runs a command in this process; returns whether a comparison, if it is one, has found what it allows.
fn run(arguments: &Arguments) -> Result<bool> {
    match &arguments.command {
        Some(Command::Compare(args)) => return compare::run(args),
        Some(Command::Devices(args)) => devices::run(args.json),
        Some(Command::Render(render)) if !render.list_devices => render::run(render),
        Some(Command::Animate(animate)) => animate::run(animate),
        Some(Command::Bake(bake)) => bake::run(bake),
        Some(Command::Info(info)) => info::run(info),
        Some(Command::Manual(manual)) => manual::run(manual),
        Some(Command::Merge(merge)) => merge::run(merge),
        #[cfg(feature = "viewer")]
        Some(Command::View(view)) => view::run(view, None),
        _ => devices::run(false),
    }
    .map(|()| true)
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
