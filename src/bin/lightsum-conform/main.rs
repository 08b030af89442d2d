//! `lightsum-conform`: the kernels against their oracles on any Vulkan driver, from one file, for people who write drivers and shader
//! compilers.
//!
//! Verdicts go to standard output. Exit codes: 0 nothing failed, 1 something did, or no check could be run, 2 wrong use.

#![forbid(unsafe_code)]

mod args;
mod process;
mod report;

use std::io::Write;
use std::process::ExitCode;

use args::{Arguments, BenchArgs, Command, One, Run, Selection};
use clap::Parser;
use lightsum::conform::{self, ALL, Bench, Check, Outcome, SELF_TESTS, Verdict};
use lightsum::gpu::{self, Context, ContextOptions};
use lightsum::{Error, Result, output};
use report::Report;

fn main() -> ExitCode {
    env_logger::Builder::new().filter_level(log::LevelFilter::Off).parse_default_env().init();
    let ended = match Arguments::parse().command {
        Command::List(selection) => list(&selection),
        Command::Devices => devices(),
        Command::Run(run) => run_checks(&run),
        Command::One(one) => run_one(&one),
    };
    match ended {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Prints a line to standard output; ignores a closed pipe.
fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

fn list(selection: &Selection) -> Result<bool> {
    for check in some(selection)? {
        say(check.name);
        say(&format!("    bound: {}", check.bound));
        if !check.kernels.is_empty() {
            say(&format!("    kernels: {}", check.kernels.replace(' ', ", ")));
        }
        say(&format!("    exercises: {}", check.exercises().join(", ")));
    }
    Ok(true)
}

/// The chosen checks; at least one.
fn some(selection: &Selection) -> Result<Vec<&'static Check>> {
    let checks = selection.checks();
    if checks.is_empty() {
        let message = "no check has this in its name; `lightsum-conform list` shows all names".into();
        return Err(Error::Setting { name: "--filter", message });
    }
    Ok(checks)
}

fn devices() -> Result<bool> {
    for device in gpu::list_devices()? {
        say(&report::device_line(&device));
    }
    Ok(true)
}

fn run_checks(run: &Run) -> Result<bool> {
    let checks = some(&run.selection)?;
    let outputs: Vec<_> = run.json.iter().chain(&run.junit).map(|path| path.as_path()).collect();
    output::check_apart(outputs.iter().copied(), &[])?;
    let _claim = output::claim(outputs.iter().copied())?;
    outputs.iter().try_for_each(|path| output::check_writable(path))?;
    let devices = gpu::list_devices()?;
    let device = devices[run.bench.device.choice.pick(&devices)?].clone(); // `pick` returns an index of the list it was given.
    say(&report::device_line(&device));
    let in_process = if run.in_process { Some(bench(&run.bench)?) } else { None };
    let mut report = Report::new(device, run);
    for check in checks {
        let outcome = match &in_process {
            Some(bench) => conform::run(check, bench),
            None => process::run(check.name, &run.bench, run.timeout),
        };
        say(&report::line(check, &outcome));
        report.add(check, outcome);
    }
    say(&report.totals());
    if let Some(path) = &run.json {
        output::write_file(path, &[report.json().as_bytes(), b"\n"])?;
    }
    if let Some(path) = &run.junit {
        output::write_file(path, &[report.junit().as_bytes()])?;
    }
    Ok(!report.is_bad())
}

fn bench(arguments: &BenchArgs) -> Result<Bench> {
    let device = arguments.device.choice.clone();
    let options = ContextOptions {
        device,
        validation: arguments.validation,
        no_texel_buffers: arguments.no_texel_buffers,
        ..ContextOptions::default()
    };
    // The verdict has the message.
    std::panic::set_hook(Box::new(|_| ()));
    Ok(Bench::new(&Context::headless(&options)?, arguments.choices()))
}

/// The other side of [`process::run`].
fn run_one(one: &One) -> Result<bool> {
    let check = ALL
        .iter()
        .chain(SELF_TESTS)
        .find(|check| check.name == one.name)
        .ok_or_else(|| Error::Setting { name: "NAME", message: format!("there is no check {}", one.name) })?;
    let outcome = match bench(&one.bench) {
        Ok(bench) => conform::run(check, &bench),
        Err(error) => Outcome::without_findings(Verdict::Error, error.to_string(), 0.0),
    };
    say(&report::outcome_line(&outcome));
    Ok(true)
}
