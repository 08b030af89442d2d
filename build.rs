//! Compiles the kernels and writes them, with checks of the structures they share with the host, into OUT_DIR. Tells the
//! programs the commit that they were built from.

#[path = "src/gpu/wgsl.rs"]
mod wgsl;
#[path = "src/gpu/wgsl_emit.rs"]
mod wgsl_emit;
#[path = "src/gpu/wgsl_parameters.rs"]
mod wgsl_parameters;
#[path = "src/gpu/wgsl_spirv.rs"]
mod wgsl_spirv;
#[path = "src/gpu/wgsl_texels.rs"]
mod wgsl_texels;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    let (Some(root), Some(out)) = (std::env::var_os("CARGO_MANIFEST_DIR"), std::env::var_os("OUT_DIR")) else {
        eprintln!("error: run by cargo only");
        return ExitCode::FAILURE;
    };
    let (root, out) = (PathBuf::from(root), PathBuf::from(out));
    println!("cargo::rustc-env=LIGHTSUM_COMMIT={}", commit(&root).unwrap_or_else(|| "unknown".into()));
    let mut result = folder(&root, "shaders", &out, "");
    if std::env::var_os("CARGO_FEATURE_CONFORM").is_some() {
        result = result.and_then(|()| folder(&root, "src/conform/kernels", &out, "conform_"));
    }
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

/// Compiles one folder of kernels.
fn folder(root: &Path, label: &str, out: &Path, prefix: &str) -> Result<(), String> {
    println!("cargo::rerun-if-changed={label}");
    let built = wgsl_emit::build(&root.join(label), label)?;
    let write = |name: String, bytes: &[u8]| {
        std::fs::write(out.join(&name), bytes).map_err(|e| format!("{}: {e}", out.join(&name).display()))
    };
    let bytes = |words: &[u32]| words.iter().flat_map(|word| word.to_ne_bytes()).collect::<Vec<u8>>();
    for kernel in &built {
        let name = &kernel.permutation.name;
        write(format!("{prefix}{name}.spv"), &bytes(&kernel.compiled.spirv))?;
        write(format!("{prefix}{name}.checked.spv"), &bytes(&kernel.compiled.spirv_checked))?;
        write(format!("{prefix}{name}.texels.spv"), &bytes(&kernel.compiled.spirv_texels))?;
    }
    write(format!("{prefix}shaders.rs"), wgsl_emit::emit_shaders(&built, prefix).as_bytes())?;
    write(format!("{prefix}layout_checks.rs"), wgsl_emit::emit_layout_checks(&built).as_bytes())
}

/// The commit that is checked out here; `None` without git, or where the crate is not a repository of its own (a published
/// crate that was unpacked within another one).
fn commit(root: &Path) -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).current_dir(root).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    if !git(&["rev-parse", "--show-prefix"])?.is_empty() {
        return None;
    }
    // Both change whenever another commit is checked out. Cargo would take a file that is not there for changed.
    for name in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", name]).map(|path| root.join(path)).filter(|p| p.exists()) {
            println!("cargo::rerun-if-changed={}", path.display());
        }
    }
    git(&["rev-parse", "--short", "HEAD"])
}
