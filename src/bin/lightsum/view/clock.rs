//! Times of frames, and from input to image.

use std::time::{Duration, Instant};

/// Times that are kept.
const KEPT: usize = 4096;

/// Measurements of a run.
#[derive(Default)]
pub struct Clock {
    /// Milliseconds from one frame of a moving view to the next.
    pub moving: Series,
    /// Milliseconds from an input that changes the image to the end of the frame that shows it.
    pub latency: Series,
    /// Milliseconds of each GPU pass, smoothed.
    pub passes: Vec<(String, f64)>,
    /// Input that no frame shows yet.
    input: Option<Instant>,
    /// Input that the frame in flight shows.
    shown: Option<Instant>,
    /// End of the frame before, if it was the first pass of its image.
    last: Option<Instant>,
}

/// Numbers of which the latest are kept.
#[derive(Default)]
pub struct Series(Vec<f64>);

impl Series {
    fn add(&mut self, value: Duration) {
        if self.0.len() >= KEPT {
            self.0.remove(0);
        }
        self.0.push(value.as_secs_f64() * 1e3);
    }

    /// The latest.
    pub fn last(&self) -> Option<f64> {
        self.0.last().copied()
    }

    /// The value that a share of the others does not exceed.
    pub fn quantile(&self, share: f64) -> Option<f64> {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(((sorted.len() as f64 - 1.0).max(0.0) * share).round() as usize).copied()
    }

    /// Number of values, median and 95th percentile, as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::json!({ "count": self.0.len(), "median": self.quantile(0.5), "p95": self.quantile(0.95) })
    }
}

impl Clock {
    /// Something happened that the image has to show.
    pub fn input(&mut self) {
        self.input.get_or_insert_with(Instant::now);
    }

    /// A frame with a pass begins.
    pub fn begin(&mut self) {
        self.shown = self.input.take();
    }

    /// A frame with a pass ended; `first`: the first pass of its image. `times`: seconds of its GPU passes.
    pub fn end(&mut self, first: bool, times: &[(String, f64)]) {
        let now = Instant::now();
        if let Some(input) = self.shown.take() {
            self.latency.add(now - input);
        }
        if let (true, Some(last)) = (first, self.last) {
            self.moving.add(now - last);
        }
        self.last = first.then_some(now);
        self.passes.retain(|(name, _)| times.iter().any(|(now, _)| now == name));
        for (name, seconds) in times {
            let ms = seconds * 1e3;
            match self.passes.iter_mut().find(|(known, _)| known == name) {
                Some((_, smoothed)) => *smoothed += 0.3 * (ms - *smoothed),
                None => self.passes.push((name.clone(), ms)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_few_numbers() {
        let mut series = Series::default();
        assert_eq!(series.quantile(0.5), None);
        (1..=5).rev().for_each(|ms| series.add(Duration::from_millis(ms)));
        assert_eq!((series.last(), series.quantile(0.5), series.quantile(1.0)), (Some(1.0), Some(3.0), Some(5.0)));
    }

    #[test]
    fn only_frames_of_a_moving_view_count() {
        let mut clock = Clock::default();
        let times = |ms: f64| vec![(String::from("shade"), ms * 1e-3)];
        clock.input();
        for first in [true, true, false, true] {
            clock.begin();
            clock.end(first, &times(10.0));
        }
        assert_eq!((clock.moving.0.len(), clock.latency.0.len()), (1, 1));
        assert!((clock.passes[0].1 - 10.0).abs() < 1e-9);
        clock.end(false, &times(20.0));
        assert!((clock.passes[0].1 - 13.0).abs() < 1e-9);
        clock.end(false, &[]);
        assert!(clock.passes.is_empty());
    }
}
