#!/bin/bash
# Look for undefined behaviour and for data races in what runs on the host:
#   scripts/undefined.sh miri [FILTER...]      unit tests under Miri; default: those of bytes, sums, files and sequences
#   scripts/undefined.sh threads [FILTER...]   unit tests under ThreadSanitizer; default: those whose code runs on several threads
# Needs a nightly toolchain (NIGHTLY, default nightly) with the components miri and rust-src. Neither can follow a driver of Vulkan, so tests
# with a device are no part of it.
set -euo pipefail
cd "$(dirname "$0")/.."

mode="${1:-}"
[ $# -eq 0 ] || shift
toolchain="${NIGHTLY:-nightly}"
triple=x86_64-unknown-linux-gnu
target="${CARGO_TARGET_DIR:-target}"
# Without formats and programs: their crates would have to be compiled anew.
features=(--no-default-features --features obj)

case "$mode" in
  miri)
    filters=("$@")
    [ ${#filters[@]} -gt 0 ] || filters=(fingerprint:: film:: output::state output::film_file output::temporary sampling::halton sampling::random input::)
    # Files and the time are those of the machine; what rayon's threads leave at the end is no leak. The queues of rayon (crossbeam-epoch) keep
    # the rules of tree borrows, not those of stacked borrows, and turn numbers into pointers. The test that is left out starts a
    # process, which Miri cannot.
    MIRIFLAGS="-Zmiri-disable-isolation -Zmiri-ignore-leaks -Zmiri-tree-borrows -Zmiri-permissive-provenance" \
      cargo "+$toolchain" miri test --lib "${features[@]}" --target-dir "$target/miri" -- "${filters[@]}" --skip devices_and_pipes
    ;;
  threads)
    filters=("$@")
    [ ${#filters[@]} -gt 0 ] || filters=(output:: input:: accel:: light:: radiosity:: bake:: path_trace:: scene:: superposition::)
    RUSTFLAGS="-Zsanitizer=thread" RUSTDOCFLAGS="-Zsanitizer=thread" TSAN_OPTIONS="halt_on_error=0 exitcode=66" \
      cargo "+$toolchain" test --lib "${features[@]}" -Zbuild-std --target "$triple" --target-dir "$target/threads" -- "${filters[@]}"
    ;;
  *)
    echo "usage: scripts/undefined.sh miri|threads [FILTER...]" >&2
    exit 2
    ;;
esac
