//! Outcomes as lines, as JSON and as JUnit XML.

use std::fmt::Write;

use lightsum::conform::{Check, Outcome, Verdict};
use lightsum::gpu::DeviceInfo;
use serde_json::{Value, json};

use crate::args::Run;

/// All outcomes of a run.
pub struct Report {
    device: DeviceInfo,
    settings: Value,
    outcomes: Vec<(&'static Check, Outcome)>,
}

/// A device in one line.
pub fn device_line(device: &DeviceInfo) -> String {
    let kind = format!("{:?}", device.device_type).to_lowercase().replace('_', " ");
    let driver = [device.driver.as_str(), &device.driver_version].join(" ");
    let DeviceInfo { index, name, api_version, subgroup_size, missing, .. } = device;
    let lacks = if missing.is_empty() { String::new() } else { format!("; it lacks {}", missing.join(", ")) };
    format!("{index}  {name} ({kind}; {}; Vulkan {api_version}; subgroups of {subgroup_size}{lacks})", driver.trim())
}

/// An outcome in one line of JSON, from the process of a check.
pub fn outcome_line(outcome: &Outcome) -> String {
    json!(outcome).to_string()
}

/// An outcome as people read it.
pub fn line(check: &Check, outcome: &Outcome) -> String {
    let mut line = format!("{:<11} {} ({:.1} s", outcome.verdict.word(), check.name, outcome.seconds);
    // Writing to a String cannot fail.
    let _ = match outcome.worst {
        Some([error, bound]) if bound > 0.0 => write!(line, "; worst {error:.1e} of {bound:.1e}"),
        _ => Ok(()),
    };
    if outcome.differing > 0 {
        let _ = write!(line, "; {} of {} differ", outcome.differing, outcome.compared);
    }
    line.push(')');
    for text in outcome.message.lines() {
        let _ = write!(line, "\n            {text}");
    }
    line
}

impl Report {
    pub fn new(device: DeviceInfo, run: &Run) -> Report {
        let settings = json!({
            "seed": run.bench.seed,
            "sizes": run.bench.size,
            "validation": run.bench.validation,
            "no_texel_buffers": run.bench.no_texel_buffers,
            "in_process": run.in_process,
            "timeout_seconds": run.timeout.as_secs_f64(),
        });
        Report { device, settings, outcomes: Vec::new() }
    }

    pub fn add(&mut self, check: &'static Check, outcome: Outcome) {
        self.outcomes.push((check, outcome));
    }

    /// Whether something counts against the driver.
    pub fn is_bad(&self) -> bool {
        self.outcomes.iter().any(|(_, outcome)| outcome.verdict.is_bad())
    }

    fn count(&self, verdicts: &[Verdict]) -> usize {
        self.outcomes.iter().filter(|(_, outcome)| verdicts.contains(&outcome.verdict)).count()
    }

    /// Numbers of the verdicts, those that nothing got left out.
    pub fn totals(&self) -> String {
        use Verdict::{Crashed, Error, Fail, Pass, TimedOut, Unsupported};
        let all = [Pass, Fail, Error, Unsupported, Crashed, TimedOut];
        let counts = all.map(|verdict| (self.count(&[verdict]), verdict.word()));
        let parts = counts.iter().filter(|(count, _)| *count > 0).map(|(count, word)| format!("{count} {word}"));
        parts.collect::<Vec<_>>().join(", ")
    }

    /// Everything, for programs.
    pub fn json(&self) -> String {
        let DeviceInfo { index, name, driver, driver_version, api_version, device_type, subgroup_size, .. } =
            &self.device;
        let device = json!({
            "index": index,
            "name": name,
            "driver": driver,
            "driver_version": driver_version,
            "api_version": api_version,
            "type": format!("{device_type:?}").to_lowercase(),
            "subgroup_size": subgroup_size,
            "subgroup_operations": format!("{:?}", self.device.subgroup_operations),
            "max_storage_buffer_range": self.device.max_storage_buffer_range,
            "max_storage_buffers": self.device.max_storage_buffers,
            "max_allocation": self.device.max_allocation,
            "max_workgroup_count": self.device.max_workgroup_count,
            "max_workgroup_invocations": self.device.max_workgroup_invocations,
            "max_workgroup_memory": self.device.max_workgroup_memory,
            "max_push_bytes": self.device.max_push_bytes,
        });
        let checks: Vec<Value> = self.outcomes.iter().map(|(check, outcome)| of_check(check, outcome)).collect();
        let report = json!({
            "program": concat!("lightsum-conform ", env!("CARGO_PKG_VERSION")),
            "commit": env!("LIGHTSUM_COMMIT"),
            "device": device,
            "settings": self.settings,
            "checks": checks,
        });
        format!("{report:#}")
    }

    /// JUnit XML, one test case for each check: `unsupported` is skipped there, with what is missing.
    pub fn junit(&self) -> String {
        use Verdict::{Crashed, Error, Fail, TimedOut, Unsupported};
        let seconds: f64 = self.outcomes.iter().map(|(_, outcome)| outcome.seconds).sum();
        let mut xml = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuite name=\"lightsum-conform\" tests=\"{}\" failures=\"{}\" \
             errors=\"{}\" skipped=\"{}\" time=\"{seconds:.3}\">\n  <properties>\n",
            self.outcomes.len(),
            self.count(&[Fail]),
            self.count(&[Error, Crashed, TimedOut]),
            self.count(&[Unsupported]),
        );
        let DeviceInfo { name, driver, driver_version, api_version, subgroup_size, .. } = &self.device;
        let subgroup = subgroup_size.to_string();
        let of_device = [
            ("device", name),
            ("driver", driver),
            ("driver_version", driver_version),
            ("api_version", api_version),
            ("subgroup_size", &subgroup),
        ];
        for (key, value) in of_device {
            // Writing to a String cannot fail, here and below.
            let _ = writeln!(xml, "    <property name=\"{key}\" value=\"{}\"/>", escaped(value));
        }
        xml += "  </properties>\n";
        for (check, outcome) in &self.outcomes {
            let (group, name) = check.name.split_once("::").unwrap_or(("", check.name));
            let _ = write!(xml, "  <testcase classname=\"{group}\" name=\"{name}\" time=\"{:.3}\"", outcome.seconds);
            let element = match outcome.verdict {
                Verdict::Pass => {
                    xml += "/>\n";
                    continue;
                }
                Fail => "failure",
                Unsupported => "skipped",
                Error | Crashed | TimedOut => "error",
            };
            let (word, message) = (outcome.verdict.word(), escaped(&outcome.message));
            let _ = writeln!(xml, ">\n    <{element} message=\"{word}\">{message}</{element}>\n  </testcase>");
        }
        xml + "</testsuite>\n"
    }
}

fn of_check(check: &Check, outcome: &Outcome) -> Value {
    json!({
        "name": check.name,
        "kernels": check.kernels.split_whitespace().collect::<Vec<_>>(),
        "exercises": check.exercises(),
        "bound": check.bound,
        "verdict": outcome.verdict,
        "message": outcome.message,
        "seconds": outcome.seconds,
        "compared": outcome.compared,
        "differing": outcome.differing,
        "worst": outcome.worst.map(|[error, bound]| json!({ "error": error, "bound": bound })),
    })
}

/// Text within XML, without the characters that XML cannot hold.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\n' | '\t' => out.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn xml_holds_any_message() {
        assert_eq!(
            escaped("a < b & \"c\" > d\u{0}\u{1b}[0m\n"),
            "a &lt; b &amp; &quot;c&quot; &gt; d\u{fffd}\u{fffd}[0m\n"
        );
    }
}
