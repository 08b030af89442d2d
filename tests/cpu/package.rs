//! Promises of the manifest to those who depend on the crate.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::Value;

/// A version of Rust, "1.95" or "1.95.0".
fn version(text: &str) -> [u32; 3] {
    let mut parts = text.split('.').map(|part| part.parse().unwrap());
    [0; 3].map(|_: u32| parts.next().unwrap_or(0))
}

/// The least version of Rust that the dependencies of a build for Linux allow, and no lower one. That the code itself needs no later
/// one is clippy's to say (`incompatible_msrv`).
#[test]
fn the_version_of_rust_is_what_the_dependencies_need() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", "x86_64-unknown-linux-gnu"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let is_ours = |package: &&Value| package["name"] == "lightsum";
    let own = packages.iter().find(is_ours).unwrap()["rust_version"].as_str().map(version).unwrap();
    let needed = packages.iter().filter(|package| !is_ours(package)).filter_map(|package| {
        package["rust_version"].as_str().map(|text| (version(text), package["name"].as_str().unwrap()))
    });
    let (least, of) = needed.max().unwrap();
    assert_eq!(own, least, "{of} needs it");
}

/// Most bytes of a package, compressed.
const MOST_BYTES: usize = 2 << 20;

#[test]
fn the_package_is_small_and_whole() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(env!("CARGO"))
        .args(["package", "--list", "--allow-dirty", "--offline"])
        .current_dir(root)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let list = String::from_utf8(output.stdout).unwrap();
    let files: Vec<&str> = list.lines().collect();
    for needed in ["build.rs", "README.md", "LICENSE-MIT", "shaders/trace.wgsl", "src/conform/kernels/fill.wgsl"] {
        assert!(files.contains(&needed), "{needed} is missing");
    }
    for unwanted in ["docs/cornell.png", "scenes/six-rooms/house.glb", "scripts/setup.sh", "fuzz/Cargo.toml"] {
        assert!(!files.contains(&unwanted), "{unwanted} is in the package");
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    for file in files {
        // Cargo makes some of them itself.
        if let Ok(bytes) = std::fs::read(root.join(file)) {
            encoder.write_all(&bytes).unwrap();
        }
    }
    let size = encoder.finish().unwrap().len();
    println!("{size} bytes, compressed");
    assert!(size < MOST_BYTES, "{size} bytes, {MOST_BYTES} are allowed");
}
