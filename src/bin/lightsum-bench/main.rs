//! The benchmark: `lightsum-bench frame`, `shadow-rays`, `scaling`, `startup`, `compare`.
//!
//! Results go to standard output, as tables or with `--json` as one JSON object a line; the rest goes to standard error.
//! Exit codes: 0 done, 1 failed, 2 wrong use.

#![forbid(unsafe_code)]

mod args;
mod compare;
mod report;
mod scene;
mod shadow_rays;

use clap::Parser;
use lightsum::Error;
use std::process::ExitCode;

fn main() -> ExitCode {
    env_logger::Builder::new().filter_level(log::LevelFilter::Warn).parse_default_env().init();
    let arguments = args::Arguments::parse();
    let result = match &arguments.command {
        args::Command::ShadowRays(args) => shadow_rays::run(args),
        args::Command::Compare(args) => compare::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(if matches!(error, Error::Setting { .. }) { 2 } else { 1 })
        }
    }
}
