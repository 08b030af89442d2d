//! Lines for the user: results on standard output, all else on standard error, and in the file of `--log-file`.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Instant;

use lightsum::output::{self, Claim};
use lightsum::{Error, Result};

/// Whether this process is one of many that render together, and another one speaks.
static MUTE: AtomicBool = AtomicBool::new(false);
/// Whether errors alone are told.
static QUIET: AtomicBool = AtomicBool::new(false);
/// Whether a file of the run goes to standard output.
static IS_TAKEN: AtomicBool = AtomicBool::new(false);
/// The file of `--log-file`, the start of the program, and the claim that keeps it from being another output as well.
static LOG: OnceLock<(Mutex<File>, Instant, Claim)> = OnceLock::new();

/// Leaves standard output to a file of the run, if one of these goes there: lines go to standard error.
pub fn leave_output_to<'a>(files: impl IntoIterator<Item = &'a Path>) {
    if files.into_iter().any(output::is_standard_output) {
        IS_TAKEN.store(true, Ordering::Relaxed);
    }
}

/// Says nothing from now on but warnings.
#[cfg(feature = "mpi")]
pub fn be_mute() {
    MUTE.store(true, Ordering::Relaxed);
}

/// Whether progress and notes are told.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Prints a line to standard output; ignores a closed pipe.
pub fn say(line: &str) {
    if IS_TAKEN.load(Ordering::Relaxed) {
        return say_aside(line);
    }
    note("", line);
    if !MUTE.load(Ordering::Relaxed) {
        let _ = writeln!(std::io::stdout(), "{line}");
    }
}

/// Prints a line to standard error.
pub fn say_aside(line: &str) {
    note("", line);
    if !MUTE.load(Ordering::Relaxed) && !is_quiet() {
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}

/// Prints an error to standard error.
pub fn say_error(error: &str) {
    note("error: ", error);
    if !MUTE.load(Ordering::Relaxed) {
        let _ = writeln!(std::io::stderr(), "error: {error}");
    }
}

/// Writes a line to the file of `--log-file`, with the seconds since the start.
fn note(label: &str, line: &str) {
    if let Some((file, start, _)) = LOG.get() {
        let seconds = start.elapsed().as_secs_f64();
        // A full disk must not end a rendering.
        let _ = writeln!(file.lock().unwrap_or_else(PoisonError::into_inner), "{seconds:10.3} {label}{line}");
    }
}

/// Opens the file of `--log-file`, which takes the place of an earlier log alone: what a scene is read from is not known yet.
fn open_log(path: &Path) -> Result<(Mutex<File>, Instant, Claim)> {
    let claim = output::claim([path])?;
    let is_log = |line: &str| line.trim_start().split_once(' ').is_some_and(|(time, _)| time.parse::<f64>().is_ok());
    if std::fs::metadata(path).is_ok_and(|file| file.is_file() && file.len() > 0) {
        let (mut first, mut file) = ([0; 32], File::open(path).map_err(Error::io("reading", path))?);
        let length = file.read(&mut first).map_err(Error::io("reading", path))?;
        if !is_log(&String::from_utf8_lossy(&first[..length])) {
            let message = "--log-file would overwrite this file, and it is no log; give another name, or remove it";
            return Err(Error::file(path, message));
        }
    }
    let file = File::create(path).map_err(Error::io("writing", path))?;
    Ok((Mutex::new(file), Instant::now(), claim))
}

/// Sets up logging: warnings on standard error unless `quiet`, and more with each `-v`; `RUST_LOG` selects by module. A file gets at least
/// all that `-v` shows. Errors: it cannot be written.
pub fn log_to(verbose: u8, quiet: bool, file: Option<&Path>) -> Result<()> {
    QUIET.store(quiet, Ordering::Relaxed);
    let level = match (quiet, verbose) {
        (true, _) => log::LevelFilter::Error,
        (false, 0) => log::LevelFilter::Warn,
        (false, 1) => log::LevelFilter::Info,
        (false, _) => log::LevelFilter::Debug,
    };
    let mut builder = env_logger::Builder::new();
    builder.filter_level(level).parse_default_env();
    let by_default = std::env::var_os("RUST_LOG").is_none();
    if let Some(path) = file {
        let log = open_log(path)?;
        // It is set once.
        let _ = LOG.set(log);
        if by_default {
            builder.filter_level(level.max(log::LevelFilter::Info));
        }
    }
    builder.format(move |out, record| {
        let label = match record.level() {
            log::Level::Error => "error: ",
            log::Level::Warn => "warning: ",
            log::Level::Info => "info: ",
            log::Level::Debug => "debug: ",
            log::Level::Trace => "trace: ",
        };
        let text = record.args().to_string();
        note(label, &text);
        if by_default && record.level() > level { Ok(()) } else { writeln!(out, "{label}{text}") }
    });
    builder.init();
    Ok(())
}
