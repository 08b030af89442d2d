#!/bin/bash
# Run tests under GPU-assisted validation, which checks each access of a kernel to its buffers:
#   scripts/gpu_assisted.sh                    the control, which must be reported; then the checks of all kernels
#   scripts/gpu_assisted.sh --system           the same with the system's validation layer
#   scripts/gpu_assisted.sh [--system] FILTER  the control, and the tests whose names contain this
# The layer is that of Debian's package chromium-common, unpacked into the target folder (scripts/swiftshader.sh); the driver is the system's.
set -euo pipefail
cd "$(dirname "$0")/.."

system=false
if [ "${1:-}" = --system ]; then
  system=true
  shift
fi
filter="${1:-checks::}"
target="${CARGO_TARGET_DIR:-target}"

if ! $system; then
  scripts/swiftshader.sh true
  folder="$(cd "$target" && pwd)"
  library="$folder/swiftshader/usr/lib/chromium/libVkLayer_khronos_validation.so"
  [ -e "$library" ] || { echo "error: chromium-common has no $library" >&2; exit 1; }
  mkdir -p "$folder/gpu_assisted"
  cat > "$folder/gpu_assisted/validation.json" <<END
{
  "file_format_version": "1.2.0",
  "layer": {
    "name": "VK_LAYER_KHRONOS_validation", "type": "GLOBAL", "library_path": "$library", "api_version": "1.4.300",
    "implementation_version": "1", "description": "Khronos validation layer",
    "instance_extensions": [
      { "name": "VK_EXT_debug_report", "spec_version": "9" },
      { "name": "VK_EXT_debug_utils", "spec_version": "1" },
      { "name": "VK_EXT_validation_features", "spec_version": "5" },
      { "name": "VK_EXT_layer_settings", "spec_version": "2" }
    ]
  }
}
END
  export VK_LAYER_PATH="$folder/gpu_assisted"
fi

# Names of newer and of older layers.
export VK_LAYER_GPUAV_ENABLE=1
export VK_LAYER_ENABLES="VK_VALIDATION_FEATURE_ENABLE_GPU_ASSISTED_EXT;VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT"

status=0
echo "control: a kernel that writes outside its buffer must be reported"
cargo test --test gpu -- --ignored --nocapture gpu_assisted:: || status=1
echo "tests named $filter: there must be no message"
cargo test --test gpu -- "$filter" || status=1
exit $status
