//! The frames of each number of reflectors, their means, and the slope over the number.

use lightsum::Result;
use serde_json::{Value, json};

use crate::args::Source;
use crate::report::{self, Fields, Table, milliseconds, percent};

/// Times of a frame.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Seconds by the wall clock.
    pub seconds: f64,
    /// Processor seconds of all threads of the process, the driver's too. On a driver that runs on processors they tell the cost of a
    /// frame better where others use the machine.
    pub cpu: f64,
    /// Seconds of each GPU pass by its timestamps.
    pub gpu_passes: Vec<(String, f64)>,
}

/// The frames for one source of mirror images and one number of reflectors.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Source of mirror images.
    pub source: Source,
    /// Maximum number of glossy planes that mirror the room.
    pub reflectors: u32,
    /// Frames in order.
    pub frames: Vec<Frame>,
}

impl Series {
    /// No frames yet.
    pub fn new(source: Source, reflectors: u32) -> Series {
        Series { source, reflectors, frames: Vec::new() }
    }

    /// A time of each frame.
    fn times(&self, of: impl Fn(&Frame) -> f64) -> Vec<f64> {
        self.frames.iter().map(of).collect()
    }

    /// Seconds of each frame.
    pub fn seconds(&self) -> Vec<f64> {
        self.times(|frame| frame.seconds)
    }

    /// Mean seconds of each GPU pass, in order of the passes.
    fn passes(&self) -> Vec<(&str, f64)> {
        let mut sums: Vec<(&str, f64)> = Vec::new();
        for (name, seconds) in self.frames.iter().flat_map(|frame| &frame.gpu_passes) {
            match sums.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += seconds,
                None => sums.push((name, *seconds)),
            }
        }
        sums.into_iter().map(|(name, sum)| (name, sum / self.frames.len() as f64)).collect()
    }

    /// Means and medians as fields; `without` marks the frames that show no reflector.
    pub fn fields(&self, without: &[bool]) -> Fields {
        let (seconds, cpu) = (self.seconds(), self.times(|frame| frame.cpu));
        let of_mean = mean(&seconds);
        let passes = self.passes().into_iter();
        let passes = passes.map(|(pass, s)| json!({ "pass": pass, "mean_seconds": s, "share": s / of_mean }));
        report::fields(json!({
            "mirror_source": self.source.name(),
            "reflectors": self.reflectors,
            "frames": seconds.len(),
            "mean_seconds": of_mean,
            "median_seconds": report::median(&seconds),
            "frames_per_second": 1.0 / of_mean,
            "mean_cpu_seconds": mean(&cpu),
            "without_reflectors": {
                "frames": without.iter().filter(|without| **without).count(),
                "mean_seconds": mean_if(&seconds, without),
                "mean_cpu_seconds": mean_if(&cpu, without),
            },
            "gpu_passes": passes.collect::<Vec<_>>(),
        }))
    }

    /// These, and the times of each frame.
    pub fn all_fields(&self, without: &[bool]) -> Fields {
        let mut fields = self.fields(without);
        let frames = self.frames.iter().map(|frame| {
            let passes: Fields = frame.gpu_passes.iter().map(|(name, s)| (name.clone(), (*s).into())).collect();
            json!({ "seconds": frame.seconds, "cpu_seconds": frame.cpu, "gpu_passes": passes })
        });
        fields.insert("times".into(), frames.collect());
        fields
    }
}

/// Mean; 0 if there are none.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Mean of the chosen; `None` if there are none.
fn mean_if(values: &[f64], chosen: &[bool]) -> Option<f64> {
    let chosen: Vec<f64> = values.iter().zip(chosen).filter(|(_, chosen)| **chosen).map(|(value, _)| *value).collect();
    (!chosen.is_empty()).then(|| mean(&chosen))
}

/// Slope of the line through the points (x, y) with the least squares; `None` for fewer than two different x.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let [x, y] =
        [points.iter().map(|p| p.0).collect::<Vec<_>>(), points.iter().map(|p| p.1).collect()].map(|v| mean(&v));
    let square = points.iter().map(|p| (p.0 - x) * (p.0 - x)).sum::<f64>();
    (square > 0.0).then(|| points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / square)
}

/// Slope of a mean of each series over the number of reflectors.
fn slope_of(series: &[Series], of: impl Fn(&Series) -> Option<f64>) -> Option<f64> {
    let points: Vec<(f64, f64)> = series.iter().filter_map(|s| Some((f64::from(s.reflectors), of(s)?))).collect();
    slope(&points)
}

/// Seconds that each reflector adds to a frame, of the wall clock and of the processor, over all frames and over those without
/// reflectors in view.
pub fn slopes(series: &[Series], without: &[bool]) -> Value {
    json!({
        "seconds": slope_of(series, |s| Some(mean(&s.seconds()))),
        "cpu_seconds": slope_of(series, |s| Some(mean(&s.times(|frame| frame.cpu)))),
        "seconds_without": slope_of(series, |s| mean_if(&s.seconds(), without)),
        "cpu_seconds_without": slope_of(series, |s| mean_if(&s.times(|frame| frame.cpu), without)),
    })
}

/// Prints the tables and the slopes of one source.
pub fn print(series: &[Series], without: &[bool]) -> Result<()> {
    let columns = [
        ("reflectors", 10),
        ("mean ms", 8),
        ("median ms", 9),
        ("frames/s", 8),
        ("CPU ms", 8),
        ("none in view ms", 15),
        ("its CPU ms", 10),
    ];
    let table = Table::head(&columns)?;
    for s in series {
        let (seconds, cpu) = (s.seconds(), s.times(|frame| frame.cpu));
        let some = |times: &[f64]| mean_if(times, without).map_or_else(|| String::from("-"), milliseconds);
        table.row(&[
            s.reflectors.to_string(),
            milliseconds(mean(&seconds)),
            milliseconds(report::median(&seconds)),
            format!("{:.2}", 1.0 / mean(&seconds)),
            milliseconds(mean(&cpu)),
            some(&seconds),
            some(&cpu),
        ])?;
    }
    let text = |slope: &Value| slope.as_f64().map_or_else(|| String::from("-"), milliseconds);
    let slopes = slopes(series, without);
    report::say(&format!(
        "each reflector adds {} ms to a frame ({} ms CPU), and {} ms ({} ms CPU) where none is in view",
        text(&slopes["seconds"]),
        text(&slopes["cpu_seconds"]),
        text(&slopes["seconds_without"]),
        text(&slopes["cpu_seconds_without"]),
    ))?;
    report::say("")?;
    let heads: Vec<String> = series.iter().map(|s| s.reflectors.to_string()).collect();
    let columns: Vec<(&str, usize)> =
        std::iter::once(("pass, mean ms", 19)).chain(heads.iter().map(|n| (n.as_str(), 14))).collect();
    let table = Table::head(&columns)?;
    let of_each: Vec<Vec<(&str, f64)>> = series.iter().map(Series::passes).collect();
    // The last series has the most passes.
    for (name, _) in of_each.last().into_iter().flatten() {
        let cells =
            of_each.iter().zip(series).map(|(passes, s)| match passes.iter().find(|(known, _)| known == name) {
                Some((_, seconds)) => {
                    format!("{} {:>5}", milliseconds(*seconds), percent(seconds / mean(&s.seconds())))
                }
                None => String::from("-"),
            });
        table.row(&std::iter::once((*name).to_owned()).chain(cells).collect::<Vec<_>>())?;
    }
    report::say("sort and clusters are parts of eye, near_* of near_light, convolve of mirrors")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_those_of_lines() {
        assert_eq!(slope(&[(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]), Some(2.0));
        assert_eq!(slope(&[(1.0, 0.0), (2.0, 3.0), (3.0, 0.0)]), Some(0.0));
        assert_eq!((slope(&[]), slope(&[(1.0, 2.0)])), (None, None));
    }

    #[test]
    fn frames_without_reflectors_are_apart() {
        let frame =
            |seconds: f64| Frame { seconds, cpu: 2.0 * seconds, gpu_passes: vec![("eye".into(), 0.5 * seconds)] };
        let series = Series { frames: [1.0, 2.0, 6.0].map(frame).into(), ..Series::new(Source::Rays, 3) };
        let fields = series.fields(&[true, true, false]);
        assert_eq!((&fields["mean_seconds"], &fields["median_seconds"]), (&3.0.into(), &2.0.into()));
        assert_eq!(fields["without_reflectors"], json!({ "frames": 2, "mean_seconds": 1.5, "mean_cpu_seconds": 3.0 }));
        assert_eq!(fields["gpu_passes"], json!([{ "pass": "eye", "mean_seconds": 1.5, "share": 0.5 }]));
        assert_eq!(series.fields(&[false; 3])["without_reflectors"]["mean_seconds"], Value::Null);
    }
}
