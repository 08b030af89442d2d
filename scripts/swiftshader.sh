#!/bin/bash
# Run a command with SwiftShader as the only Vulkan driver:  scripts/swiftshader.sh cargo test --test gpu
# The driver is taken from Debian's package chromium-common, unpacked into the target folder and not installed.
set -euo pipefail

[ $# -gt 0 ] || { echo "usage: scripts/swiftshader.sh COMMAND [ARGUMENT...]" >&2; exit 2; }

target="${CARGO_TARGET_DIR:-$(dirname "$0")/../target}"
mkdir -p "$target"
folder="$(cd "$target" && pwd)/swiftshader"
driver="$folder/usr/lib/chromium/vk_swiftshader_icd.json"

if [ ! -e "$driver" ]; then
  command -v apt-get >/dev/null || { echo "error: apt-get is needed to fetch chromium-common" >&2; exit 1; }
  [ "$(id -u)" != 0 ] || apt-get update -qq
  # Unpacked beside its place and then renamed, so that a broken download is not taken for a driver.
  rm -rf "$folder" "$folder.new"
  mkdir "$folder.new"
  (cd "$folder.new" && apt-get download -qq chromium-common && dpkg-deb -x chromium-common_*.deb . && rm chromium-common_*.deb)
  mv "$folder.new" "$folder"
  [ -e "$driver" ] || { echo "error: chromium-common has no $driver" >&2; exit 1; }
fi

export VK_DRIVER_FILES="$driver" VK_ICD_FILENAMES="$driver"
exec "$@"
