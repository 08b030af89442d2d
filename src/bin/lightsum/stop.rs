//! Stopping conditions of a rendering, and interrupts.

use crate::speak::say_aside;
use lightsum::settings::RenderDefaults;
use lightsum::standalone::Renderer;
use lightsum::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Number of passes if no condition is given.
const DEFAULT_PASSES: u32 = 64;

/// The conditions, at least one; the first one met ends the rendering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    passes: Option<u32>,
    time: Option<Duration>,
    error: Option<f32>,
}

impl Stop {
    /// Those that are given, or the default number of passes.
    pub fn choose(keys: &RenderDefaults) -> Stop {
        let (time, error) = (keys.time.map(Duration::from_secs_f32), keys.target_error);
        let otherwise = (time.is_none() && error.is_none()).then_some(DEFAULT_PASSES);
        Stop { passes: keys.passes.or(otherwise), time, error }
    }

    /// Refuses a target error, for the sake of what takes none.
    pub fn refuse_error(&self, message: &str) -> Result<()> {
        match self.error {
            Some(_) => Err(Error::Setting { name: "--target-error", message: message.into() }),
            None => Ok(()),
        }
    }

    /// Refuses a time, for the sake of what takes none.
    #[cfg(feature = "mpi")]
    pub fn refuse_time(&self, message: &str) -> Result<()> {
        match self.time {
            Some(_) => Err(Error::Setting { name: "--time", message: message.into() }),
            None => Ok(()),
        }
    }

    /// The same with another time, if that is a condition.
    pub fn with_time(self, change: impl FnOnce(Duration) -> Duration) -> Stop {
        Stop { time: self.time.map(change), ..self }
    }

    /// The number of passes, if that is a condition.
    pub fn passes(&self) -> Option<u32> {
        self.passes
    }

    /// Whether the time is over, after `elapsed`.
    pub fn is_late(&self, elapsed: Duration) -> bool {
        self.time.is_some_and(|limit| elapsed >= limit)
    }

    /// Fraction of the time that is over after `elapsed`; 0 if time is no condition.
    pub fn fraction_of_time(&self, elapsed: Duration) -> f64 {
        self.time.map_or(0.0, |time| (elapsed.as_secs_f64() / time.as_secs_f64()).min(1.0))
    }

    /// Whether the rendering is done with `passes` passes in the image, after this run has taken `elapsed`.
    pub fn reached(&self, passes: u32, elapsed: Duration, error: Option<f32>) -> bool {
        self.passes.is_some_and(|limit| passes >= limit)
            || self.is_late(elapsed)
            || self.error.zip(error).is_some_and(|(limit, error)| error <= limit)
    }

    /// Fraction of the work done, in [0, 1], with `passes` in the image, `rendered` of them by this run.
    ///
    /// For a target error it assumes that the error falls with the square root of the passes, the worst case.
    pub fn fraction(&self, passes: u32, rendered: u32, elapsed: Duration, error: Option<f32>) -> f64 {
        let before = f64::from(passes - rendered.min(passes));
        let of_run = |total: f64| f64::from(rendered) / (total - before).max(1e-9);
        let by_passes = self.passes.map(|limit| of_run(f64::from(limit)));
        let by_time = self.time.map(|limit| elapsed.as_secs_f64() / limit.as_secs_f64());
        let by_error = self.error.zip(error).map(|(limit, error)| {
            let ratio = f64::from(error) / f64::from(limit);
            of_run(f64::from(passes) * ratio * ratio)
        });
        [by_passes, by_time, by_error].into_iter().flatten().fold(0.0, f64::max).clamp(0.0, 1.0)
    }
}

/// When work has to end: by an interrupt, or because the time is over, which goes from the start on.
#[derive(Clone, Copy)]
pub struct Clock<'a> {
    interrupted: &'a AtomicBool,
    start: Instant,
    stop: Stop,
}

impl<'a> Clock<'a> {
    /// Starts the clock. `interrupted`: raised by an interrupt.
    pub fn start(stop: Stop, interrupted: &'a AtomicBool) -> Clock<'a> {
        Clock { interrupted, start: Instant::now(), stop }
    }

    /// Whether there was an interrupt.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Whether there was an interrupt or the time is over.
    pub fn is_over(&self) -> bool {
        self.is_interrupted() || self.stop.is_late(self.start.elapsed())
    }

    /// The conditions with what is left of the time.
    pub fn left(&self) -> Stop {
        self.stop.with_time(|time| time.saturating_sub(self.start.elapsed()))
    }

    /// Fraction of the time that is over, if that is a condition.
    pub fn fraction(&self) -> Option<f64> {
        self.stop.time.map(|_| self.stop.fraction_of_time(self.start.elapsed()))
    }

    /// The error of work that ended before there was anything to write: of an interrupt, or of too short a time.
    pub fn tell(&self, error: Error) -> Error {
        match (error, self.stop.time) {
            (Error::Interrupted, Some(time)) if !self.is_interrupted() => {
                let message = format!(
                    "the {} seconds were over before the first pass; nothing was written; give more of them",
                    time.as_secs_f64()
                );
                Error::Setting { name: "--time", message }
            }
            (error, _) => error,
        }
    }
}

/// The renderer's estimate of its error. Errors: the estimate is no number, so that no rendering could ever come below a target.
pub fn error_of(renderer: &Renderer) -> Result<Option<f32>> {
    a_number(renderer.error_estimate(), renderer.passes())
}

fn a_number(estimate: Option<f32>, passes: u32) -> Result<Option<f32>> {
    match estimate {
        Some(estimate) if !estimate.is_finite() => Err(Error::NoEstimate { passes, estimate }),
        estimate => Ok(estimate),
    }
}

/// Whether the error is estimated after this many passes: at an eighth of the passes so far, rounded to a power of two.
///
/// Depends on the number of passes only, so that a resumed run stops at the same pass as an uninterrupted one.
pub fn error_is_due(passes: u32) -> bool {
    passes < 16 || passes.is_multiple_of(1 << (passes.ilog2() - 3))
}

/// The flag that Ctrl-C, SIGTERM and SIGHUP set; the current pass (or path per pixel) is finished first. A second one ends the program
/// at once.
pub fn watch_for_interrupt() -> Arc<AtomicBool> {
    watch_and_tell(|| {})
}

/// [`watch_for_interrupt`], and calls `tell` at once at the first interrupt, from a thread of its own.
pub fn watch_and_tell(tell: impl Fn() + Send + 'static) -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = flag.clone();
    let handler = move || {
        if raised.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        say_aside("interrupted: finishing what was begun; interrupt again to leave at once");
        tell();
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        log::warn!("an interrupt will lose the image: {error}");
    }
    flag
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(passes: Option<u32>, time: Option<u64>, target_error: Option<f32>) -> RenderDefaults {
        RenderDefaults { passes, time: time.map(|s| s as f32), target_error, ..RenderDefaults::default() }
    }

    #[test]
    fn conditions_that_are_given_replace_those_below() {
        let chosen = |over: RenderDefaults, passes| {
            let mut scene = keys(passes, None, None);
            scene.override_by(&over);
            Stop::choose(&scene)
        };
        assert_eq!(chosen(keys(None, None, None), None).passes, Some(64));
        assert_eq!(chosen(keys(None, None, None), Some(9)).passes, Some(9));
        assert_eq!(chosen(keys(Some(3), None, None), Some(9)).passes, Some(3));
        assert_eq!(chosen(keys(None, Some(1), None), Some(9)).passes, None);
        assert_eq!(chosen(keys(None, None, Some(0.1)), Some(9)).passes, None);
    }

    #[test]
    fn the_first_condition_stops() {
        let stop = Stop::choose(&keys(Some(10), Some(5), Some(0.1)));
        let second = Duration::from_secs(1);
        assert!(!stop.reached(9, second, Some(0.11)) && !stop.reached(9, second, None));
        assert!(stop.reached(10, second, None));
        assert!(stop.reached(1, 5 * second, None));
        assert!(stop.reached(1, second, Some(0.1)));
    }

    #[test]
    fn the_fraction_counts_this_run() {
        let second = Duration::from_secs(1);
        let passes = Stop::choose(&keys(Some(10), None, None));
        assert_eq!(passes.fraction(5, 5, second, None), 0.5);
        assert_eq!(passes.fraction(8, 2, second, None), 0.5);
        assert_eq!(passes.fraction(12, 0, second, None), 0.0);
        let time = Stop::choose(&keys(None, Some(4), None));
        assert_eq!(time.fraction(7, 7, second, None), 0.25);
        let error = Stop::choose(&keys(None, None, Some(0.1)));
        assert_eq!(error.fraction(8, 8, second, None), 0.0);
        assert!((error.fraction(8, 8, second, Some(0.2)) - 0.25).abs() < 1e-6);
    }

    #[test]
    fn an_estimate_that_is_no_number_is_an_error() {
        assert_eq!((a_number(None, 3).unwrap(), a_number(Some(0.5), 8).unwrap()), (None, Some(0.5)));
        for estimate in [f32::NAN, f32::INFINITY] {
            let message = a_number(Some(estimate), 9).unwrap_err().to_string();
            assert!(message.contains("after 9 passes is no number"), "{message}");
        }
    }

    #[test]
    fn the_error_is_estimated_ever_more_rarely() {
        let due: Vec<u32> = (0..40).filter(|&n| error_is_due(n)).collect();
        assert_eq!(
            due,
            [(0..16).collect::<Vec<u32>>(), (16..32).step_by(2).collect(), (32..40).step_by(4).collect()].concat()
        );
        assert!(error_is_due(1 << 31) && !error_is_due(u32::MAX));
    }
}
