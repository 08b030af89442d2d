#!/bin/bash
# Checks that the library builds without features and with each alone, and what a host that takes it without the default ones builds.
#   scripts/features.sh                    features that need nothing but Rust
#   scripts/features.sh FEATURE...         these; "" is none
# mpi needs a compiler wrapper (mpicc) and libclang, oidn the library Open Image Denoise.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ $# -eq 0 ]; then
  set -- "" images gltf mitsuba obj ply formats conform viewer hot-reload cli
fi
for feature in "$@"; do
  echo "--no-default-features --features '$feature'"
  cargo check --quiet --no-default-features --features "$feature" --lib
done
