//! Medians, spreads and what was measured on.

use lightsum::gpu::DeviceInfo;
use serde_json::{Map, Value, json};

/// Median of the times; 0 of none.
pub fn median(times: &[f64]) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

/// Half the distance between the quartiles, as a share of the median.
pub fn spread(times: &[f64]) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (n, middle) = (sorted.len(), median(times));
    if n < 2 || middle <= 0.0 {
        return 0.0;
    }
    0.5 * (sorted[3 * (n - 1) / 4] - sorted[(n - 1) / 4]) / middle
}

/// Device, driver and program, for every JSON line.
pub fn environment(info: &DeviceInfo) -> Map<String, Value> {
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let fields = json!({
        "program": concat!("lightsum ", env!("CARGO_PKG_VERSION")),
        "device": info.name,
        "driver": format!("{} {}", info.driver, info.driver_version).trim(),
        "subgroup": info.subgroup_size,
        "cores": cores,
    });
    match fields {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

/// Prints the fields in front of those of the environment.
pub fn print_json(fields: Value, environment: &Map<String, Value>) {
    let mut line = match fields {
        Value::Object(map) => map,
        _ => Map::new(),
    };
    line.extend(environment.clone());
    println!("{}", Value::Object(line));
}
