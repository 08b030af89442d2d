#!/usr/bin/env python3
"""Crates that a host builds with lightsum, and the version of Rust that they ask for, as the table of docs/embedding.md.

    scripts/host_build.py             counts, by `cargo tree` and `cargo metadata`
    scripts/host_build.py --build     seconds as well: each set of features is built for release in an empty folder
    scripts/host_build.py --build none default     these sets alone

The version of Rust is the highest `rust-version` of the crates: what they ask for by their manifests, not what a build was tested with.
lightsum's own manifest asks for that of the default features.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLATFORM = "x86_64-unknown-linux-gnu"
SETS = [
    ("none", ["--no-default-features"]),
    ("`images`", ["--no-default-features", "--features", "images"]),
    ("`gltf`", ["--no-default-features", "--features", "gltf"]),
    ("`formats`", ["--no-default-features", "--features", "formats"]),
    ("`viewer`", ["--no-default-features", "--features", "viewer"]),
    ("default", []),
]


def cargo(*arguments):
    return subprocess.run(["cargo", *arguments], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def version(text):
    return tuple(int(part) for part in text.split(".")[:2])


def crates(features):
    """Name and version of all crates of a build but lightsum, build scripts and procedural macros included."""
    lines = cargo("tree", "--edges", "normal,build", "--target", PLATFORM, "--prefix", "none", "--format", "{p}", "--locked", *features)
    found = {tuple(line.split()[:2]) for line in lines.splitlines() if line.strip()}
    return {(name, number.lstrip("v")) for name, number in found if name != "lightsum"}


def rust(of_build):
    """The highest rust-version of crates, and the crate."""
    metadata = json.loads(cargo("metadata", "--format-version", "1", "--locked", "--filter-platform", PLATFORM))
    needs = []
    for package in metadata["packages"]:
        if (package["name"], package["version"]) in of_build and package["rust_version"]:
            needs.append((version(package["rust_version"]), package["name"]))
    return max(needs)


def seconds(features):
    with tempfile.TemporaryDirectory() as folder:
        start = time.monotonic()
        cargo("build", "--quiet", "--release", "--lib", "--locked", "--target-dir", folder, *features)
        return time.monotonic() - start


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", action="store_true", help="measure builds, which takes minutes")
    names = [name.strip("`") for name, _ in SETS]
    parser.add_argument("sets", nargs="*", metavar="SET", help="sets of features [default: all]: " + ", ".join(names))
    args = parser.parse_args()
    if unknown := set(args.sets) - set(names):
        parser.error(f"no such set: {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    print("| features | crates | Rust, and the crate that asks for it |" + (" seconds |" if args.build else ""))
    print("|---|---|---|" + ("---|" if args.build else ""))
    for name, features in (SETS[names.index(name)] for name in args.sets or names):
        of_build = crates(features)
        (major, minor), of = rust(of_build)
        row = f"| {name} | {len(of_build)} | {major}.{minor}, {of} |"
        print(row + (f" {seconds(features):.0f} |" if args.build else ""))


if __name__ == "__main__":
    main()
