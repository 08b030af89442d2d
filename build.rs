//! Compiles the kernels and writes them, with checks of the structures they share with the host, into OUT_DIR.

#[path = "src/gpu/wgsl.rs"]
mod wgsl;
#[path = "src/gpu/wgsl_emit.rs"]
mod wgsl_emit;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn main() -> ExitCode {
    let (Some(root), Some(out)) = (std::env::var_os("CARGO_MANIFEST_DIR"), std::env::var_os("OUT_DIR")) else {
        eprintln!("error: run by cargo only");
        return ExitCode::FAILURE;
    };
    let (root, out) = (PathBuf::from(root), PathBuf::from(out));
    let result = folder(&root, "shaders", &out, "").and_then(|()| folder(&root, "tests/gpu/kernels", &out, "test_"));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

/// Compiles one folder of kernels; a folder that is absent (the tests' one in a published crate) counts as empty.
fn folder(root: &Path, label: &str, out: &Path, prefix: &str) -> Result<(), String> {
    let dir = root.join(label);
    let built = if dir.is_dir() {
        println!("cargo::rerun-if-changed={label}");
        wgsl_emit::build(&dir, label)?
    } else {
        Vec::new()
    };
    let write = |name: String, bytes: &[u8]| {
        std::fs::write(out.join(&name), bytes).map_err(|e| format!("{}: {e}", out.join(&name).display()))
    };
    let bytes = |words: &[u32]| words.iter().flat_map(|word| word.to_ne_bytes()).collect::<Vec<u8>>();
    for kernel in &built {
        let name = &kernel.permutation.name;
        write(format!("{prefix}{name}.spv"), &bytes(&kernel.compiled.spirv))?;
        write(format!("{prefix}{name}.checked.spv"), &bytes(&kernel.compiled.spirv_checked))?;
    }
    write(format!("{prefix}shaders.rs"), wgsl_emit::emit_shaders(&built, prefix).as_bytes())?;
    write(format!("{prefix}layout_checks.rs"), wgsl_emit::emit_layout_checks(&built).as_bytes())
}
