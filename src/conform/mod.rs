//! The kernels against their oracles: what `lightsum-conform` and the tests run on a device.
//!
//! A [`Check`] runs some kernels at awkward sizes and compares what they write with functions on the processor that follow the equations,
//! not the shaders. It ends early, by a panic as a test does, where a comparison fails or a call of Vulkan reports an error; [`run`] makes a
//! [`Verdict`] of that.
//!
//! Of this module no more is promised than what the program needs; it changes with the kernels.

#[allow(missing_docs, reason = "checks are named by what they show, and describe themselves in their list")]
pub mod checks;

pub mod bench;
pub mod findings;
#[allow(missing_docs, reason = "scenes for checks and tests")]
pub mod gallery;
pub mod kernels;
mod list;
pub mod lobe_tables;
#[allow(missing_docs, reason = "the workbench of checks and tests")]
pub mod rig;
pub mod spirv;
#[allow(missing_docs, reason = "the comparisons of checks and tests")]
pub mod tally;

use std::any::Any;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

use serde::{Deserialize, Serialize};

pub use bench::{AWKWARD_IMAGES, AWKWARD_SIZES, Bench, Choices, Numbers};
pub use findings::Must;
use findings::Problem;
pub use list::{ALL, SELF_TESTS};

use crate::gpu::{Shader, shaders};

/// Initial content of outputs, which reveals elements that were not written.
pub const SENTINEL: u32 = 0xdead_beef;

/// A comparison of kernels with their oracles.
pub struct Check {
    /// Its name: a group and what holds if it passes.
    pub name: &'static str,
    /// Stems of the kernels that it is about, separated by spaces. Others may run before them.
    pub kernels: &'static str,
    /// Its needs beyond those of every check.
    pub needs: Needs,
    /// How the kernels are run, where that is part of the matter.
    pub host: &'static str,
    /// Within what the device and the oracle must agree.
    pub bound: &'static str,
    /// Runs it; panics if it fails.
    pub run: fn(&Bench),
}

/// A need of a check beyond Vulkan 1.1 with compute and the storage buffers that the kernels bind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Nothing.
    Nothing,
    /// Subgroups of a size for which there are kernels that trace rays in clusters.
    Clusters,
}

impl Check {
    /// The features of SPIR-V and of Vulkan that its kernels use.
    pub fn exercises(&self) -> Vec<&'static str> {
        // Variants of a kernel continue its name.
        let belongs = |stem: &str, shader: &Shader| {
            shader.name.strip_prefix(stem).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
        };
        let all = || shaders::ALL.iter().chain(kernels::ALL);
        let used = |stem: &'static str| all().filter(move |shader| belongs(stem, shader));
        let mut found: BTreeSet<&str> =
            self.kernels.split_whitespace().flat_map(used).flat_map(|shader| spirv::features(shader)).collect();
        found.extend(self.host.split(", ").filter(|text| !text.is_empty()));
        found.into_iter().collect()
    }

    /// The feature or limit that the device lacks for it, if any.
    pub fn lacks(&self, bench: &Bench) -> Option<String> {
        match self.needs {
            Needs::Nothing => None,
            Needs::Clusters => bench.lacks_clusters(),
        }
    }
}

/// The end of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The kernels agree with their oracles.
    Pass,
    /// They do not, or the validation layer has something to say.
    Fail,
    /// A call of Vulkan failed.
    Error,
    /// The device lacks what the message names.
    Unsupported,
    /// The process ended by a signal, or without a verdict.
    Crashed,
    /// The check did not end in time.
    TimedOut,
}

impl Verdict {
    /// Whether it counts against the driver.
    pub fn is_bad(self) -> bool {
        !matches!(self, Verdict::Pass | Verdict::Unsupported)
    }

    /// Its word.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Pass => "pass",
            Verdict::Fail => "fail",
            Verdict::Error => "error",
            Verdict::Unsupported => "unsupported",
            Verdict::Crashed => "crashed",
            Verdict::TimedOut => "timed-out",
        }
    }
}

/// Outcome of a check.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outcome {
    /// The verdict.
    pub verdict: Verdict,
    /// The difference, failure or missing need; empty if it passed.
    pub message: String,
    /// Seconds that it took.
    pub seconds: f64,
    /// Comparisons that were counted, and those that differ by more than their bound where rounding decides.
    pub compared: u64,
    /// See `compared`.
    pub differing: u64,
    /// The error that is largest relative to its bound, and this bound; absent where all comparisons were exact.
    pub worst: Option<[f32; 2]>,
}

impl Outcome {
    /// The outcome of a check of which nothing else is known.
    pub fn without_findings(verdict: Verdict, message: impl Into<String>, seconds: f64) -> Outcome {
        Outcome { verdict, message: message.into(), seconds, compared: 0, differing: 0, worst: None }
    }
}

/// Runs a check. Messages of the validation layer fail it, if the bench's device has the layer.
pub fn run(check: &Check, bench: &Bench) -> Outcome {
    let start = Instant::now();
    if let Some(lacking) = check.lacks(bench) {
        return Outcome::without_findings(Verdict::Unsupported, lacking, 0.0);
    }
    findings::take();
    bench.take_messages();
    // The bench is read only; what the check made is dropped with it.
    let ended = catch_unwind(AssertUnwindSafe(|| (check.run)(bench)));
    let findings = findings::take();
    let messages = bench.take_messages();
    let (verdict, message) = match (ended, findings.problem) {
        (Ok(()), _) if messages.is_empty() => (Verdict::Pass, String::new()),
        (Ok(()), _) => (Verdict::Fail, format!("the validation layer reports: {}", messages.join("\n"))),
        (Err(_), Some(Problem::Lacks(what))) => (Verdict::Unsupported, what),
        (Err(_), Some(Problem::Failed(what))) => (Verdict::Error, what),
        (Err(panic), None) => (Verdict::Fail, text_of(panic.as_ref())),
    };
    Outcome {
        verdict,
        message,
        seconds: start.elapsed().as_secs_f64(),
        compared: findings.compared,
        differing: findings.differing,
        worst: findings.worst.map(|worst| [worst.error, worst.bound]),
    }
}

/// The message of a panic.
fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    text.unwrap_or("a comparison failed").to_owned()
}
