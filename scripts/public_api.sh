#!/bin/sh
# Compares the public interface of the library with the list that is kept: scripts/public_api.sh [--bless]
#
# rustdoc writes the interface as JSON, an option of development compilers which RUSTC_BOOTSTRAP allows; only rustdoc sees that variable, so
# that nothing is compiled anew because of it. tests/public_api, a package of its own, lists it.
set -e
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
mkdir -p "$target"
case $target in /*) ;; *) target=$PWD/$target ;; esac
cat > "$target/rustdoc-json" <<'END'
#!/bin/sh
RUSTC_BOOTSTRAP=1 exec rustdoc "$@"
END
chmod +x "$target/rustdoc-json"
RUSTDOC=$target/rustdoc-json cargo rustdoc --quiet --lib --target-dir "$target" -- -Z unstable-options --output-format json --cap-lints allow
cargo run --quiet --locked --target-dir "$target/public_api" --manifest-path tests/public_api/Cargo.toml -- \
    "$target/doc/lightsum.json" tests/public_api/list.txt "$@"
