//! Progress on standard error: a bar on a terminal, a plain line every few seconds elsewhere.

use crate::say_aside;
use crate::speak::is_quiet;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Interval between two plain lines.
const LINES: Duration = Duration::from_secs(5);
/// Steps of the bar.
const STEPS: u64 = 1000;

/// Progress display.
pub struct Progress {
    bar: Option<ProgressBar>,
    start: Instant,
    line: Instant,
}

impl Progress {
    /// Starts the clock.
    pub fn new() -> Progress {
        let style = ProgressStyle::with_template("{bar:30} {msg}");
        let bar = style
            .ok()
            .filter(|_| std::io::stderr().is_terminal() && !is_quiet())
            .map(|s| ProgressBar::new(STEPS).with_style(s));
        let start = Instant::now();
        Progress { bar, start, line: start }
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Updates the display. `done`: progress in words; `fraction`: fraction of this run's work, in [0, 1].
    pub fn show(&mut self, done: impl FnOnce() -> String, fraction: f64) {
        if self.bar.is_none() && self.line.elapsed() < LINES {
            return;
        }
        let mut text = done();
        if let Some(rest) = remaining(self.elapsed(), fraction) {
            text += &format!(", {} left", duration(rest));
        }
        match &self.bar {
            Some(bar) => {
                bar.set_position((fraction * STEPS as f64) as u64);
                bar.set_message(text);
            }
            None => {
                self.line = Instant::now();
                say_aside(&text);
            }
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Estimated remaining time at the present rate; `None` before any work is done.
fn remaining(elapsed: Duration, fraction: f64) -> Option<Duration> {
    let rest = elapsed.as_secs_f64() * (1.0 / fraction - 1.0);
    Duration::try_from_secs_f64(rest).ok().filter(|_| fraction > 0.0)
}

/// A duration for people, such as `1 h 05 min`, `3 min 20 s`, `4.2 s`.
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs();
    match seconds {
        0..10 => format!("{:.1} s", time.as_secs_f64()),
        10..60 => format!("{seconds} s"),
        60..3600 => format!("{} min {:02} s", seconds / 60, seconds % 60),
        _ => format!("{} h {:02} min", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_read_well() {
        let text = |seconds: f64| duration(Duration::from_secs_f64(seconds));
        assert_eq!(text(4.21), "4.2 s");
        assert_eq!(text(59.9), "59 s");
        assert_eq!(text(200.0), "3 min 20 s");
        assert_eq!(text(3900.0), "1 h 05 min");
    }

    #[test]
    fn remaining_time_is_in_proportion() {
        let second = Duration::from_secs(1);
        assert_eq!(remaining(second, 0.25), Some(3 * second));
        assert_eq!(remaining(second, 1.0), Some(Duration::ZERO));
        assert_eq!(remaining(second, 0.0), None);
        assert_eq!(remaining(second, 1e-300), None);
    }
}
