#!/bin/bash
# Fuzz the readers of files, one after the other on one thread, and sum up executions and coverage:
#   scripts/fuzz.sh --seconds 60                 each reader for a minute
#   scripts/fuzz.sh --executions 100000 obj ply  these, until each has been executed so often in all runs together
#   scripts/fuzz.sh                              only the table of what was done
# Needs a nightly toolchain (NIGHTLY, default nightly) and a C++ compiler, but not cargo-fuzz. What is found on the way, inputs that crash among
# it, is kept in fuzz/ of the target folder; remove that to start anew. Exit code 1 if a reader crashed.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=0 executions=0
while [ $# -gt 0 ]; do
  case "$1" in
    --seconds) seconds="$2"; shift 2 ;;
    --executions) executions="$2"; shift 2 ;;
    -*) echo "usage: scripts/fuzz.sh [--seconds S | --executions N] [READER...]" >&2; exit 2 ;;
    *) break ;;
  esac
done
readers=("$@")
if [ ${#readers[@]} = 0 ]; then
  for file in fuzz/fuzz_targets/*.rs; do readers+=("$(basename "$file" .rs)"); done
fi

target="${CARGO_TARGET_DIR:-target}"
work="$target/fuzz"
triple=x86_64-unknown-linux-gnu
mkdir -p "$work"

if [ "$seconds" != 0 ] || [ "$executions" != 0 ]; then
  # As cargo-fuzz does without a sanitizer. A target is named so that build scripts are compiled without.
  flags="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters"
  flags+=" -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing -Ccodegen-units=1"
  RUSTFLAGS="$flags" cargo "+${NIGHTLY:-nightly}" build --release --manifest-path fuzz/Cargo.toml --target "$triple" --target-dir "$work/build" \
    "${readers[@]/#/--bin=}"
fi

# Executions of a reader in all runs.
executed() {
  { cat "$work/$1".*.log 2>/dev/null || true; } | sed -n 's/^stat::number_of_executed_units: *//p' | awk '{ n += $1 } END { print n + 0 }'
}

crashed=0
for reader in "${readers[@]}"; do
  limits=()
  [ "$seconds" = 0 ] || limits+=("-max_total_time=$seconds")
  if [ "$executions" != 0 ]; then
    left=$((executions - $(executed "$reader")))
    [ "$left" -gt 0 ] || continue
    limits+=("-runs=$left")
  fi
  [ ${#limits[@]} -gt 0 ] || continue
  mkdir -p "$work/corpus/$reader" "$work/crashes"
  "$work/build/$triple/release/$reader" -max_len=8192 -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
    -artifact_prefix="$work/crashes/$reader-" "${limits[@]}" "$work/corpus/$reader" "fuzz/corpus/$reader" \
    > "$work/$reader.$(date +%s).log" 2>&1 || { echo "crashed: $reader; see $work/crashes" >&2; crashed=1; }
done

echo "| reader | executions | edges |"
echo "|---|---|---|"
all=0
for file in fuzz/fuzz_targets/*.rs; do
  reader="$(basename "$file" .rs)"
  count="$(executed "$reader")"
  edges="$({ cat "$work/$reader".*.log 2>/dev/null || true; } | sed -n 's/.* cov: \([0-9]*\) .*/\1/p' | sort -n | tail -1)"
  all=$((all + count))
  echo "| $reader | $count | ${edges:-0} |"
done
echo "| all | $all | |"
exit $crashed
