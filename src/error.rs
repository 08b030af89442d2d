//! The one error type. A message names the file, pass, material or resource concerned and says what to do.

use std::path::{Path, PathBuf};

/// Result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong, with enough in the message to mend it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be read or written.
    #[error("{}: {action} failed: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried: "reading", "writing", "renaming".
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A scene, model, texture or state file is invalid.
    #[error("{}{}: {message}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    File {
        /// The file.
        path: PathBuf,
        /// The line, where known (from 1).
        line: Option<usize>,
        /// What is wrong, which object, and what to do.
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
        /// What is wrong and which values are right.
        message: String,
    },
    /// There is no usable Vulkan device, driver or layer.
    #[error("{0}")]
    NoDevice(String),
    /// A Vulkan call failed.
    #[error("{what}: {result}")]
    Vulkan {
        /// The call or pass.
        what: String,
        /// Vulkan's answer.
        result: ash::vk::Result,
    },
    /// The device was lost while a pass ran.
    #[error(
        "the device was lost {during}: the driver reset it (watchdog or fault); lower --lights-per-dispatch or the resolution"
    )]
    DeviceLost {
        /// What was being run.
        during: String,
    },
    /// Device or host memory ran out.
    #[error("{resource}: no memory for {bytes} bytes; lower the resolution or --paths, or simplify the scene")]
    OutOfMemory {
        /// The resource asked for.
        resource: String,
        /// Its size.
        bytes: u64,
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
        /// What to do.
        advice: &'static str,
    },
    /// A device resource is used in a way it does not allow.
    #[error("{name}: {message}")]
    Resource {
        /// Its name.
        name: String,
        /// What is wrong and what to do.
        message: String,
    },
    /// A shader does not fit the device or what is bound to it, or failed to compile (`hot-reload`).
    #[error("shader {name}: {message}")]
    Shader {
        /// Stem of the shader.
        name: String,
        /// naga's report.
        message: String,
    },
    /// A ray needed more traversal steps than all rounds of a pass allow.
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
