#!/bin/bash
# Install what running needs and is not there: the Vulkan loader and a driver (Mesa's, which has one for the processor).
#   scripts/setup.sh            for rendering
#   scripts/setup.sh --tests    for the tests as well: the validation layer, an X server without a screen with what a window needs, and
#                               MPI with libclang, by which its bindings are made
set -euo pipefail

tests=false
case "${1:-}" in
  '') ;;
  --tests) tests=true ;;
  *) echo "usage: scripts/setup.sh [--tests]" >&2; exit 2 ;;
esac

# Folders in which the loader looks for drivers and layers.
folders=(/etc/vulkan /usr/share/vulkan /usr/local/share/vulkan /usr/local/etc/vulkan "${XDG_DATA_HOME:-${HOME:-/root}/.local/share}/vulkan")

has_library() {
  # ldconfig lies in a folder that not every user's path has. No grep -q: it would break the pipe early.
  PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep -cF "$1" >/dev/null
}

# Whether a file of this pattern lies in one of the folders.
has_file() {
  local folder
  for folder in "${folders[@]}"; do
    compgen -G "$folder/$1" >/dev/null && return 0
  done
  return 1
}

has_driver() {
  [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] || has_file 'icd.d/*.json'
}

has_layer() {
  [ -n "${VK_LAYER_PATH:-}" ] || has_file 'explicit_layer.d/*validation*.json'
}

packages=()
has_library libvulkan.so.1 || packages+=(libvulkan1)
has_driver || packages+=(mesa-vulkan-drivers)
if $tests; then
  has_layer || packages+=(vulkan-validationlayers)
  command -v Xvfb >/dev/null || packages+=(xvfb)
  command -v mpicc >/dev/null || packages+=(libopenmpi-dev)
  command -v mpirun >/dev/null || packages+=(openmpi-bin)
  # libclang-cpp is another library.
  [ -n "${LIBCLANG_PATH:-}" ] || compgen -G '/usr/lib/llvm-*/lib/libclang.so*' >/dev/null || packages+=(libclang-dev)
  # winit loads these when it opens a window.
  for library in libX11-xcb.so.1:libx11-xcb1 libXcursor.so.1:libxcursor1 libXi.so.6:libxi6 libxkbcommon-x11.so.0:libxkbcommon-x11-0; do
    has_library "${library%%:*}" || packages+=("${library##*:}")
  done
fi
[ ${#packages[@]} -gt 0 ] || exit 0

if ! command -v apt-get >/dev/null; then
  echo "error: install with your system's package manager what Debian calls: ${packages[*]}" >&2
  exit 1
fi
if [ "$(id -u)" != 0 ]; then
  echo "error: packages are missing; install them with: sudo apt-get install ${packages[*]}" >&2
  exit 1
fi
echo "installing ${packages[*]}"
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq
apt-get install -y -qq --no-install-recommends "${packages[@]}"
