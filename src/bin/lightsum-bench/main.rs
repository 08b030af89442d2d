//! The benchmark: `lightsum-bench frame`, `shadow-rays`, `scaling`, `startup`, `compare`, `edits`, `convolve`, `motion`, `shadows`,
//! `walkthrough`, `master`.
//!
//! Results go to standard output, as tables or with `--json` as one JSON object a line; the rest goes to standard error.
//! Exit codes: 0 done, 1 failed, 2 wrong use.

#![forbid(unsafe_code)]

mod args;
mod compare;
mod convolve;
mod edits;
mod frame;
mod master;
mod motion;
mod passes;
mod report;
mod scaling;
mod scene;
mod scratch;
mod shadow_rays;
mod shadows;
mod startup;
mod walkthrough;

use args::Command;
use clap::Parser;
use lightsum::Error;
use std::io::ErrorKind;
use std::process::ExitCode;

fn main() -> ExitCode {
    lightsum::scene::silence_caught_panics();
    env_logger::Builder::new().filter_level(log::LevelFilter::Warn).parse_default_env().init();
    let arguments = args::Arguments::parse();
    let result = match &arguments.command {
        Command::Frame(args) => frame::run(args),
        Command::ShadowRays(args) => shadow_rays::run(args),
        Command::Scaling(args) => scaling::run(args),
        Command::Startup(args) => startup::run(args),
        Command::StartupOnce(args) => startup::once(args),
        Command::Compare(args) => compare::run(args),
        Command::Edits(args) => edits::run(args),
        Command::Convolve(args) => convolve::run(args),
        Command::Motion(args) => motion::run(args),
        Command::Shadows(args) => shadows::run(args),
        Command::Walkthrough(args) => walkthrough::run(args),
        Command::Master(args) => master::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        // The reader closed the pipe, as `head` does.
        Err(Error::Io { source, .. }) if source.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => {
            report::say_aside(&format!("error: {error}"));
            ExitCode::from(if matches!(error, Error::Setting { .. }) { 2 } else { 1 })
        }
    }
}
