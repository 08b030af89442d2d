//! A check in a process of its own, which may crash or never end.

use std::io::Read;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use lightsum::conform::{Outcome, Verdict};

use crate::args::BenchArgs;

/// Most characters that are kept of what a process that crashed has said: the end of it.
const MOST_SAID: usize = 2000;

/// Runs a check by this program itself, for so long at most.
pub fn run(name: &str, bench: &BenchArgs, timeout: Duration) -> Outcome {
    let start = Instant::now();
    let without = |verdict, message: String| Outcome::without_findings(verdict, message, start.elapsed().as_secs_f64());
    let mut child = match spawn(name, bench) {
        Ok(child) => child,
        Err(error) => return without(Verdict::Error, format!("the check's process cannot be started: {error}")),
    };
    let (said, aside) = (reader(child.stdout.take()), reader(child.stderr.take()));
    // The process keeps its output open until it ends.
    let Ok(said) = said.recv_timeout(timeout) else {
        // It may have ended by itself in this moment.
        let _ = child.kill();
        let _ = child.wait();
        return without(Verdict::TimedOut, format!("it did not end within {} s", timeout.as_secs_f64()));
    };
    let ended = match child.wait() {
        Ok(status) => status,
        Err(error) => return without(Verdict::Error, format!("the check's process is lost: {error}")),
    };
    let outcome = said.lines().last().and_then(|line| serde_json::from_str(line).ok());
    match outcome {
        Some(outcome) if ended.success() => outcome,
        // With a verdict too: the driver crashed when its device went.
        _ => {
            let aside = aside.recv_timeout(Duration::from_secs(1)).unwrap_or_default();
            without(Verdict::Crashed, [how(ended), tail(&aside)].join("\n").trim().to_owned())
        }
    }
}

fn spawn(name: &str, bench: &BenchArgs) -> std::io::Result<Child> {
    Command::new(std::env::current_exe()?)
        .args(["one", name])
        .args(bench.flags())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
}

/// Reads all of a pipe on a thread of its own, lest a full one stop the process.
fn reader(pipe: Option<impl Read + Send + 'static>) -> mpsc::Receiver<String> {
    let (send, receive) = mpsc::channel();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // Output that came before an error counts.
            let _ = pipe.read_to_end(&mut bytes);
        }
        let _ = send.send(String::from_utf8_lossy(&bytes).into_owned());
    });
    receive
}

fn how(status: ExitStatus) -> String {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return format!("the process ended by signal {signal}{}", name_of(signal));
    }
    format!("the process ended without a verdict ({status})")
}

/// Names of the signals that end programs, where their numbers are the same everywhere.
#[cfg(unix)]
fn name_of(signal: i32) -> &'static str {
    match signal {
        4 => " (SIGILL: an instruction that the processor does not have)",
        6 => " (SIGABRT: the program gave up)",
        8 => " (SIGFPE: a division by zero)",
        9 => " (SIGKILL: ended from outside, perhaps for want of memory)",
        11 => " (SIGSEGV: an access to memory that is not there)",
        _ => "",
    }
}

/// The end of a text.
fn tail(text: &str) -> String {
    let skipped = text.chars().count().saturating_sub(MOST_SAID);
    text.chars().skip(skipped).collect()
}
