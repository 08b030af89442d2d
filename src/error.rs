//! The error type. A message names the file, pass, material or resource, and the remedy.

use std::path::{Path, PathBuf};

/// Result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Error of any operation of the library. The message contains what is needed to fix it.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be read or written.
    #[error("{}: {action} failed: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The action: "reading", "writing", "renaming".
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A scene, model, texture or state file is invalid.
    #[error("{}{}: {message}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    File {
        /// The file.
        path: PathBuf,
        /// The line, if known (from 1).
        line: Option<usize>,
        /// The problem, its object, and the remedy.
        message: String,
    },
    /// The scene as a whole cannot be rendered.
    #[error("scene: {0}")]
    Scene(String),
    /// A setting is out of range.
    #[error("setting {name}: {message}")]
    Setting {
        /// Name of the setting, as on the command line.
        name: &'static str,
        /// The problem and the valid values.
        message: String,
    },
    /// There is no usable Vulkan device, driver or layer.
    #[error("{0}")]
    NoDevice(String),
    /// A Vulkan call failed.
    #[error("{what}: the driver reports {result}; try again, with a newer driver or another device (--list-devices)")]
    Vulkan {
        /// The call or pass.
        what: String,
        /// Vulkan's result code.
        result: ash::vk::Result,
    },
    /// The device was lost while a pass ran.
    #[error(
        "the device was lost ({during}): the driver reset it (watchdog or fault); lower --lights-per-dispatch or the resolution"
    )]
    DeviceLost {
        /// The work in progress.
        during: String,
    },
    /// Device or host memory ran out.
    #[error(
        "{resource}: no memory{}; lower the resolution or --particles, simplify the scene, or end other programs",
        bytes.map(|n| format!(" for {n} bytes")).unwrap_or_default()
    )]
    OutOfMemory {
        /// The requested resource.
        resource: String,
        /// Its size, if Vulkan was told one.
        bytes: Option<u64>,
    },
    /// Buffers and images would take more of the device's memory than there is, or than [`crate::gpu::ContextOptions::max_memory`] allows.
    #[error(
        "{resource}: {needed} bytes of the device's memory are needed, {limit} are free or allowed; {advice}, or raise --max-device-memory"
    )]
    TooMuchMemory {
        /// The resource that does not fit.
        resource: String,
        /// Bytes of all resources: of those up to this one, or of all that are needed if that is known.
        needed: u64,
        /// Bytes that may be taken.
        limit: u64,
        /// Settings that lower most of them.
        advice: &'static str,
    },
    /// The device did not finish its work.
    #[error(
        "the device did not finish {during} within {seconds} s; lower --lights-per-dispatch or the resolution, or look whether the driver hangs"
    )]
    Timeout {
        /// The work in progress.
        during: String,
        /// The time that it had.
        seconds: u64,
    },
    /// A resource exceeds a limit of the device.
    #[error("{resource}: {bytes} bytes exceed the device's limit of {limit} ({limit_name}); {advice}")]
    DeviceLimit {
        /// The resource.
        resource: String,
        /// Its size.
        bytes: u64,
        /// The limit's value.
        limit: u64,
        /// The limit's name in Vulkan.
        limit_name: &'static str,
        /// The remedy.
        advice: &'static str,
    },
    /// Invalid use of a device resource.
    #[error("{name}: {message}")]
    Resource {
        /// Its name.
        name: String,
        /// The problem and the remedy.
        message: String,
    },
    /// A shader does not fit the device or its bindings, or failed to compile (`hot-reload`).
    #[error("shader {name}: {message}")]
    Shader {
        /// Stem of the shader.
        name: String,
        /// naga's report.
        message: String,
    },
    /// Passes one after the other have values that are no numbers.
    #[error(
        "{passes} passes in a row have pixels whose light is no number (NaN or infinite), {pixels} in the last one, such as {},{}: look for \
         extreme values of emission, sizes or distances in what that pixel shows, or try another device", at[0], at[1]
    )]
    NoNumber {
        /// Passes that were left out.
        passes: u32,
        /// Such pixels of the last of them.
        pixels: u32,
        /// One of them, column and row in the view.
        at: [u32; 2],
    },
    /// The path tracer finds no number for a pixel.
    #[error(
        "all {paths} paths of pixel {},{} have light that is no number (NaN, infinite, or 2^100 and more): look for extreme values of \
         emission, sizes or distances in what that pixel shows", at[0], at[1]
    )]
    NoNumberTraced {
        /// Paths that were left out.
        paths: u32,
        /// The pixel, column and row in the view.
        at: [u32; 2],
    },
    /// The error of an image cannot be estimated, since the estimate is no number.
    #[error(
        "the estimated error after {passes} passes is no number ({estimate}); a rendering with --passes or --time needs none"
    )]
    NoEstimate {
        /// Passes in the image.
        passes: u32,
        /// The estimate.
        estimate: f32,
    },
    /// An interrupt before the first result.
    #[error("interrupted before the first pass was done; nothing was written")]
    Interrupted,
    /// A rank of a cluster cannot go on.
    #[error("rank {rank} on {host}: {message}")]
    Rank {
        /// Its number.
        rank: usize,
        /// Its machine.
        host: String,
        /// The problem and the remedy.
        message: String,
    },
    /// A ray needed more traversal steps than the rounds of a pass allow.
    #[error("pass {pass}: {rays} rays did not finish within {steps} steps; raise --rounds")]
    Unfinished {
        /// The pass.
        pass: &'static str,
        /// Rays left.
        rays: u32,
        /// Steps allowed for each ray.
        steps: u64,
    },
}

impl Error {
    /// An [`Error::Io`]; for `map_err(Error::io("reading", path))`.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Error + use<> {
        let path = path.to_path_buf();
        move |source| Error::Io { path, action, source }
    }

    /// An [`Error::File`] without a line.
    pub fn file(path: &Path, message: impl Into<String>) -> Error {
        Error::File { path: path.to_path_buf(), line: None, message: message.into() }
    }

    /// An [`Error::File`] at a line (from 1).
    pub fn at(path: &Path, line: usize, message: impl Into<String>) -> Error {
        Error::File { path: path.to_path_buf(), line: Some(line), message: message.into() }
    }
}

/// The setting that lowers the memory of a resource of this name.
pub(crate) fn lowered_by(resource: &str) -> &'static str {
    let has = |word: &str| resource.contains(word);
    if resource.starts_with("scene ") {
        "simplify the scene, or shrink its textures"
    } else if has("photon") {
        "lower --photons"
    } else if has("splat") {
        "lower --splat-particles"
    } else if has("ring") {
        "lower --ring"
    } else if has("light") && !has("direct") || has("particle") || has("walk") {
        "lower --light-pool, --particles or --max-depth"
    } else {
        "lower --resolution, or render a part of it with --crop"
    }
}
