//! Medians and spreads, the environment of the measurement, and output.

use lightsum::gpu::DeviceInfo;
use lightsum::settings::Settings;
use lightsum::{Error, Result};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::Path;

/// Fields of a JSON object.
pub type Fields = Map<String, Value>;

/// Median of the times; 0 if there are none.
pub fn median(times: &[f64]) -> f64 {
    quantile(times, 0.5)
}

/// Half the distance between the quartiles, as a fraction of the median; 0 for fewer than two times.
pub fn spread(times: &[f64]) -> f64 {
    let middle = median(times);
    if middle <= 0.0 {
        return 0.0;
    }
    0.5 * (quantile(times, 0.75) - quantile(times, 0.25)) / middle
}

/// Quantile by linear interpolation between two values; 0 if there are none.
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let place = share * last as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64)
}

/// Median and spread of the times as fields.
pub fn summary(times: &[f64]) -> Value {
    json!({ "median_seconds": median(times), "spread": spread(times) })
}

/// Program, device and processor, for every JSON line.
pub fn environment(info: &DeviceInfo) -> Fields {
    // Not every system has this file.
    let (model, clock) = processor(&std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default());
    fields(json!({
        "program": concat!("lightsum ", env!("CARGO_PKG_VERSION")),
        "commit": env!("LIGHTSUM_COMMIT"),
        "device": info.name,
        "driver": format!("{} {}", info.driver, info.driver_version).trim(),
        "subgroup": info.subgroup_size,
        "cores": std::thread::available_parallelism().map_or(0, usize::from),
        "processor": model,
        "clock_mhz": clock,
    }))
}

/// Model of the processor, and the median clock of its cores in MHz, if the text of /proc/cpuinfo has them.
fn processor(cpuinfo: &str) -> (Option<String>, Option<f64>) {
    let entries = || cpuinfo.lines().filter_map(|line| line.split_once(':')).map(|(k, v)| (k.trim(), v.trim()));
    let of = |key: &'static str| entries().filter(move |(k, _)| *k == key).map(|(_, value)| value);
    let model = of("model name").next().map(str::to_owned);
    let clocks: Vec<f64> = of("cpu MHz").filter_map(|mhz| mhz.parse().ok()).collect();
    (model, (!clocks.is_empty()).then(|| median(&clocks)))
}

/// Settings as JSON, through text, which keeps the shortest form of single-precision numbers.
pub fn settings(settings: &Settings) -> Value {
    serde_json::to_string(settings).and_then(|text| serde_json::from_str(&text)).unwrap_or_default()
}

/// The fields of an object; none for other values.
pub fn fields(value: Value) -> Fields {
    match value {
        Value::Object(map) => map,
        _ => Fields::new(),
    }
}

/// Prints the fields together with those of the environment on a line.
pub fn print_json(line: Value, environment: &Fields) -> Result<()> {
    let mut line = fields(line);
    line.extend(environment.clone());
    say(&Value::Object(line).to_string())
}

/// Prints the environment of the tables that follow.
pub fn print_environment(environment: &Fields) -> Result<()> {
    let text = |key: &str| match environment.get(key) {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Number(number)) => format!("{:.0}", number.as_f64().unwrap_or_default()),
        _ => String::from("unknown"),
    };
    say(&format!("{}, commit {}", text("program"), text("commit")))?;
    say(&format!("device: {} ({}), subgroups of {}", text("device"), text("driver"), text("subgroup")))?;
    say(&format!("processor: {}, {} cores, {} MHz", text("processor"), text("cores"), text("clock_mhz")))
}

/// A table: the first column is aligned to the left, the others to the right.
pub struct Table {
    widths: Vec<usize>,
}

impl Table {
    /// Prints the head: name and width of each column.
    pub fn head(columns: &[(&str, usize)]) -> Result<Table> {
        let widths = columns.iter().map(|(name, width)| *width.max(&name.chars().count())).collect();
        let table = Table { widths };
        table.row(&columns.iter().map(|(name, _)| (*name).to_owned()).collect::<Vec<_>>())?;
        Ok(table)
    }

    /// Prints a row.
    pub fn row(&self, cells: &[String]) -> Result<()> {
        say(&self.line(cells))
    }

    fn line(&self, cells: &[String]) -> String {
        let padded = cells.iter().zip(&self.widths).enumerate().map(|(i, (cell, &width))| match i {
            0 => format!("{cell:width$}"),
            _ => format!("{cell:>width$}"),
        });
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    }
}

/// Milliseconds with three or four digits.
pub fn milliseconds(seconds: f64) -> String {
    let ms = seconds * 1e3;
    let digits = if ms < 10.0 {
        3
    } else if ms < 1000.0 {
        1
    } else {
        0
    };
    format!("{ms:.digits$}")
}

/// A fraction as a percentage.
pub fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// Prints a line to standard output.
pub fn say(line: &str) -> Result<()> {
    writeln!(std::io::stdout(), "{line}").map_err(Error::io("writing", Path::new("standard output")))
}

/// Prints a line to standard error; ignores failures.
pub fn say_aside(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert_eq!(median(&[]), 0.0);
        assert_eq!(median(&[3.0]), 3.0);
        assert_eq!(median(&[4.0, 1.0]), 2.5);
        assert_eq!(median(&[9.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 100.0, 2.0]), 3.0);
    }

    #[test]
    fn spreads() {
        assert_eq!((spread(&[]), spread(&[3.0]), spread(&[2.0, 2.0, 2.0])), (0.0, 0.0, 0.0));
        // Quartiles 1.5 and 2.5 around 2; 2 and 4 around 3, whatever the extreme values.
        assert_eq!(spread(&[3.0, 1.0]), 0.25);
        assert_eq!(spread(&[5.0, 3.0, 4.0, 2.0, 1.0]), 1.0 / 3.0);
        assert_eq!(spread(&[900.0, 3.0, 4.0, 2.0, 0.1]), 1.0 / 3.0);
        assert_eq!(spread(&[0.0, 0.0]), 0.0);
    }

    #[test]
    fn processors_are_read_where_they_are_told() {
        let text = "processor\t: 0\nmodel name\t: A: B\ncpu MHz\t\t: 2000.5\n\nprocessor\t: 1\nmodel name\t: C\ncpu MHz\t\t: 3000.5\n";
        assert_eq!(processor(text), (Some("A: B".into()), Some(2500.5)));
        assert_eq!(processor("processor\t: 0\nBogoMIPS\t: 50.0\n"), (None, None));
        assert_eq!(processor(""), (None, None));
    }

    #[test]
    fn columns_are_aligned() {
        let table = Table { widths: vec![6, 4, 3] };
        let line = |cells: &[&str]| table.line(&cells.iter().map(|c| (*c).to_owned()).collect::<Vec<_>>());
        assert_eq!(line(&["a", "1", "2"]), "a          1    2");
        assert_eq!(line(&["µs", "10", "200"]), "µs        10  200");
        assert_eq!(line(&["longer than", "1"]), "longer than     1");
    }

    #[test]
    fn times_keep_their_digits() {
        assert_eq!(milliseconds(0.000_123_4), "0.123");
        assert_eq!(milliseconds(0.012_34), "12.3");
        assert_eq!(milliseconds(12.345_6), "12346");
    }
}
